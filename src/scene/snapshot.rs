//! From a [`System`] and a [`State`] back to a [`Scene`].

use super::{
    ActuationEntry, AxisName, ConstraintEntry, Drag, FactorPath, Flags, ForceEntry, Gravity, GravityPath, Particles,
    Path, Row, Scene, Springs, Values,
};
use crate::system::{Axes, Curve, Motion, State, System};
use nalgebra::Vector3;
use std::collections::BTreeMap;

impl Scene {
    /// A scene that starts at `state` and continues the system's motion, with time counted from that state's.
    ///
    /// Everything is kept to the bit, except that the positions of prescribed motions after the start agree to a few units in the last
    /// place. A state that is not finite, or in which the ends of a spring coincide, gives a scene that [`build`](Self::build) rejects.
    pub fn snapshot(name: &str, system: &System, state: &State) -> Self {
        let dimension = system.dimension();
        let row = |v: &Vector3<f64>| Row::of(v, dimension);
        let motions = system.prescribed().motions();
        let mut positions = state.positions.clone();
        let mut groups = BTreeMap::<(usize, [bool; 3]), Vec<u32>>::new();
        let coordinates: Vec<_> = system.prescribed().iter().collect();
        for of_particle in coordinates.chunk_by(|(a, ..), (b, ..)| a.particle == b.particle) {
            let mut axes = BTreeMap::<usize, [bool; 3]>::new();
            for &(dof, start, motion) in of_particle {
                axes.entry(motion).or_default()[dof.axis] = true;
                if let Motion::Path { .. } = motions[motion] {
                    positions[dof.particle][dof.axis] = start;
                }
            }
            for (motion, axes) in axes {
                let particle = of_particle.first().map(|(dof, ..)| dof.particle as u32);
                groups.entry((motion, axes)).or_default().extend(particle);
            }
        }
        let entry = |((motion, axes), particles): ((usize, [bool; 3]), Vec<u32>)| {
            let axes: Vec<AxisName> = AxisName::ALL.into_iter().filter(|axis| axes[axis.index()]).collect();
            let axes = (axes.len() < Axes::first(dimension).count()).then_some(axes);
            let (velocity, path) = match &motions[motion] {
                Motion::Held => (None, None),
                Motion::Velocity(v) => (Some(row(v)), None),
                Motion::Path { times, offsets } => {
                    let path = Curve { times: times.clone(), values: offsets.clone() };
                    let Curve { times, values } = path.after(state.time);
                    (None, Some(Path { times, offsets: values.iter().map(row).collect() }))
                }
            };
            ConstraintEntry { particles, axes, velocity, path }
        };
        let at_rest = state.velocities.iter().all(|v| v.iter().all(|c| c.to_bits() == 0));
        let springs = || system.springs().iter();
        let (loads, behaviour) = (system.loads(), system.behaviour());
        let gravity = match &loads.gravity {
            None => Gravity::Constant(row(&system.gravity())),
            Some(curve) => {
                let Curve { times, values } = curve.after(state.time);
                Gravity::Path(GravityPath { times, values: values.iter().map(row).collect() })
            }
        };
        // One entry for every distinct load.
        let mut forces = BTreeMap::<[u64; 3], Vec<u32>>::new();
        for (particle, force) in (0u32..).zip(&loads.forces).filter(|(_, force)| **force != Vector3::zeros()) {
            forces.entry(<[f64; 3]>::from(*force).map(f64::to_bits)).or_default().push(particle);
        }
        let force = |(bits, particles): ([u64; 3], Vec<u32>)| ForceEntry {
            particles,
            value: row(&bits.map(f64::from_bits).into()),
        };
        let actuation = behaviour.actuation.iter().map(|entry| {
            let Curve { times, values: factors } = entry.factors.after(state.time);
            let springs = entry.springs.iter().map(|&spring| spring as u32).collect();
            ActuationEntry { springs, path: FactorPath { times, factors } }
        });
        let tension_only = match &behaviour.tension_only[..] {
            [] => None,
            flags if flags.iter().all(|&flag| flag) => Some(Flags::Uniform(true)),
            flags if flags.iter().all(|&flag| !flag) => None,
            flags => Some(Flags::Each(flags.to_vec())),
        };
        Self {
            name: name.to_owned(),
            gravity: Some(gravity),
            particles: Particles {
                positions: positions.iter().map(row).collect(),
                velocities: (!at_rest).then(|| state.velocities.iter().map(row).collect()),
                masses: Some(Values::collect(system.masses().iter().copied())),
            },
            springs: Springs {
                pairs: system.pairs().to_vec(),
                stiffness: Some(Values::collect(springs().map(|s| s.stiffness))),
                rest_lengths: Some(Values::collect(springs().map(|s| s.rest_length))),
                damping: Some(Values::collect(springs().map(|s| s.damping))),
                tension_only,
                actuation: actuation.collect(),
            },
            forces: forces.into_iter().map(force).collect(),
            drag: (!loads.drag.is_empty()).then(|| Drag { coefficient: Values::collect(loads.drag.iter().copied()) }),
            constraints: groups.into_iter().map(entry).collect(),
            ..Self::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::{Constraint, SystemBuilder};

    /// In a plane, at 2.5 s: a held particle, one on a path along x whose second segment lasts from 2 s to 4 s, a free one.
    #[test]
    fn motions_continue_from_the_time_of_the_state() {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        for x in [0.0, 1.0, 5.0] {
            builder.particle([x, 0.0, 0.0], 3.0);
        }
        builder.masses[2] = 4.0;
        builder.hold(0);
        let offsets = [0.0, 3.0, 7.0].map(|x| Vector3::new(x, 0.0, 0.0)).to_vec();
        let motion = Motion::Path { times: vec![1.0, 2.0, 4.0], offsets };
        builder.constrain(Constraint { particles: vec![1], axes: Axes::of(&[0]), motion });
        let (system, mut state) = builder.build().unwrap();
        let scene = Scene::snapshot("rest", &system, &state);
        assert!(scene.particles.velocities.is_none() && scene.time.is_empty());
        state.time = 2.5;
        state.prescribe(&system);
        let scene = Scene::snapshot("moving", &system, &state);
        let rows = |rows: &[Row]| rows.iter().map(|row| row.as_slice().to_vec()).collect::<Vec<_>>();
        // Along a path the positions are those that its offsets are added to.
        assert_eq!(rows(&scene.particles.positions), [[0.0, 0.0], [1.0, 0.0], [5.0, 0.0]]);
        assert_eq!(rows(&scene.particles.velocities.unwrap()), [[0.0, 0.0], [2.0, 0.0], [0.0, 0.0]]);
        assert_eq!(scene.particles.masses, Some(Values::Each(vec![3.0, 3.0, 4.0])));
        let [held, moved] = &scene.constraints[..] else { panic!("two constraints") };
        assert_eq!((&held.particles[..], held.axes.is_none(), held.path.is_none()), (&[0][..], true, true));
        assert_eq!((&moved.particles[..], moved.axes.as_ref().map(Vec::len)), (&[1][..], Some(1)));
        let path = moved.path.as_ref().unwrap();
        assert_eq!((&path.times[..], rows(&path.offsets)), (&[-0.5, 1.5][..], vec![vec![3.0, 0.0], vec![7.0, 0.0]]));
    }

    /// Times that round to one after the shift are one: 1001 and the number after it.
    #[test]
    fn times_that_coincide_are_merged() {
        let path = Curve { times: vec![1.0, 1.0_f64.next_up(), 2.0], values: vec![1.0, 2.0, 3.0] }.after(-1000.0);
        assert_eq!((path.times, path.values), (vec![1001.0, 1002.0], vec![1.0, 3.0]));
    }
}
