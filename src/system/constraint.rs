//! Kinematic constraints: prescribed coordinates and their motion.

use super::loads::{interpolate, segment_after};
use super::{Axes, Dof, State};
use nalgebra::Vector3;

/// The motion of prescribed coordinates, as an offset from their start.
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// `x(t) = x(0)`.
    Held,
    /// `x(t) = x(0) + t·v`, v in m/s.
    Velocity(Vector3<f64>),
    /// `x(t) = x(0) + offset(t)`, piecewise linear and clamped at both ends.
    Path {
        /// Increasing, in s.
        times: Vec<f64>,
        /// As many as times, in m.
        offsets: Vec<Vector3<f64>>,
    },
}

impl Motion {
    /// The times of the corners of a path, in s.
    pub(crate) fn kinks(&self) -> &[f64] {
        match self {
            Self::Held | Self::Velocity(_) => &[],
            Self::Path { times, .. } => times,
        }
    }

    /// Offset along one axis at time t, in m.
    pub fn offset(&self, t: f64, axis: usize) -> f64 {
        match self {
            Self::Held => 0.0,
            Self::Velocity(v) => t * v[axis],
            Self::Path { times, offsets } => interpolate(times, offsets, t, |offset| offset[axis]),
        }
    }

    /// Velocity along one axis just after time t (the right derivative of the offset), in m/s. A time within rounding of a kink counts as the kink.
    pub fn velocity(&self, t: f64, axis: usize) -> f64 {
        match self {
            Self::Held => 0.0,
            Self::Velocity(v) => v[axis],
            Self::Path { times, offsets } => segment_after(times, t).map_or(0.0, |[from, to]| {
                let offset = |k: usize| offsets.get(k).map_or(0.0, |offset| offset[axis]);
                (offset(to) - offset(from)) / (times[to] - times[from])
            }),
        }
    }
}

/// Particles whose coordinates along some axes are prescribed. Later constraints override earlier ones.
///
/// # Examples
/// ```
/// use nalgebra::Vector3;
/// use sprung::SystemBuilder;
/// use sprung::system::{Axes, Constraint, Motion};
///
/// let mut builder = SystemBuilder::new();
/// builder.particle([0.0, 0.0, 0.0], 1.0);
/// builder.particle([1.0, 0.0, 0.0], 1.0);
/// // Held; and on rollers: moved along x at 2 m/s, free along y and z.
/// builder.constrain(Constraint::hold([0]));
/// let motion = Motion::Velocity(Vector3::new(2.0, 0.0, 0.0));
/// builder.constrain(Constraint { particles: vec![1], axes: Axes::of(&[0]), motion });
/// let (system, _) = builder.build()?;
/// assert_eq!(system.dofs().len(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Constraint {
    /// The particles.
    pub particles: Vec<usize>,
    /// The prescribed axes.
    pub axes: Axes,
    /// Their motion.
    pub motion: Motion,
}

impl Constraint {
    /// A constraint that holds all axes of some particles.
    pub fn hold(particles: impl IntoIterator<Item = usize>) -> Self {
        Self { particles: particles.into_iter().collect(), axes: Axes::ALL, motion: Motion::Held }
    }
}

/// All prescribed coordinates, with their starts and motions.
#[derive(Debug, Clone, Default)]
pub struct Prescribed {
    motions: Vec<Motion>,
    coordinates: Vec<Coordinate>,
    /// The times of kinks of gravity and rest lengths, in s.
    kinks: Vec<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Coordinate {
    dof: Dof,
    motion: usize,
    start: f64,
}

impl Prescribed {
    /// The coordinates of some constraints, of which the last one for a coordinate applies, and the prescribed axes of every particle.
    /// `positions` are those at time zero.
    pub(super) fn new(constraints: Vec<Constraint>, positions: &[Vector3<f64>], modelled: Axes) -> (Self, Vec<Axes>) {
        let mut applied = std::collections::BTreeMap::new();
        for (index, constraint) in constraints.iter().enumerate() {
            for &particle in &constraint.particles {
                for axis in constraint.axes.iter().filter(|&axis| modelled.contains(axis)) {
                    applied.insert((particle, axis), index);
                }
            }
        }
        let mut axes = vec![Axes::NONE; positions.len()];
        let mut coordinates = Vec::with_capacity(applied.len());
        for ((particle, axis), motion) in applied {
            axes[particle] = axes[particle].with(axis);
            coordinates.push(Coordinate { dof: Dof { particle, axis }, motion, start: positions[particle][axis] });
        }
        // A motion that is overridden everywhere has no kinks. One that moves no particle of this part of a system keeps them: all parts
        // take the same steps.
        let is_overridden = |index: usize, particles: &[usize]| {
            !particles.is_empty() && coordinates.iter().all(|c: &Coordinate| c.motion != index)
        };
        let used = |(index, Constraint { particles, motion, .. }): (usize, Constraint)| {
            if is_overridden(index, &particles) { Motion::Held } else { motion }
        };
        let motions = constraints.into_iter().enumerate().map(used).collect();
        (Self { motions, coordinates, kinks: Vec::new() }, axes)
    }

    /// These and more coordinates, held at `positions`.
    pub(super) fn with_held(&self, held: &[Dof], positions: &[Vector3<f64>]) -> Self {
        let mut coordinates = self.coordinates.clone();
        let motion = self.motions.len();
        let start = |dof: Dof| positions[dof.particle][dof.axis];
        coordinates.extend(held.iter().map(|&dof| Coordinate { dof, motion, start: start(dof) }));
        // The sort is stable: the older of two entries for one coordinate stays.
        coordinates.sort_by_key(|c| (c.dof.particle, c.dof.axis));
        coordinates.dedup_by_key(|c| c.dof);
        let motions = self.motions.iter().cloned().chain([Motion::Held]).collect();
        Self { motions, coordinates, kinks: self.kinks.clone() }
    }

    pub(super) fn without(mut self, is_removed: impl Fn(&Dof) -> bool) -> Self {
        self.coordinates.retain(|c| !is_removed(&c.dof));
        self
    }

    /// The motions shifted to the positions of a state, except where they agree with it to rounding.
    pub(super) fn shifted_to(mut self, state: &State) -> Self {
        for c in &mut self.coordinates {
            let (motion, Dof { particle, axis }) = (&self.motions[c.motion], c.dof);
            let Some(position) = state.positions.get(particle).map(|x| x[axis]) else { continue };
            let offset = motion.offset(state.time, axis);
            let travel = motion.velocity(state.time, axis) * state.time;
            // The rounding error is relative to the largest term of the sum.
            let size = position.abs().max(c.start.abs()).max(offset.abs()).max(travel.abs());
            if (position - (c.start + offset)).abs() > 1e-12 * size {
                c.start = position - offset;
            }
        }
        self
    }

    pub(super) fn set_load_kinks(&mut self, mut times: Vec<f64>) {
        times.sort_by(f64::total_cmp);
        times.dedup();
        self.kinks = times;
    }

    /// The times of the kinks of gravity and rest lengths, ascending, in s.
    pub fn load_kinks(&self) -> &[f64] {
        &self.kinks
    }

    /// True if any prescribed coordinate moves.
    pub fn moves(&self) -> bool {
        self.coordinates.iter().any(|c| self.motions[c.motion] != Motion::Held)
    }

    /// The motions, one for each constraint.
    pub fn motions(&self) -> &[Motion] {
        &self.motions
    }

    /// The times of all kinks of paths, gravity and rest lengths, ascending, in s.
    pub fn kinks(&self) -> Vec<f64> {
        let of_paths = self.motions.iter().flat_map(Motion::kinks);
        let mut kinks: Vec<f64> = self.kinks.iter().chain(of_paths).copied().collect();
        kinks.sort_by(f64::total_cmp);
        kinks
    }

    /// The first time after t at which a path, gravity or a rest length has a kink, in s.
    pub fn next_kink(&self, t: f64) -> Option<f64> {
        let after = |times: &[f64]| times.get(times.partition_point(|&time| time <= t)).copied();
        let of_paths = self.motions.iter().filter_map(|motion| after(motion.kinks()));
        of_paths.chain(after(&self.kinks)).min_by(f64::total_cmp)
    }

    /// The prescribed coordinates by particle, then axis, each with its start, in m, and the index of its motion.
    pub fn iter(&self) -> impl Iterator<Item = (Dof, f64, usize)> + '_ {
        self.coordinates.iter().map(|c| (c.dof, c.start, c.motion))
    }

    /// The number of prescribed coordinates.
    pub fn len(&self) -> usize {
        self.coordinates.len()
    }

    /// True if there are no prescribed coordinates.
    pub fn is_empty(&self) -> bool {
        self.coordinates.is_empty()
    }

    /// The position at time t of every prescribed coordinate.
    fn targets(&self, t: f64) -> impl Iterator<Item = (Dof, f64)> + '_ {
        self.coordinates.iter().map(move |c| (c.dof, c.start + self.motions[c.motion].offset(t, c.dof.axis)))
    }

    /// Sets the prescribed coordinates of full-length positions to their values at time t.
    pub fn set_positions(&self, t: f64, positions: &mut [Vector3<f64>]) {
        for (Dof { particle, axis }, target) in self.targets(t) {
            positions[particle][axis] = target;
        }
    }

    /// Sets the prescribed components of full-length velocities to their values just after time t.
    pub fn set_velocities(&self, t: f64, velocities: &mut [Vector3<f64>]) {
        for &Coordinate { dof: Dof { particle, axis }, motion, .. } in &self.coordinates {
            velocities[particle][axis] = self.motions[motion].velocity(t, axis);
        }
    }

    /// Sets the prescribed components of full-length velocities to the mean velocity from `positions` to the position at time t within dt seconds.
    pub fn set_mean_velocities(&self, t: f64, dt: f64, positions: &[Vector3<f64>], velocities: &mut [Vector3<f64>]) {
        for (Dof { particle, axis }, target) in self.targets(t) {
            velocities[particle][axis] = (target - positions[particle][axis]) / dt;
        }
    }

    /// Sets `displacement`, in m, to the displacement of every prescribed coordinate from `positions` to its position at time t, and to
    /// zero elsewhere (*Set-Boundary-Conditions* in the lecture notes).
    pub fn displacement(&self, t: f64, positions: &[Vector3<f64>], displacement: &mut [Vector3<f64>]) {
        displacement.fill(Vector3::zeros());
        for (Dof { particle, axis }, target) in self.targets(t) {
            displacement[particle][axis] = target - positions[particle][axis];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Axes, Constraint, Motion};
    use crate::system::fixtures::in_parts;
    use crate::system::{System, SystemBuilder};
    use nalgebra::Vector3;

    /// At 10, 30 and 40 s; along x 0.2 m/s and then −0.1, along y 0 and 0.6.
    fn path() -> Motion {
        let offsets = [[5.0, 1.0, 0.0], [9.0, 1.0, 0.0], [8.0, 7.0, 0.0]].map(Vector3::from);
        Motion::Path { times: vec![10.0, 30.0, 40.0], offsets: offsets.to_vec() }
    }

    #[test]
    fn paths_are_piecewise_linear_and_clamped() {
        let path = path();
        for (t, offset, velocity) in [
            (-20.0, [5.0, 1.0], [0.0, 0.0]),
            (10.0, [5.0, 1.0], [0.2, 0.0]),
            (15.0, [6.0, 1.0], [0.2, 0.0]),
            (30.0, [9.0, 1.0], [-0.1, 0.6]),
            (35.0, [8.5, 4.0], [-0.1, 0.6]),
            (40.0, [8.0, 7.0], [0.0, 0.0]),
            (90.0, [8.0, 7.0], [0.0, 0.0]),
        ] {
            assert_eq!([0, 1].map(|axis| path.offset(t, axis)), offset, "{t}");
            assert_eq!([0, 1].map(|axis| path.velocity(t, axis)), velocity, "{t}");
        }
        // A time within rounding of a kink counts as the kink.
        assert_eq!([5e-13, 5e-12].map(|off| path.velocity(30.0 * (1.0 - off), 0)), [-0.1, 0.2]);
    }

    /// Particle 1 follows the path along x, moves at 0.5 m/s along y and is held along z, as later constraints apply; particle 0 is free,
    /// particle 2 is held along z.
    fn system() -> System {
        let mut builder = SystemBuilder::new();
        for x in [-1.0, 1.0, 2.0] {
            builder.particle([x, 2.0, 3.0], 1.0);
        }
        let motions = [
            (vec![1], Axes::ALL, Motion::Velocity(Vector3::new(7.0, 0.5, 7.0))),
            (vec![1], Axes::of(&[0]), path()),
            (vec![1, 2], Axes::of(&[2]), Motion::Held),
        ];
        for (particles, axes, motion) in motions {
            builder.constrain(Constraint { particles, axes, motion });
        }
        builder.build().unwrap().0
    }

    #[test]
    fn prescribed_coordinates_follow_their_motions() {
        let system = system();
        let prescribed = system.prescribed();
        assert_eq!((prescribed.len(), prescribed.is_empty(), prescribed.motions().len()), (4, false, 3));
        let found: Vec<_> =
            prescribed.iter().map(|(dof, start, motion)| (dof.particle, dof.axis, start, motion)).collect();
        assert_eq!(found, [(1, 0, 1.0, 1), (1, 1, 2.0, 0), (1, 2, 3.0, 2), (2, 2, 3.0, 2)]);

        let nine = [Vector3::repeat(9.0); 3];
        let mut set = nine;
        prescribed.set_positions(15.0, &mut set);
        assert_eq!(set, [[9.0; 3], [7.0, 9.5, 3.0], [9.0, 9.0, 3.0]].map(Vector3::from));
        let mut set = nine;
        prescribed.set_velocities(15.0, &mut set);
        assert_eq!(set, [[9.0; 3], [0.2, 0.5, 0.0], [9.0, 9.0, 0.0]].map(Vector3::from));
        // From (8, 8, 8) to (7, 9.5, 3) and to z = 3: displacements, and over half a second velocities.
        let places = [Vector3::repeat(8.0); 3];
        let mut set = nine;
        prescribed.displacement(15.0, &places, &mut set);
        assert_eq!(set, [[0.0; 3], [-1.0, 1.5, -5.0], [0.0, 0.0, -5.0]].map(Vector3::from));
        let mut set = nine;
        prescribed.set_mean_velocities(15.0, 0.5, &places, &mut set);
        assert_eq!(set, [[9.0; 3], [-2.0, 3.0, -10.0], [9.0, 9.0, -10.0]].map(Vector3::from));
    }

    /// A path that a later constraint overrides has no kinks.
    #[test]
    fn kinks_are_those_of_paths_that_apply() {
        let system = system();
        let kinks = [0.0, 10.0, 29.0, 30.0, 40.0].map(|t| system.prescribed().next_kink(t));
        assert_eq!(kinks, [Some(10.0), Some(30.0), Some(30.0), Some(40.0), None]);
        assert!(system.prescribed().moves());
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        assert!(builder.clone().build().unwrap().0.prescribed().is_empty());
        let motion = Motion::Path { times: vec![0.0, 0.5], offsets: vec![Vector3::zeros(), Vector3::x()] };
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
        assert_eq!(builder.clone().build().unwrap().0.prescribed().next_kink(0.1), Some(0.5));
        builder.hold(0);
        let (system, _) = builder.build().unwrap();
        assert!(system.prescribed().next_kink(0.1).is_none() && !system.prescribed().moves());
    }

    /// A path that moves particle 0 alone: the other part of the system takes its steps by the same kinks.
    #[test]
    fn every_part_knows_all_kinks() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.0, 0.0, 0.0], 1.0);
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion: path() });
        let kinks =
            in_parts(&builder, 2, |p| p, |cut| (cut.system.prescribed().kinks(), cut.system.prescribed().moves()));
        assert_eq!(kinks, [true, false].map(|moves| (vec![10.0, 30.0, 40.0], moves)));
    }
}
