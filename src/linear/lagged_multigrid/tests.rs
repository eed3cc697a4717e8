//! When coarse levels are made anew, and when they are kept.

use super::*;
use crate::force::SpringGeometry;
use crate::operator::Combination;
use crate::scene::builtin::cloth;
use crate::spring::Stiffness;

fn used(per_digit: f64, lost: f64) -> Coarse {
    Coarse::Used { per_digit, lost }
}

/// On a small system, with coarse levels of a given age.
fn aged(coarse: Coarse) -> LaggedMultigrid {
    let (system, _) = cloth(3).unwrap().build().unwrap();
    LaggedMultigrid { coarse, ..LaggedMultigrid::new(&system).unwrap() }
}

/// What was lost is the iterations beyond those that new coarse levels would have taken; a solve that takes fewer gives
/// nothing back, and one that gains less than a digit does not count.
#[test]
fn losses_are_counted_against_new_coarse_levels() {
    let mut multigrid = aged(Coarse::New);
    for (iterations, digits, coarse) in [
        (9, 0.5, Coarse::New),
        (9, f64::NAN, Coarse::New),
        (30, 5.0, used(6.0, 0.0)),
        (40, 5.0, used(6.0, 10.0)),
        (33, 5.0, used(6.0, 13.0)),
        (20, 5.0, used(6.0, 13.0)),
        (90, 0.75, used(6.0, 13.0)),
        (90, f64::NAN, used(6.0, 13.0)),
        (8, 1.0, used(6.0, 15.0)),
    ] {
        multigrid.record(iterations, digits);
        assert_eq!(multigrid.coarse, coarse, "after {iterations} iterations for {digits} digits");
    }
    let mut multigrid = aged(Coarse::Missing);
    multigrid.record(30, 5.0);
    assert_eq!(multigrid.coarse, Coarse::Missing);
}

/// Coarse levels are recomputed as soon as eight iterations are lost, and where there are none that a solve has used.
#[test]
fn coarse_levels_last_until_their_price_is_lost() {
    let (system, state) = cloth(3).unwrap().build().unwrap();
    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    let a = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.01));
    for (before, setups, after) in [
        (Coarse::Missing, 1, Coarse::New),
        (Coarse::New, 1, Coarse::New),
        (used(3.0, 0.0), 0, used(3.0, 0.0)),
        (used(3.0, 7.75), 0, used(3.0, 7.75)),
        (used(3.0, 8.0), 1, Coarse::New),
        (used(3.0, 8.25), 1, Coarse::New),
    ] {
        let (mut multigrid, mut work) = (aged(before), Work::default());
        multigrid.update(&a, &mut work).unwrap();
        assert_eq!((work.multigrid_setups, multigrid.coarse), (setups, after), "{before:?}");
    }
}

/// A negative mass shows on the finest level.
#[test]
fn indefinite_matrices_are_refused() {
    let (system, state) = cloth(3).unwrap().build().unwrap();
    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    let negative = Combination { mass: -1.0, damping: 0.0, stiffness: 0.0 };
    let a = SystemOperator::new(&system, &extensions, Stiffness::Tension, negative);
    let mut multigrid = aged(Coarse::New);
    assert!(matches!(multigrid.update(&a, &mut Work::default()), Err(SolveFailure::Indefinite(_))));
}
