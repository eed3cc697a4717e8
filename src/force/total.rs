//! Loops over the active springs that add forces to their ends.

use super::batch::{Accumulator, AddForces, Coincident};
use super::{DegenerateSpring, SpringGeometry, add_external_forces};
use crate::spring::{Extension, LawValues, Spring};
use crate::system::{StateView, System, ThreadPartition};
use nalgebra::Vector3;
use std::convert::Infallible;

/// Adds a force on end i of every active spring with ends [i, j], and its opposite on end j.
pub(super) fn add_pair_forces(
    system: &System,
    extensions: &SpringGeometry,
    total: &mut [Vector3<f64>],
    force: &(impl Fn(&Spring, [usize; 2], &Extension) -> Option<Vector3<f64>> + Sync),
) {
    let Some(partitions) = system.thread_partitions() else {
        return add_pairs_of(system, extensions, 0..system.active_springs().len(), 0, total, force);
    };
    let Ok(()) = for_each_partition(&partitions, total, &|partition, total| {
        let positions = partition.springs.iter().map(|&position| position as usize);
        add_pairs_of(system, extensions, positions, partition.particles.start, total, force);
        Ok::<(), Infallible>(())
    });
}

/// Adds the pair forces of the springs at some positions among the active ones to their ends in `total`, the particles from `first` on.
#[inline(always)]
fn add_pairs_of(
    system: &System,
    extensions: &SpringGeometry,
    positions: impl Iterator<Item = usize>,
    first: usize,
    total: &mut [Vector3<f64>],
    force: &impl Fn(&Spring, [usize; 2], &Extension) -> Option<Vector3<f64>>,
) {
    let mut accumulator = Accumulator::new();
    for position in positions {
        let pair = system.pairs()[system.active_springs()[position] as usize];
        let (spring, at) = (extensions.spring(system, position), &extensions.as_slice()[position]);
        if let Some(f) = force(spring, pair.map(|end| end as usize), at) {
            accumulator.add(pair, &f, first, total);
        }
    }
    accumulator.flush(first, total);
}

fn for_each_partition<E: Send>(
    partitions: &[ThreadPartition],
    total: &mut [Vector3<f64>],
    add: &(impl Fn(&ThreadPartition, &mut [Vector3<f64>]) -> Result<(), E> + Sync),
) -> Result<(), E> {
    match partitions {
        [] => Ok(()),
        [partition] => add(partition, total),
        [first, ..] => {
            let (left, right) = partitions.split_at(partitions.len() / 2);
            let boundary = right.first().map_or(0, |other| other.particles.start - first.particles.start);
            let (low, high) = total.split_at_mut(boundary);
            let (low, high) =
                rayon::join(|| for_each_partition(left, low, add), || for_each_partition(right, high, add));
            low.and(high)
        }
    }
}

/// Sets `force`, in N, to the sum of spring forces, weight and external forces on every particle.
///
/// # Errors
/// A spring with coincident ends; `force` is then incomplete.
pub fn set_total_force(
    system: &System,
    at: &StateView<'_>,
    force: &mut [Vector3<f64>],
) -> Result<(), DegenerateSpring> {
    set_other_forces(system, at, force);
    let law = system.law_values(at.positions, at.time);
    let Some(partitions) = system.thread_partitions() else {
        return add_springs(system, at, &law, system.active_springs().iter().copied(), 0, force);
    };
    for_each_partition(&partitions, force, &|partition, total| {
        let numbers = partition.springs.iter().map(|&position| system.active_springs()[position as usize]);
        add_springs(system, at, &law, numbers, partition.particles.start, total)
    })
}

/// Sets `force` to weight and external forces.
pub(crate) fn set_other_forces(system: &System, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
    let gravity = system.gravity();
    for (f, mass) in force.iter_mut().zip(system.masses()) {
        *f = gravity * *mass;
    }
    add_external_forces(system, at, force);
}

/// Adds the forces of some springs to their ends in `total`, the particles from `first` on.
fn add_springs(
    system: &System,
    at: &StateView<'_>,
    law: &LawValues,
    numbers: impl Iterator<Item = u32>,
    first: usize,
    total: &mut [Vector3<f64>],
) -> Result<(), DegenerateSpring> {
    if !system.has_spring_law() {
        let springs = numbers.map(|number| (system.pairs()[number as usize], &system.springs()[number as usize]));
        let added = pulp::Arch::new().dispatch(AddForces { at, springs, first, total });
        return added.map_err(|Coincident| first_degenerate(system, at.positions));
    }
    let mut accumulator = Accumulator::new();
    for spring in numbers.map(|number| number as usize) {
        let pair = system.pair(spring);
        let [i, j] = pair;
        let extension = system.extension(spring, &at.positions[i], &at.positions[j]);
        let extension = extension.ok_or(DegenerateSpring { spring, pair })?;
        let parameters = system.spring_with(law, spring, extension.length, at.time);
        let mut tension = parameters.stiffness * parameters.strain(&extension);
        // Without damping, infinite velocities must not matter.
        if parameters.damping > 0.0 && extension.length > 0.0 {
            tension += parameters.damping * extension.direction.dot(&(at.velocities[i] - at.velocities[j]));
        }
        accumulator.add(system.pairs()[spring], &(extension.direction * -tension), first, total);
    }
    accumulator.flush(first, total);
    Ok(())
}

/// True if the squared distance of two particles is zero or underflows.
pub(super) fn coincide(positions: &[Vector3<f64>], [i, j]: [usize; 2]) -> bool {
    (positions[i] - positions[j]).norm_squared() == 0.0
}

/// The first active spring with coincident ends.
#[cold]
pub(super) fn first_degenerate(system: &System, positions: &[Vector3<f64>]) -> DegenerateSpring {
    let mut active = system.active().map(|(spring, pair, _)| (spring, pair));
    let (spring, pair) = active.find(|(_, pair)| coincide(positions, *pair)).unwrap_or_default();
    DegenerateSpring { spring, pair }
}

#[cfg(test)]
mod tests {
    use super::set_total_force;
    use crate::force::{SpringGeometry, add_damping_force, add_elastic_force, add_weight};
    use crate::spring::{Spring, SpringLaw, Tension};
    use crate::system::{SystemBuilder, fixtures};
    use nalgebra::Vector3;

    /// The sum of the three forces to rounding, and the same bits on one thread and on several.
    #[test]
    fn total_force_is_the_sum_of_its_parts() {
        let (system, mut state) = fixtures::row(25_000);
        let damped = system.springs().iter().map(|spring| Spring { damping: 0.3, ..*spring });
        let system = system.with_springs(damped.collect()).unwrap();
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
                assert_eq!(system.thread_partitions().map_or(1, |several| several.len()), threads);
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

    #[test]
    fn infinite_velocities_do_not_matter_without_damping() {
        let (system, mut state) =
            fixtures::tethered(2.0, 1.0, Spring { stiffness: 3.0, rest_length: 1.0, damping: 0.0 });
        state.velocities[1].x = f64::INFINITY;
        let mut force = [Vector3::zeros(); 2];
        set_total_force(&system, &state.moment(), &mut force).unwrap();
        assert_eq!(force, [Vector3::new(3.0, 0.0, 0.0), Vector3::new(-3.0, 0.0, 0.0)]);
    }

    #[test]
    fn coincident_ends_are_named() {
        let (system, mut state) = fixtures::row(4);
        for particle in [2, 3] {
            state.positions[particle] = state.positions[1];
            for system in [system.clone(), system.clone().with_spring_law(Square)] {
                let mut force = [Vector3::zeros(); 4];
                let failure = set_total_force(&system, &state.moment(), &mut force).unwrap_err();
                assert_eq!((failure.spring, failure.pair), (1, [1, 2]));
            }
        }
    }

    /// A tension of l² N.
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

    /// A damped spring of 2 m that lengthens by 4 m/s, 4 + 2·4 = 12 N, and an undamped one of 3 m, 9 N, with an infinite velocity.
    #[test]
    fn spring_laws_act_on_both_ends() {
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
