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
        let mut axes = BTreeMap::<(usize, usize), [bool; 3]>::new();
        for (dof, start, motion) in system.prescribed().iter() {
            axes.entry((dof.particle, motion)).or_default()[dof.axis] = true;
            if let Motion::Path { .. } = motions[motion] {
                positions[dof.particle][dof.axis] = start;
            }
        }
        let mut groups = BTreeMap::<(usize, [bool; 3]), Vec<u32>>::new();
        for ((particle, motion), axes) in axes {
            groups.entry((motion, axes)).or_default().push(particle as u32);
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
            flags if !flags.contains(&true) => None,
            flags if !flags.contains(&false) => Some(Flags::Uniform(true)),
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
    use crate::scene::{Kind, Scene, builtin};
    use crate::system::Curve;

    /// What holds for all is said once: no velocities at rest, no axes where all are prescribed.
    #[test]
    fn snapshots_are_short() {
        let (system, state) = builtin(Kind::Chain, 3).unwrap().build().unwrap();
        let scene = Scene::snapshot("rest", &system, &state);
        assert!(scene.particles.velocities.is_none() && scene.time.is_empty());
        assert!(scene.constraints.iter().all(|entry| entry.axes.is_none() && entry.path.is_none()));
    }

    /// Times that round to one after the shift are one: 1001 and the number after it.
    #[test]
    fn times_that_coincide_are_merged() {
        let path = Curve { times: vec![1.0, 1.0_f64.next_up(), 2.0], values: vec![1.0, 2.0, 3.0] }.after(-1000.0);
        assert_eq!((path.times, path.values), (vec![1001.0, 1002.0], vec![1.0, 3.0]));
    }
}
