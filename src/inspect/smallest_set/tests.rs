//! Particles between walls, each with springs pressed from 1.25 m to 1 m: across, every spring takes 10 N/m, and m/dt² is the mass.

use super::{DropSet, is_affordable, smallest_set};
use crate::force::SpringGeometry;
use crate::inspect::Minimality;
use crate::spring::Spring;
use crate::system::{State, System, SystemBuilder};
use crate::work::Work;
use faer::Par;

/// A particle of each mass in the plane, with one or two springs.
fn particles(masses: &[(f64, usize)]) -> (System, State) {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    for (row, &(mass, springs)) in masses.iter().enumerate() {
        let y = 3.0 * row as f64;
        let free = builder.particle([0.0, y, 0.0], mass);
        for x in [-1.0, 1.0].into_iter().take(springs) {
            let wall = builder.particle([x, y, 0.0], 1.0);
            builder.hold(wall);
            builder.spring(free, wall, Spring { stiffness: 50.0, rest_length: 1.25, damping: 0.0 });
        }
    }
    builder.build().unwrap()
}

/// The set for a step of 1 s; symbolic analyses, assemblies, factorizations and solves.
fn set(masses: &[(f64, usize)]) -> (DropSet, [u64; 4]) {
    let (system, state) = particles(masses);
    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    let mut work = Work::default();
    let set = smallest_set(&system, &extensions, 1.0, Par::Seq, &mut work).unwrap();
    (set, [work.symbolic_factorizations, work.assemblies, work.factorizations, work.solves])
}

/// Where 10 N/m outweigh the mass, every spring is necessary; where 20 do, one of two; where not even these do, none.
#[test]
fn sets_and_their_work_are_those_by_hand() {
    let irredundant = Minimality::Irredundant;
    let (none, work) = set(&[(25.0, 2)]);
    assert_eq!((none.springs.len(), none.at_least, none.tension, work), (0, 0, 2, [1, 1, 1, 0]));
    // Refused, and proven to be enough.
    let (both, work) = set(&[(8.0, 2)]);
    assert_eq!((both.springs.as_slice(), both.at_least, both.minimality), ([0, 1].as_slice(), 2, irredundant));
    assert_eq!(work, [1, 2, 2, 0]);
    // Refused, enough by the local condition, a solve for one column, and the proof.
    let (one, work) = set(&[(15.0, 2)]);
    assert_eq!((one.springs.len(), one.at_least, one.minimality, work), (1, 1, irredundant, [1, 3, 3, 1]));
    // One is necessary; then two are still negative, which takes two of the four others.
    let (three, work) = set(&[(8.0, 1), (15.0, 2), (15.0, 2)]);
    assert_eq!((three.springs.len(), three.at_least, three.tension, three.is_smallest()), (3, 3, 5, true));
    assert_eq!((three.minimality, work), (irredundant, [1, 4, 6, 3]));
}

/// 600 terms are too many to tell which of them can be spared: three halvings find that fewer than 525 are not enough.
#[test]
fn sets_of_very_many_springs_are_enough_and_no_more_is_looked_for() {
    let (many, work) = set(&[(15.0, 2); 600]);
    assert_eq!((many.springs.len(), many.tension, many.minimality), (600, 1200, Minimality::Enough));
    assert_eq!(work, [1, 5, 5, 0]);
}

#[test]
fn a_set_is_smallest_where_no_fewer_springs_are_enough() {
    let of = |at_least| DropSet { springs: vec![3, 7], minimality: Minimality::Enough, at_least, tension: 9 };
    assert_eq!([1, 2, 3].map(|at_least| of(at_least).is_smallest()), [false, true, true]);
}

/// 128 terms are few enough to begin with all of them. Of 130, 121 of them necessary, the nine others are too few to be halved.
#[test]
fn a_wide_choice_is_halved() {
    let (half, work) = set(&[(15.0, 2); 128]);
    assert_eq!((half.springs.len(), work), (128, [1, 3, 3, 128]));
    let pairs = [[(8.0, 1); 121].as_slice(), &[(15.0, 2); 9]].concat();
    let (most, work) = set(&pairs);
    // Refused twice, counted once, enough by the local condition, and the proof.
    assert_eq!((most.springs.len(), most.at_least, work), (130, 130, [1, 4, 6, 130]));
}

/// Springs that can be told apart always, or with a factor of so many entries, or never.
#[test]
fn a_search_is_affordable_for_so_many_springs() {
    for (entries, most) in [(1, 500), (10_000_000, 500), (20_000_000, 250), (40_000_000, 125), (1_000_000_000, 32)] {
        assert!(is_affordable(most, entries) && !is_affordable(most + 1, entries), "{entries}");
    }
}

/// Particles on pressed springs that run askew, with masses below the rounding of the springs: without all that they take across A is singular
/// as far as can be told, so that nothing is known but that all have to go; one that is stretched takes nothing.
#[test]
fn where_rounding_hides_what_is_enough_all_are_named() {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    for row in 0..12 {
        let (y, angle) = (5.0 * row as f64, 0.1 + 0.11 * row as f64);
        let free = builder.particle([0.0, y, 0.0], 1e-18);
        let wall = builder.particle([f64::cos(angle), y + f64::sin(angle), 0.0], 1.0);
        builder.hold(wall);
        let rest_length = if row == 5 { 0.5 } else { 1.25 };
        builder.spring(free, wall, Spring { stiffness: 50.0, rest_length, damping: 0.0 });
    }
    let (system, state) = builder.build().unwrap();
    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    let set = smallest_set(&system, &extensions, 1.0, Par::Seq, &mut Work::default()).unwrap();
    let pressed: Vec<usize> = (0..12).filter(|&spring| spring != 5).collect();
    assert_eq!((set.springs, set.minimality, set.tension), (pressed, Minimality::Enough, 11));
}
