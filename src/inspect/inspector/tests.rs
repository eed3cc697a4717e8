//! What an inspection looks at, what that costs, and what it keeps for later.

use super::{Inspector, examined_pairs};
use crate::inspect::fixtures::{pin, pinned};
use crate::inspect::search::LARGE;
use crate::inspect::tests::{chain, step_for};
use crate::inspect::{Inspection, LargestStep, Part, Why};
use crate::spring::{Spring, Stiffness};
use crate::system::{State, System, SystemBuilder};
use faer::Par;

const FULL: Stiffness = Stiffness::Full;

fn inspector((system, state): &(System, State), dt: f64, option: Stiffness) -> Inspector<'_> {
    Inspector::new(system, state, dt, option, Par::Seq, f64::INFINITY).unwrap()
}

#[test]
fn so_many_pairs_are_examined() {
    assert_eq!([0, 12, 13, 24, 25].map(|negative| examined_pairs(LARGE - 1, negative)), [12, 12, 13, 24, 24]);
    assert_eq!([0, 25].map(|negative| examined_pairs(LARGE, negative)), [6, 6]);
}

/// What costs too much is left out; estimates take its place only where the first answer costs too much, and they do not.
#[test]
fn estimates_take_the_place_of_what_costs_too_much() {
    let within = |(system, state): &(System, State), most: f64| {
        Inspection::within(system, state, 0.1, FULL, Par::Seq, most, &mut |_, _| ()).unwrap()
    };
    // Every particle of 36 with every other: a factorization takes about 400,000 operations, an estimate 20 million.
    let mut builder = SystemBuilder::new();
    for p in 0..36 {
        let at = |k: usize| ((p * k) % 37) as f64 / 37.0;
        builder.particle([at(3), at(5), at(7)], 1.0);
        for other in 0..p {
            builder.spring(other, p, Spring { stiffness: 5.0, rest_length: 0.5, damping: 0.0 });
        }
    }
    let found = within(&builder.build().unwrap(), 2.5e5);
    assert!(found.estimated.is_empty() && found.lacks(Part::FirstAnswer) && found.first.is_none());
    // A factorization of a chain costs less than 10⁵ operations, an estimate 52 million, its spectrum more.
    let long = chain(130, 0.5);
    for most in [1e3, 1e5, 1e8] {
        let found = within(&long, most);
        assert!(found.estimated.is_empty() && found.left_out_for(Why::TooMuchWork).next().is_some(), "{most}");
        assert_eq!(found.lacks(Part::FirstAnswer), most < 1e4);
    }
}

/// A compressed spring does no harm where others hold its ends: no mode grows, and that is known.
#[test]
fn a_count_of_no_growing_modes_is_known() {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    let free = builder.particle([0.0; 3], 1.0);
    for ([x, y], rest_length) in [([1.0, 0.0], 1.25), ([0.0, 1.0], 0.5)] {
        let wall = builder.particle([x, y, 0.0], 1.0);
        builder.hold(wall);
        builder.spring(free, wall, Spring { stiffness: 50.0, rest_length, damping: 0.0 });
    }
    let held = builder.build().unwrap();
    let mut inspector = inspector(&held, 0.1, FULL);
    inspector.look(Part::GrowingModes).unwrap();
    assert_eq!((inspector.found.growing_modes, inspector.known().curves_downwards), (0, Some(false)));
    assert_eq!(inspector.work.assemblies, 1);
    inspector.look(Part::Definite(FULL)).unwrap();
    assert_eq!(inspector.found.options[0].critical, LargestStep::Every);
    let held = pinned(&[pin(1.0, 3.0)]);
    let mut inspector = self::inspector(&held, 0.1, FULL);
    inspector.look(Part::GrowingModes).unwrap();
    assert_eq!((inspector.found.growing_modes, inspector.known().curves_downwards), (1, Some(true)));
}

/// A factorization that refuses A is no factor of it.
#[test]
fn a_refused_factorization_is_not_kept() {
    let held = chain(400, 1.25);
    let highest = 4.0 * (400.0 * std::f64::consts::PI / 802.0).sin().powi(2);
    for (inertia, factored) in [(10.0 * highest - 1e-7, None), (10.0 * highest + 1e-7, Some(FULL))] {
        let mut inspector = inspector(&held, step_for(inertia), FULL);
        inspector.look(Part::FirstAnswer).unwrap();
        assert_eq!((inspector.work.factorizations, inspector.factored), (1, factored));
        assert_eq!(inspector.found.first.as_ref().map(|first| first.definite), Some(factored.is_some()));
    }
}

/// What one option's spectrum says of the others: assemblies of A, and whether an upper end of all spectra is known afterwards. A larger matrix
/// is made only for one that is searched, and that is not the largest itself.
#[test]
fn an_upper_end_of_all_spectra_is_looked_for_once() {
    let looked = |free: usize, rest_length: f64, examined: Stiffness, option: Stiffness| {
        let held = chain(free, rest_length);
        let mut inspector = inspector(&held, step_for(60.0), examined);
        inspector.look(Part::Signs(option)).unwrap();
        let before = inspector.work.assemblies;
        inspector.look(Part::Spectrum(option)).unwrap();
        (inspector.work.assemblies - before, inspector.ceiling.is_finite())
    };
    let [full, tension, axial] = Stiffness::ALL;
    // 260 rows are searched, 240 diagonalised.
    assert_eq!(looked(130, 1.25, full, full), (2, true));
    assert_eq!(looked(120, 1.25, full, full), (1, false));
    assert_eq!(looked(130, 1.25, axial, axial), (2, true));
    assert_eq!(looked(130, 1.25, full, axial), (1, false));
    assert_eq!(looked(130, 1.25, tension, tension), (1, true));
    assert_eq!(looked(130, 1.25, full, tension), (1, true));
    assert_eq!(looked(130, 0.5, full, full), (1, true));
    assert_eq!(looked(130, 0.5, tension, full), (1, true));
    assert_eq!(looked(130, 0.5, axial, axial), (2, true));
}

/// Where nothing is compressed there is nothing to drop: `Tension` is told as `Full` is, without another look, and `Axial` is not.
#[test]
fn tension_is_full_where_nothing_is_compressed() {
    let held = chain(7, 0.5);
    for (rest_length, examined, assemblies) in [(0.5, FULL, 0), (0.5, Stiffness::Axial, 1), (1.25, FULL, 1)] {
        let held = chain(7, rest_length);
        let mut inspector = inspector(&held, step_for(33.0), examined);
        inspector.look(Part::Spectrum(FULL)).unwrap();
        let before = inspector.work.assemblies;
        inspector.look(Part::Spectrum(Stiffness::Tension)).unwrap();
        assert_eq!(inspector.work.assemblies - before, assemblies);
        let [full, tension, _] = &inspector.found.options;
        assert_eq!(full.smallest == tension.smallest && full.largest == tension.largest, rest_length < 1.0);
    }
    // Nothing is known of `Full` yet.
    let mut first = inspector(&held, step_for(33.0), FULL);
    first.look(Part::Signs(FULL)).unwrap();
    first.look(Part::Spectrum(Stiffness::Tension)).unwrap();
    assert!(
        (first.found.options[1].smallest - 33.0 - 50.0 * 4.0 * (std::f64::consts::PI / 16.0).sin().powi(2)).abs()
            < 1e-9
    );
    let found = Inspection::at(&held.0, &held.1, step_for(33.0), FULL, Par::Seq).unwrap();
    let [full, tension, axial] = &found.options;
    assert!(full.smallest > 34.0 && tension.smallest == full.smallest && (axial.smallest - 33.0).abs() < 1e-9);
}
