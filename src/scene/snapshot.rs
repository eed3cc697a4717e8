//! From a [`System`] and a [`State`] back to a [`Scene`].

use super::{
    ActuationEntry, AxisName, ConstraintEntry, Drag, FactorPath, Flags, ForceEntry, Gravity, GravityPath, Particles,
    Path, Row, Scene, Springs, Values,
};
use crate::system::{Axes, Curve, Motion, State, System};
use nalgebra::Vector3;
use std::collections::BTreeMap;

impl Scene {
    /// A scene that starts at `state` and goes on as the system would, its time counted from that state's.
    ///
    /// Everything is kept to the bit except that a velocity or path that has been under way is rounded anew: its
    /// positions agree to a few units in the last place. A state that is not finite, or in which the ends of a spring
    /// coincide, gives a scene that [`build`](Self::build) rejects.
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
                groups
                    .entry((motion, axes))
                    .or_default()
                    .extend(of_particle.first().map(|(dof, ..)| dof.particle as u32));
            }
        }
        let entry = |((motion, axes), particles): ((usize, [bool; 3]), Vec<u32>)| {
            let axes: Vec<AxisName> = AxisName::ALL.into_iter().filter(|axis| axes[axis.index()]).collect();
            let axes = (axes.len() < Axes::first(dimension).count()).then_some(axes);
            let (velocity, path) = match &motions[motion] {
                Motion::Held => (None, None),
                Motion::Velocity(v) => (Some(row(v)), None),
                Motion::Path { times, offsets } => (None, Some(Path::from_time(times, offsets, state.time, dimension))),
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
        // As many entries as there are different loads.
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

impl Path {
    /// The rest of a path from time t on, with t as time zero.
    fn from_time(times: &[f64], offsets: &[Vector3<f64>], t: f64, dimension: usize) -> Self {
        let path = Curve { times: times.to_vec(), values: offsets.to_vec() };
        let Curve { times, values } = path.after(t);
        Self { times, offsets: values.iter().map(|offset| Row::of(offset, dimension)).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::{Constraint, SystemBuilder};

    /// In a plane, at 2.5 s: a particle that is held, one on a path along x that has its second segment from 2 s to 4 s, a free one.
    #[test]
    fn motions_go_on_from_the_time_of_the_state() {
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
        // Along a path places are those that its offsets are added to.
        assert_eq!(rows(&scene.particles.positions), [[0.0, 0.0], [1.0, 0.0], [5.0, 0.0]]);
        assert_eq!(rows(&scene.particles.velocities.unwrap()), [[0.0, 0.0], [2.0, 0.0], [0.0, 0.0]]);
        assert_eq!(scene.particles.masses, Some(Values::Each(vec![3.0, 3.0, 4.0])));
        let [held, moved] = &scene.constraints[..] else { panic!("two constraints") };
        assert_eq!((&held.particles[..], held.axes.is_none(), held.path.is_none()), (&[0][..], true, true));
        assert_eq!((&moved.particles[..], moved.axes.as_ref().map(Vec::len)), (&[1][..], Some(1)));
        let path = moved.path.as_ref().unwrap();
        assert_eq!((&path.times[..], rows(&path.offsets)), (&[-0.5, 1.5][..], vec![vec![3.0, 0.0], vec![7.0, 0.0]]));
    }

    /// 1001 and the number after it that differs by less than its rounding are one time.
    #[test]
    fn times_that_fall_together_are_one() {
        let offsets = [1.0, 2.0, 3.0].map(|x| Vector3::new(x, 0.0, 0.0));
        let path = Path::from_time(&[1.0, 1.0_f64.next_up(), 2.0], &offsets, -1000.0, 1);
        assert_eq!(path.times, [1001.0, 1002.0]);
        assert_eq!(path.offsets.iter().map(|row| row.as_slice()[0]).collect::<Vec<_>>(), [1.0, 3.0]);
    }

    #[test]
    fn a_number_stands_for_all_that_are_the_same_to_the_bit() {
        assert_eq!(Values::collect([2.0, 2.0]), Values::Uniform(2.0));
        assert_eq!(Values::collect([2.0, 3.0]), Values::Each(vec![2.0, 3.0]));
        assert!(matches!(Values::collect([0.0, -0.0]), Values::Each(_)));
        assert_eq!(Values::collect([]), Values::Each(vec![]));
    }
}
