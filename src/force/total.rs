//! All forces at once, in one pass over the springs that keeps nothing: what explicit methods need.

use super::batch::{AddForces, Coincident, Ends};
use super::{DegenerateSpring, add_external_forces};
use crate::spring::{LawValues, Spring};
use crate::system::{StateView, System, ThreadPartition};
use nalgebra::Vector3;

/// Sets `force`, in N, to the sum of all forces on every particle: of springs, weight, and from outside.
///
/// # Errors
/// A spring whose ends coincide; `force` is then incomplete.
///
/// # Examples
/// ```
/// use nalgebra::Vector3;
/// use sprung::force::set_total_force;
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// # builder.gravity(0.0, -9.81, 0.0);
/// let (system, state) = builder.build()?;
/// let mut force = vec![Vector3::zeros(); system.particles()];
/// set_total_force(&system, &state.moment(), &mut force)?;
/// assert_eq!(force[1], Vector3::new(10.0, -9.81, 0.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn set_total_force(
    system: &System,
    at: &StateView<'_>,
    force: &mut [Vector3<f64>],
) -> Result<(), DegenerateSpring> {
    set_other_forces(system, at, force);
    let law = system.law_values(at.positions, at.time);
    if let Some(shares) = system.thread_partitions() {
        return add_shares(system, at, &law, &shares, force);
    }
    if system.has_spring_law() {
        return add_by_law(system, at, &law, system.active(), 0, force);
    }
    if has_only_active(system) {
        // Nothing is looked up that stands in order.
        return add(system, at, system.pairs().iter().copied().zip(system.springs()), 0, force);
    }
    add(system, at, system.active_springs().iter().map(|&number| numbered(system, number)), 0, force)
}

/// Whether every spring is active.
pub(super) fn has_only_active(system: &System) -> bool {
    system.active_springs().len() == system.springs().len()
}

fn numbered(system: &System, number: u32) -> Ends<'_> {
    (system.pairs()[number as usize], &system.springs()[number as usize])
}

/// Sets `force` to weights and what comes from outside: all but the forces of springs.
pub(crate) fn set_other_forces(system: &System, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
    let gravity = system.gravity();
    for (f, mass) in force.iter_mut().zip(system.masses()) {
        *f = gravity * *mass;
    }
    add_external_forces(system, at, force);
}

/// Adds the forces of springs to those of their ends that `total`, the particles from `first` on, holds.
fn add<'a>(
    system: &System,
    at: &'a StateView<'a>,
    springs: impl Iterator<Item = Ends<'a>>,
    first: usize,
    total: &'a mut [Vector3<f64>],
) -> Result<(), DegenerateSpring> {
    let added = pulp::Arch::new().dispatch(AddForces { at, springs, first, total });
    added.map_err(|Coincident| first_degenerate(system, at.positions))
}

/// Whether two particles lie at one place, or so near that the square of their distance is none.
pub(crate) fn coincide(positions: &[Vector3<f64>], [i, j]: [usize; 2]) -> bool {
    (positions[i] - positions[j]).norm_squared() == 0.0
}

/// The first spring whose ends coincide, where there is one.
#[cold]
pub(crate) fn first_degenerate(system: &System, positions: &[Vector3<f64>]) -> DegenerateSpring {
    let mut active = system.active().map(|(spring, pair, _)| (spring, pair));
    let (spring, pair) = active.find(|(_, pair)| coincide(positions, *pair)).unwrap_or_default();
    DegenerateSpring { spring, pair }
}

/// As [`add`], of springs that have a law of the caller's own.
fn add_by_law<'a>(
    system: &System,
    at: &StateView<'_>,
    law: &LawValues,
    mut springs: impl Iterator<Item = (usize, [usize; 2], &'a Spring)>,
    first: usize,
    total: &mut [Vector3<f64>],
) -> Result<(), DegenerateSpring> {
    springs.try_for_each(|(spring, [i, j], _)| {
        let f = by_law(system, at, law, spring, [i, j])?;
        if let Some(total) = total.get_mut(i.wrapping_sub(first)) {
            *total += f;
        }
        if let Some(total) = total.get_mut(j.wrapping_sub(first)) {
            *total -= f;
        }
        Ok(())
    })
}

/// The force on end i of a spring that has a law of the caller's own.
fn by_law(
    system: &System,
    at: &StateView<'_>,
    law: &LawValues,
    spring: usize,
    pair: [usize; 2],
) -> Result<Vector3<f64>, DegenerateSpring> {
    let [i, j] = pair;
    let extension = system.extension(spring, &at.positions[i], &at.positions[j]);
    let extension = extension.ok_or(DegenerateSpring { spring, pair })?;
    let parameters = system.spring_with(law, spring, extension.length, at.time);
    let mut tension = parameters.stiffness * parameters.strain(&extension);
    // Without damping velocities may be anything, infinite too.
    if parameters.damping > 0.0 && extension.length > 0.0 {
        tension += parameters.damping * extension.direction.dot(&(at.velocities[i] - at.velocities[j]));
    }
    Ok(extension.direction * -tension)
}

/// `total` holds the particles of these shares.
fn add_shares(
    system: &System,
    at: &StateView<'_>,
    law: &LawValues,
    shares: &[ThreadPartition],
    total: &mut [Vector3<f64>],
) -> Result<(), DegenerateSpring> {
    match shares {
        [] => Ok(()),
        [ThreadPartition { particles, springs }] => {
            let numbers = springs.iter().map(|&position| system.active_springs()[position as usize]);
            if system.has_spring_law() {
                let each = numbers.map(|number| number as usize);
                let each = each.map(|number| (number, system.pair(number), &system.springs()[number]));
                return add_by_law(system, at, law, each, particles.start, total);
            }
            add(system, at, numbers.map(|number| numbered(system, number)), particles.start, total)
        }
        [first, ..] => {
            let (left, right) = shares.split_at(shares.len() / 2);
            let boundary = right.first().map_or(0, |share| share.particles.start - first.particles.start);
            let (low, high) = total.split_at_mut(boundary);
            let (low, high) =
                rayon::join(|| add_shares(system, at, law, left, low), || add_shares(system, at, law, right, high));
            low.and(high)
        }
    }
}

#[cfg(all(test, feature = "scene"))]
mod tests {
    use super::set_total_force;
    use crate::force::{SpringGeometry, add_damping_force, add_elastic_force, add_weight};
    use crate::scene::builtin::{Kind, builtin};
    use crate::spring::{Spring, SpringLaw, Tension};
    use crate::system::SystemBuilder;
    use nalgebra::Vector3;

    /// The sum of the three forces, to rounding, on one thread and on several; a lattice of 16³ has enough springs for these.
    #[test]
    fn all_forces_are_the_sum_of_each() {
        let (system, mut state) = builtin(Kind::Lattice, 16).unwrap().build().unwrap();
        for (p, (x, v)) in state.positions.iter_mut().zip(&mut state.velocities).enumerate() {
            *x *= 1.0 + 0.01 * (p % 5) as f64;
            *v = Vector3::new((p % 3) as f64, (p % 7) as f64, -1.0);
        }
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let one_by_one = || {
            let mut sum = vec![Vector3::zeros(); system.particles()];
            add_elastic_force(&system, &extensions, &mut sum);
            add_damping_force(&system, &extensions, &state.velocities, &mut sum);
            add_weight(&system, &mut sum);
            sum
        };
        let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let expected = pool(1).install(one_by_one);
        let largest = expected.iter().map(Vector3::amax).fold(0.0, f64::max);
        let mut all = Vec::new();
        for threads in [1, 2, 3] {
            let mut force = vec![Vector3::repeat(7.0); system.particles()];
            pool(threads).install(|| {
                assert_eq!(system.thread_partitions().map_or(1, |shares| shares.len()), threads);
                assert_eq!(one_by_one(), expected, "the number of threads is in the sum of each");
                set_total_force(&system, &state.moment(), &mut force).unwrap();
            });
            for (f, expected) in force.iter().zip(&expected) {
                assert!((f - expected).amax() <= 1e-14 * largest, "{f} {expected}");
            }
            all.push(force);
        }
        assert!(all.iter().all(|force| *force == all[0]), "the number of threads is in the result");
    }

    /// Without damping a velocity has no force, whatever it is.
    #[test]
    fn velocities_count_with_damping_alone() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.particle([2.0, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 3.0, rest_length: 1.0, damping: 0.0 });
        let (system, mut state) = builder.build().unwrap();
        state.velocities[1].x = f64::INFINITY;
        let mut force = [Vector3::zeros(); 2];
        set_total_force(&system, &state.moment(), &mut force).unwrap();
        assert_eq!(force, [Vector3::new(3.0, 0.0, 0.0), Vector3::new(-3.0, 0.0, 0.0)]);
    }

    /// One spring, and two of which either would make up for the other if they were counted by halves.
    #[test]
    fn coincident_ends_are_named() {
        let mut builder = SystemBuilder::new();
        for x in [0.0, 1.0, 3.0, 4.0] {
            builder.particle([x, 0.0, 0.0], 1.0);
        }
        for pair in [[0, 1], [1, 2], [2, 3]] {
            builder.spring(pair[0], pair[1], Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        }
        let (system, mut state) = builder.build().unwrap();
        for particle in [2, 3] {
            state.positions[particle] = state.positions[1];
            for system in [system.clone(), system.clone().with_spring_law(Square)] {
                let mut force = [Vector3::zeros(); 4];
                let failure = set_total_force(&system, &state.moment(), &mut force).unwrap_err();
                assert_eq!((failure.spring, failure.pair), (1, [1, 2]));
            }
        }
    }

    /// Pulls with l² N.
    #[derive(Debug)]
    struct Square;

    impl SpringLaw for Square {
        fn tension(&self, _: usize, _: &Spring, length: f64) -> Tension {
            Tension { force: length * length, slope: 2.0 * length }
        }

        fn energy(&self, _: usize, _: &Spring, length: f64) -> f64 {
            length.powi(3) / 3.0
        }
    }

    /// A damped spring of 2 m whose ends part with 4 m/s, 4 + 2·4 = 12 N, and one of 3 m without damping, 9 N, whatever its other end
    /// does; forces from outside are there before.
    #[test]
    fn laws_of_the_caller_pull_at_both_ends() {
        let mut builder = SystemBuilder::new();
        for y in [0.0, 2.0, 5.0] {
            builder.particle([0.0, y, 0.0], 1.0);
        }
        for (i, damping) in [(0, 2.0), (1, 0.0)] {
            builder.spring(i, i + 1, Spring { stiffness: 7.0, rest_length: 1.0, damping });
        }
        builder.gravity(1.0, 0.0, 0.0);
        let (system, mut state) = builder.build().unwrap();
        let system = system.with_spring_law(Square);
        for (velocity, y) in state.velocities.iter_mut().zip([-1.0, 3.0, f64::INFINITY]) {
            velocity.y = y;
        }
        let mut force = [Vector3::zeros(); 3];
        set_total_force(&system, &state.moment(), &mut force).unwrap();
        for (force, y) in force.iter().zip([12.0, -3.0, -9.0]) {
            assert!((force - Vector3::new(1.0, y, 0.0)).amax() < 1e-12, "{force}");
        }
    }
}
