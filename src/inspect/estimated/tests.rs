//! What an inspection without a factorization tells, part after part.

use super::ROW;
use crate::inspect::fixtures::{pin, pinned};
use crate::inspect::tests::{chain, step_for};
use crate::inspect::{Inspection, LargestStep, Part, Why};
use crate::memory::watch::asked;
use crate::spring::Stiffness;
use crate::system::{State, System, SystemBuilder};

/// What is found, and after which shares of the work something was told, with the number of spectra that were known then.
fn estimated((system, state): &(System, State), dt: f64, option: Stiffness) -> (Inspection, Vec<(f64, usize)>) {
    let mut seen = Vec::new();
    let mut onlooker = |share: f64, found: &Inspection| {
        let known = Stiffness::ALL.into_iter().filter(|&each| !found.lacks(Part::Spectrum(each)));
        seen.push((share, known.count()));
        // The option that was asked for comes first.
        assert!(seen.len() == 1 && share < 0.2 || !found.lacks(Part::Spectrum(option)));
    };
    let found = Inspection::estimated(system, state, dt, option, Why::TooMuchWork, &mut onlooker).unwrap();
    (found, seen)
}

/// An answer that is proven at once is told before all else, then follow the three spectra, that of the option first.
#[test]
fn what_is_known_is_told_part_by_part() {
    for (rest_length, inertia, is_proven) in [(1.25, 15.0, true), (1.25, 60.0, false), (0.5, 15.0, true)] {
        let held = chain(20, rest_length);
        for option in Stiffness::ALL {
            let (found, seen) = estimated(&held, step_for(inertia), option);
            let is_proven = is_proven || option != Stiffness::Full;
            let expected = [(0.1, 0), (0.4, 1), (0.7, 2), (1.0, 3)];
            let expected = &expected[usize::from(!is_proven)..];
            assert_eq!(seen.len(), expected.len(), "{seen:?}");
            for ((share, known), expected) in seen.into_iter().zip(expected) {
                assert!((share - expected.0).abs() < 1e-12 && known == expected.1, "{share} {known}");
            }
            // A of the first answer, and under every option.
            assert_eq!((found.work.assemblies, found.work.factorizations), (4, 0));
        }
    }
}

/// Three vectors are looked for, all of which curve downwards; of those that do not only the lowest is taken apart.
#[test]
fn directions_of_negative_curvature_are_taken_apart() {
    let (found, _) = estimated(&chain(130, 1.25), step_for(1.0), Stiffness::Full);
    assert!(found.directions.len() == 3 && found.directions.iter().all(|direction| direction.eigenvalue < 0.0));
    assert!(!found.clusters.is_empty());
    let (found, _) = estimated(&chain(20, 1.25), step_for(60.0), Stiffness::Full);
    assert!(found.directions.len() == 1 && found.directions[0].eigenvalue > 0.0 && found.clusters.is_empty());
}

/// An eigenvalue of exactly zero is not negative: m/dt² is what the spring takes, and of a particle at rest in nothing with an endless step all is zero.
#[test]
fn zero_is_not_negative() {
    let (found, _) = estimated(&pinned(&[pin(10.0, 10.0)]), 1.0, Stiffness::Full);
    assert_eq!((found.directions[0].eigenvalue, found.directions[0].culprits.len()), (0.0, 1));
    assert!(found.clusters.is_empty() && found.is_definite());
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    builder.particle([0.0; 3], 1.0);
    let (found, _) = estimated(&builder.build().unwrap(), 1e200, Stiffness::Full);
    assert_eq!((found.examined().smallest, found.directions.len()), (0.0, 1));
}

/// Without compressed springs nothing grows; without stretched ones nothing is left to the old positions under `Axial`.
#[test]
fn springs_settle_what_they_can() {
    let [full, tension, axial] = Stiffness::ALL;
    for (rest_length, is_stretched) in [(0.5, true), (1.25, false)] {
        for inertia in [30.0, 1e-12] {
            let (found, _) = estimated(&chain(3, rest_length), step_for(inertia), full);
            let settled = |parts: &[Part], expected: bool| {
                for &part in parts {
                    assert_eq!(!found.lacks(part), expected, "{part:?} {rest_length} {inertia}");
                }
            };
            settled(&[Part::GrowingModes, Part::SmallestSet, Part::Stable(full)], is_stretched);
            settled(&[Part::Stable(axial)], !is_stretched);
            settled(&[Part::Stable(tension), Part::Definite(tension), Part::Definite(axial)], true);
            // Too little inertia beside the springs proves nothing.
            settled(&[Part::Definite(full)], is_stretched && inertia > 1.0);
            let every = |is_every: bool| if is_every { LargestStep::Every } else { LargestStep::Unknown };
            let [of_full, of_tension, of_axial] = &found.options;
            assert_eq!([of_full.critical, of_full.stable], [every(is_stretched); 2]);
            assert_eq!([of_tension.critical, of_tension.stable, of_axial.critical], [every(true); 3]);
            assert_eq!(of_axial.stable, every(!is_stretched));
        }
    }
}

/// Fifty numbers a row.
#[test]
fn memory_is_asked_for_before() {
    let (_, asked) = asked("an estimate of eigenvalues", || estimated(&chain(20, 0.5), 0.1, Stiffness::Full));
    assert_eq!((asked, ROW), (40 * 400, 400));
}
