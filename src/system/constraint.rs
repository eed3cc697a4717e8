//! Kinematic particles: which coordinates are prescribed, and how they move.

use super::curve::SAME_TIME;
use super::{Axes, Dof};
use nalgebra::Vector3;

/// How prescribed coordinates move, as an offset from where they start.
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
    /// Offset along one axis at time t, in m.
    pub fn offset(&self, t: f64, axis: usize) -> f64 {
        match self {
            Self::Held => 0.0,
            Self::Velocity(v) => t * v[axis],
            Self::Path { times, offsets } => match times.partition_point(|&time| time <= t) {
                0 => offsets[0][axis],
                next if next == times.len() => offsets[next - 1][axis],
                next => {
                    let (t0, t1) = (times[next - 1], times[next]);
                    let (x0, x1) = (offsets[next - 1][axis], offsets[next][axis]);
                    x0 + (x1 - x0) * ((t - t0) / (t1 - t0))
                }
            },
        }
    }

    /// Velocity along one axis just after time t (the right derivative of the offset), in m/s. A time within rounding of a
    /// kink is the kink: after seven steps of 0.01 s a sum of steps is a little less than 0.07 s.
    pub fn velocity(&self, t: f64, axis: usize) -> f64 {
        match self {
            Self::Held => 0.0,
            Self::Velocity(v) => v[axis],
            Self::Path { times, offsets } => match times.partition_point(|&time| time <= t + SAME_TIME * t.abs()) {
                next if next == 0 || next == times.len() => 0.0,
                next => (offsets[next][axis] - offsets[next - 1][axis]) / (times[next] - times[next - 1]),
            },
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
    /// How they move.
    pub motion: Motion,
}

impl Constraint {
    /// Holds all axes of some particles where they are.
    pub fn hold(particles: impl IntoIterator<Item = usize>) -> Self {
        Self { particles: particles.into_iter().collect(), axes: Axes::ALL, motion: Motion::Held }
    }
}

/// All prescribed coordinates, each with its start and its motion.
#[derive(Debug, Clone, Default)]
pub struct Prescribed {
    pub(super) motions: Vec<Motion>,
    pub(super) coordinates: Vec<Coordinate>,
    /// When something else has a kink, in s.
    kinks: Vec<f64>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Coordinate {
    pub particle: u32,
    pub axis: u8,
    pub motion: u32,
    pub start: f64,
}

impl Coordinate {
    pub fn dof(&self) -> Dof {
        Dof { particle: self.particle as usize, axis: usize::from(self.axis) }
    }
}

impl Prescribed {
    /// Resolves constraints, the last one that names a coordinate deciding; returns also every particle's
    /// prescribed axes. `positions` are those at time zero.
    pub(super) fn new(constraints: Vec<Constraint>, positions: &[Vector3<f64>], modelled: Axes) -> (Self, Vec<Axes>) {
        let mut deciding = std::collections::BTreeMap::new();
        for (index, constraint) in constraints.iter().enumerate() {
            for &particle in &constraint.particles {
                for axis in constraint.axes.iter().filter(|&axis| modelled.contains(axis)) {
                    deciding.insert((particle, axis), index);
                }
            }
        }
        let mut axes = vec![Axes::NONE; positions.len()];
        let mut coordinates = Vec::with_capacity(deciding.len());
        for ((particle, axis), motion) in deciding {
            axes[particle] = axes[particle].with(axis);
            let start = positions[particle][axis];
            coordinates.push(Coordinate { particle: particle as u32, axis: axis as u8, motion: motion as u32, start });
        }
        // A motion that later constraints override everywhere moves nothing, and its kinks are none.
        let is_used = |index: usize| coordinates.iter().any(|c: &Coordinate| c.motion as usize == index);
        let used =
            |(index, constraint): (usize, Constraint)| if is_used(index) { constraint.motion } else { Motion::Held };
        let motions = constraints.into_iter().enumerate().map(used).collect();
        (Self { motions, coordinates, kinks: Vec::new() }, axes)
    }

    /// These and more coordinates, which are held where `positions` have them.
    pub(super) fn with_held(&self, held: &[Dof], positions: &[Vector3<f64>]) -> Self {
        let mut coordinates = self.coordinates.clone();
        let motion = self.motions.len() as u32;
        coordinates.extend(held.iter().map(|dof| Coordinate {
            particle: dof.particle as u32,
            axis: dof.axis as u8,
            motion,
            start: positions[dof.particle][dof.axis],
        }));
        // The sort is stable: of two entries for one coordinate the older one stays.
        coordinates.sort_by_key(|c| (c.particle, c.axis));
        coordinates.dedup_by_key(|c| (c.particle, c.axis));
        let motions = self.motions.iter().cloned().chain([Motion::Held]).collect();
        Self { motions, coordinates, kinks: self.kinks.clone() }
    }

    /// Makes known when what is no path has kinks: gravity, rest lengths.
    pub(super) fn add_kinks(&mut self, times: &[f64]) {
        self.kinks.extend_from_slice(times);
        self.kinks.sort_by(f64::total_cmp);
    }

    /// Whether any prescribed coordinate ever moves.
    pub fn moves(&self) -> bool {
        self.coordinates.iter().any(|c| self.motions[c.motion as usize] != Motion::Held)
    }

    /// The motions, one for each constraint.
    pub fn motions(&self) -> &[Motion] {
        &self.motions
    }

    /// The first time after t at which a path has a kink, in s, where prescribed velocities jump; or gravity or a rest length has.
    pub fn next_kink(&self, t: f64) -> Option<f64> {
        let after = |times: &[f64]| times.get(times.partition_point(|&time| time <= t)).copied();
        let first = |motion: &Motion| match motion {
            Motion::Path { times, .. } => after(times),
            Motion::Held | Motion::Velocity(_) => None,
        };
        self.motions.iter().filter_map(first).chain(after(&self.kinks)).min_by(f64::total_cmp)
    }

    /// Every prescribed coordinate by particle, then axis: with its start, in m, and the index of its motion.
    pub fn iter(&self) -> impl Iterator<Item = (Dof, f64, usize)> + '_ {
        self.coordinates.iter().map(|c| (c.dof(), c.start, c.motion as usize))
    }

    /// Number of prescribed coordinates.
    pub fn len(&self) -> usize {
        self.coordinates.len()
    }

    /// Whether there is no prescribed coordinate.
    pub fn is_empty(&self) -> bool {
        self.coordinates.is_empty()
    }

    /// Sets the prescribed coordinates of full-length positions to their values at time t.
    pub fn set_positions(&self, t: f64, positions: &mut [Vector3<f64>]) {
        for c in &self.coordinates {
            let axis = c.axis as usize;
            positions[c.particle as usize][axis] = c.start + self.motions[c.motion as usize].offset(t, axis);
        }
    }

    /// Sets the prescribed components of full-length velocities to their values just after time t.
    pub fn set_velocities(&self, t: f64, velocities: &mut [Vector3<f64>]) {
        for c in &self.coordinates {
            let axis = c.axis as usize;
            velocities[c.particle as usize][axis] = self.motions[c.motion as usize].velocity(t, axis);
        }
    }

    /// Sets the prescribed components of full-length velocities to the constant velocity that leads from `positions` to the
    /// motion's place at time t within dt seconds.
    pub fn set_mean_velocities(&self, t: f64, dt: f64, positions: &[Vector3<f64>], velocities: &mut [Vector3<f64>]) {
        for c in &self.coordinates {
            let (particle, axis) = (c.particle as usize, c.axis as usize);
            let target = c.start + self.motions[c.motion as usize].offset(t, axis);
            velocities[particle][axis] = (target - positions[particle][axis]) / dt;
        }
    }

    /// Writes the displacement of every prescribed coordinate from `positions` to its place at time t into
    /// `displacement`, in m, and zero into every other entry (*Set-Boundary-Conditions* in the lecture notes).
    pub fn displacement(&self, t: f64, positions: &[Vector3<f64>], displacement: &mut [Vector3<f64>]) {
        displacement.fill(Vector3::zeros());
        for c in &self.coordinates {
            let (particle, axis) = (c.particle as usize, c.axis as usize);
            let target = c.start + self.motions[c.motion as usize].offset(t, axis);
            displacement[particle][axis] = target - positions[particle][axis];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Axes, Constraint, Motion};
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
        // A sum of steps that ends just before a kink is at it, one that ends clearly before is not.
        assert_eq!([5e-13, 5e-12].map(|off| path.velocity(30.0 * (1.0 - off), 0)), [-0.1, 0.2]);
    }

    /// Particle 1 follows the path along x, moves at 0.5 m/s along y and, as the later word counts, is held along z; particle 0 is free,
    /// particle 2 is on a rail of its own.
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

    #[test]
    fn kinks_are_those_of_paths_and_what_is_held_does_not_move() {
        let system = system();
        let kinks = [0.0, 10.0, 29.0, 30.0, 40.0].map(|t| system.prescribed().next_kink(t));
        assert_eq!(kinks, [Some(10.0), Some(30.0), Some(30.0), Some(40.0), None]);
        assert!(system.prescribed().moves());
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        assert!(builder.clone().build().unwrap().0.prescribed().is_empty());
        builder.hold(0);
        assert!(!builder.build().unwrap().0.prescribed().moves());
    }

    /// The path of a particle that is held by a later constraint moves nothing.
    #[test]
    fn paths_that_are_overridden_have_no_kinks() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        let motion = Motion::Path { times: vec![0.0, 0.5], offsets: vec![Vector3::zeros(), Vector3::x()] };
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
        assert_eq!(builder.clone().build().unwrap().0.prescribed().next_kink(0.1), Some(0.5));
        builder.hold(0);
        assert_eq!(builder.build().unwrap().0.prescribed().next_kink(0.1), None);
    }
}
