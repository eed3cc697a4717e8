//! When coarse levels are made anew, and when they are kept.

use super::*;
use crate::force::Extensions;
use crate::operator::Combination;
use crate::scene::builtin::cloth;
use crate::spring::Stiffness;

fn used(per_digit: f64, lost: f64) -> Coarse {
    Coarse::Used { per_digit, lost }
}

/// With a small system, to be aged by hand.
fn aged(coarse: Coarse) -> ReusedMultigrid {
    let (system, _) = cloth(3).unwrap().build().unwrap();
    ReusedMultigrid { coarse, ..ReusedMultigrid::new(&system).unwrap() }
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
    // A quarter more than six a digit and one are seven and a half and one.
    for (iterations, lost) in [(8, 2.0), (9, 8.0)] {
        let mut multigrid = aged(used(6.0, 0.0));
        multigrid.record(iterations, 1.0);
        assert_eq!(multigrid.coarse, used(6.0, lost), "after {iterations} iterations for one digit");
    }
    // Of two digits these are fifteen and one.
    for (iterations, lost) in [(15, 3.0), (16, 4.0), (17, 8.0)] {
        let mut multigrid = aged(used(6.0, 0.0));
        multigrid.record(iterations, 2.0);
        assert_eq!(multigrid.coarse, used(6.0, lost), "after {iterations} iterations for two digits");
    }
    let mut multigrid = aged(Coarse::Missing);
    multigrid.record(30, 5.0);
    assert_eq!(multigrid.coarse, Coarse::Missing);
}

/// In the first solve with the next matrix four iterations more than expected are too many, three are not.
#[test]
fn coarse_levels_age_fast_by_what_they_lose() {
    for (iterations, solves, renewals) in [(9, 1, 0), (10, 1, 4), (10, 2, 0)] {
        let mut multigrid = ReusedMultigrid { solves, ..aged(used(6.0, 0.0)) };
        multigrid.record(iterations, 1.0);
        assert_eq!(multigrid.renewals, renewals, "{iterations} in solve {solves}");
    }
}

/// Three iterations a digit are expected. After five, at the pace so far: ten digits in thirty-eight are no more than a quarter and one beyond
/// thirty, ten in thirty-nine are, and more than three can still be saved; of two digits five more, but not three.
#[test]
fn patience_ends() {
    let patience = aged(used(3.0, 1.0)).patience().unwrap();
    for (iterations, gained, left, more) in [
        (5, 5.0 / 3.85, 10.0 - 5.0 / 3.85, 1),
        (5, 5.0 / 3.95, 10.0 - 5.0 / 3.95, 0),
        (5, 1.0, 1.0, 1),
        (5, 1.0, 1.5, 0),
        (5, 0.0, 1.0, 0),
        (5, -1.0, 1.0, 0),
    ] {
        assert_eq!(patience.more(Progress { iterations, gained, left }), more, "{gained} of {}", gained + left);
    }
    assert_eq!(aged(Coarse::New).patience(), None);
    assert_eq!(aged(Coarse::Missing).patience(), None);
}

/// Coarse levels are recomputed as soon as eight iterations are lost, and where there are none that a solve has used.
#[test]
fn coarse_levels_last_until_their_price_is_lost() {
    let (system, state) = cloth(3).unwrap().build().unwrap();
    let extensions = Extensions::at(&system, &state.positions).unwrap();
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

/// Six iterations a digit in the first solve: eighty for ten digits in the next one are twenty too many, more than a quarter. So are those of
/// a solve with the next matrix that has to ask for new coarse levels. What ages later only loses.
#[test]
fn coarse_levels_that_age_in_one_step_are_made_anew_for_a_while() {
    let (system, state) = cloth(3).unwrap().build().unwrap();
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let a = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.01));
    let (mut multigrid, mut work) = (ReusedMultigrid::new(&system).unwrap(), Work::default());
    let mut step = |multigrid: &mut ReusedMultigrid, iterations: u64| {
        multigrid.update(&a, &mut work).unwrap();
        multigrid.record(iterations, 10.0);
        work.multigrid_setups
    };
    let setups: Vec<u64> = [60, 60, 80, 60, 80].into_iter().map(|k| step(&mut multigrid, k)).collect();
    assert_eq!((setups, multigrid.renewals), (vec![1, 1, 1, 2, 2], 4));
    for renewed in 1..=4 {
        assert_eq!(step(&mut multigrid, 60), 2 + renewed);
    }
    assert_eq!((multigrid.renewals, multigrid.next_renewals), (0, 8));
    for (solves, coarse) in [(2, used(6.0, 0.0)), (1, Coarse::New)] {
        (multigrid.solves, multigrid.coarse) = (solves, coarse);
        multigrid.rebuild(&a, &mut Work::default()).unwrap();
        assert_eq!((multigrid.renewals, multigrid.next_renewals), (0, 8), "{coarse:?}");
    }
    for renewals in [8, 16, 32, 64, 128, 256, 512, 512] {
        (multigrid.solves, multigrid.coarse) = (1, used(6.0, 0.0));
        multigrid.rebuild(&a, &mut Work::default()).unwrap();
        assert_eq!(multigrid.renewals, renewals);
    }
    // Those that serve once more when they are tried again are no longer in a fast motion.
    (multigrid.solves, multigrid.coarse, multigrid.renewals) = (1, used(6.0, 0.0), 0);
    step(&mut multigrid, 61);
    assert_eq!((multigrid.renewals, multigrid.next_renewals), (0, 4));
}

/// Where every second matrix is refused, by a solve or already by its diagonal blocks, the next but one keeps the coarse levels of the one between
/// and has more patience with them, whatever they have lost. Where it is solved after all, the next one is as any other; and without coarse levels there are
/// none to keep.
#[test]
fn coarse_levels_are_not_made_for_matrices_that_are_likely_to_be_refused() {
    let (system, state) = cloth(3).unwrap().build().unwrap();
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let a = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.01));
    let negative = Combination { mass: 0.0, damping: 0.0, stiffness: 1.0 };
    let refused = SystemOperator::new(&system, &extensions, Stiffness::Axial, negative);
    for is_refused_by_blocks in [false, true] {
        let (mut multigrid, mut work) = (aged(used(6.0, 9.0)), Work::default());
        let first = |multigrid: &mut ReusedMultigrid, work: &mut Work| {
            let updated = multigrid.update(if is_refused_by_blocks { &refused } else { &a }, work);
            assert_eq!(updated.is_err(), is_refused_by_blocks);
            if !is_refused_by_blocks {
                multigrid.refused();
            }
        };
        first(&mut multigrid, &mut work);
        assert_eq!((work.multigrid_setups, multigrid.is_doubtful), (u64::from(!is_refused_by_blocks), false));
        for solved in 1..=2 {
            multigrid.coarse = used(6.0, 9.0);
            let before = work.multigrid_setups;
            multigrid.update(&a, &mut work).unwrap();
            assert_eq!((work.multigrid_setups - before, multigrid.is_doubtful), (1, false), "{solved}");
            multigrid.coarse = used(6.0, 9.0);
            assert_eq!(multigrid.patience(), Some(Patience { per_digit: 6.0, first: 5 }));
            first(&mut multigrid, &mut work);
            assert_eq!((work.multigrid_setups - before, multigrid.is_doubtful), (1, true), "{solved}");
            assert_eq!(multigrid.patience(), Some(Patience { per_digit: 6.0, first: 13 }));
        }
        let before = work.multigrid_setups;
        // Refused, solved, solved after all: the first and the last get new ones.
        for (expected, is_doubtful) in [(1, false), (1, true), (2, false)] {
            multigrid.coarse = used(6.0, 9.0);
            multigrid.update(&a, &mut work).unwrap();
            assert_eq!((work.multigrid_setups - before, multigrid.is_doubtful), (expected, is_doubtful));
        }
    }
    let (mut multigrid, mut work) = (aged(Coarse::Missing), Work::default());
    multigrid.refused = [false, true];
    multigrid.update(&a, &mut work).unwrap();
    assert_eq!((work.multigrid_setups, multigrid.is_doubtful), (1, true));
    // Those that are slow for such a matrix have not aged.
    (multigrid.solves, multigrid.coarse) = (1, used(6.0, 0.0));
    multigrid.rebuild(&a, &mut work).unwrap();
    assert_eq!((multigrid.renewals, multigrid.coarse), (0, Coarse::New));
}

/// A solve that asks for new coarse levels says that they age fast only if they were used, and once at most.
#[test]
fn new_coarse_levels_do_not_age() {
    let (system, state) = cloth(3).unwrap().build().unwrap();
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let a = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.01));
    for (coarse, solves, renewals) in
        [(used(6.0, 0.0), 1, 4), (used(6.0, 0.0), 2, 0), (Coarse::New, 0, 0), (Coarse::Missing, 1, 0)]
    {
        let mut multigrid = ReusedMultigrid { solves, ..aged(coarse) };
        multigrid.rebuild(&a, &mut Work::default()).unwrap();
        assert_eq!(multigrid.renewals, renewals, "{coarse:?} {solves}");
    }
}

/// Sixty iterations are expected of new ones, and seventy-six are no more than a quarter and one beyond; of six a ninth is, but three are
/// no loss that new ones would pay for.
#[test]
fn ageing_takes_slow_solves_that_lose_much() {
    for (iterations, digits, renewals) in [(70, 10.0, 0), (76, 10.0, 0), (77, 10.0, 4), (9, 1.0, 0), (11, 1.0, 4)] {
        let mut multigrid = ReusedMultigrid { solves: 1, ..aged(used(6.0, 0.0)) };
        multigrid.record(iterations, digits);
        assert_eq!(multigrid.renewals, renewals, "{iterations} for {digits}");
    }
}

/// The places of the particles reach the multigrid inside: it does what one does that was told them directly.
#[test]
fn places_are_passed_on() {
    let (system, state) = cloth(14).unwrap().build().unwrap();
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let a = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.01));
    let r: Vec<f64> = (0..system.dofs().len()).map(|row| (row as f64).sin()).collect();
    let mut reused = ReusedMultigrid::new(&system).unwrap();
    reused.place(&state.positions);
    reused.update(&a, &mut Work::default()).unwrap();
    let mut of_reused = vec![0.0; r.len()];
    reused.apply(&r, &mut of_reused);
    let direct = |is_placed: bool| {
        let mut multigrid = Multigrid::new(&system).unwrap();
        if is_placed {
            multigrid.place(&state.positions);
        }
        multigrid.refill(&a).unwrap();
        multigrid.rebuild(&a).unwrap();
        let mut z = vec![0.0; r.len()];
        multigrid.apply(&r, &mut z);
        z
    };
    assert_eq!(of_reused, direct(true));
    assert_ne!(of_reused, direct(false));
}
