//! From a [`System`] and a [`State`] back to a [`Scene`].

use super::{AxisName, ConstraintEntry, Particles, Path, Row, Scene, Springs, Values};
use crate::system::{Axes, Motion, State, System};
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
        let row = |v| Row::of(v, dimension);
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
        Self {
            name: name.to_owned(),
            gravity: Some(row(&system.gravity())),
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
            },
            constraints: groups.into_iter().map(entry).collect(),
            ..Self::default()
        }
    }
}

impl Path {
    /// The rest of a path from time t on, with t as time zero.
    fn from_time(times: &[f64], offsets: &[Vector3<f64>], t: f64, dimension: usize) -> Self {
        let current = times.partition_point(|&time| time <= t).saturating_sub(1);
        let mut path = Self::default();
        for (time, offset) in times.iter().zip(offsets).skip(current) {
            // Times nearer than rounding may fall together: the first of them stands for all.
            if path.times.last().is_none_or(|&last| time - t > last) {
                path.times.push(time - t);
                path.offsets.push(Row::of(offset, dimension));
            }
        }
        path
    }
}
