//! Chains of springs of length one, of which every eigenvalue is known: bounds by hand, and how soon a search ends.

use super::{
    ENOUGH, Eigenpair, Estimator, SIGN, Spectrum, proven_ceiling, proven_floor, proves_definite, proves_indefinite,
};
use crate::force::Extensions;
use crate::inspect::eigenpair::eigenpair;
use crate::inspect::tests::{chain, eigenvalues, step_for};
use crate::linear::norm;
use crate::operator::SystemOperator;
use crate::spring::{Spring, Stiffness};
use crate::system::SystemBuilder;
use crate::work::Work;

fn with<T>(
    free: usize,
    rest_length: f64,
    inertia: f64,
    look: impl FnOnce(&mut Estimator<'_>, &SystemOperator<'_>) -> T,
) -> T {
    let (system, state) = chain(free, rest_length);
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let mut estimator = Estimator::new(&system, &state, extensions, step_for(inertia));
    let a = estimator.operator(Stiffness::Full);
    look(&mut estimator, &a)
}

fn pair(value: f64) -> Eigenpair {
    Eigenpair { value, vector: Vec::new(), residual: 0.0 }
}

/// With 33 N/m of inertia: two springs of 100 N/m along take no more than 400, and where they are pressed those of 40 N/m 160.
#[test]
fn bounds_are_those_by_hand() {
    for (rest_length, floor, ceiling) in [(0.5, 33.0, 433.0), (1.25, f64::NEG_INFINITY, 193.0)] {
        with(3, rest_length, 33.0, |_, a| {
            assert!(proven_floor(a) == floor || (proven_floor(a) - floor).abs() < 1e-12);
            assert!((proven_ceiling(a) - ceiling).abs() < 1e-12);
            assert_eq!(proves_definite(a), rest_length < 1.0);
            let limit = SIGN * proven_ceiling(a);
            assert!(proves_indefinite(a, &pair(-1.01 * limit)));
            for value in [-limit, -0.99 * limit, 0.0, 0.99 * limit, 1.01 * limit] {
                assert!(!proves_indefinite(a, &pair(value)), "{value}");
            }
        });
    }
    // Too little inertia to be seen beside the springs.
    with(3, 0.5, 1e-12, |_, a| assert!(proven_floor(a) > 0.0 && !proves_definite(a)));
    with(3, 0.5, 1e-10, |_, a| assert!(proves_definite(a)));
    // Nothing that moves: no bound is one.
    with(0, 0.5, 33.0, |_, a| assert!(proven_floor(a) == f64::INFINITY && !proves_definite(a)));
}

/// Six products span the whole space of three particles in the plane.
#[test]
fn the_first_vector_is_the_lowest_of_a_short_chain() {
    with(3, 1.25, 15.0, |estimator, a| {
        let first = estimator.first(a).unwrap();
        assert!((first.value - eigenvalues(3, 1.25, step_for(15.0))[0]).abs() < 1e-9, "{}", first.value);
    });
}

/// The j-th mode of a chain across it, with a part of another.
fn modes(free: usize, parts: &[(usize, f64)]) -> Vec<f64> {
    let mut vector = vec![0.0; 2 * free];
    for &(j, part) in parts {
        for p in 0..free {
            let phase = (j * (p + 1)) as f64 * std::f64::consts::PI / (free as f64 + 1.0);
            vector[2 * p + 1] += part * phase.sin();
        }
    }
    let length = norm(&vector);
    vector.iter_mut().for_each(|v| *v /= length);
    vector
}

/// The spectrum from a start, and how often the search looked whether that is enough: three vectors each.
fn looks(rest_length: f64, parts: &[(usize, f64)]) -> (Spectrum, u64) {
    with(130, rest_length, 33.0, |estimator, a| {
        let start = (!parts.is_empty()).then(|| eigenpair(a, modes(130, parts)));
        let mut work = Work::default();
        let found = estimator.spectrum(a, start.as_ref(), &mut work);
        assert_eq!(work.multigrid_iterations % 3, 0);
        (found, work.multigrid_iterations / 3)
    })
}

#[test]
fn a_search_ends_where_the_start_is_good_enough() {
    // The lowest mode of a pressed chain, and of a stretched one a vector near what springs and masses prove.
    let (pressed, once) = looks(1.25, &[(130, 1.0)]);
    assert_eq!((once, pressed.lowest.len()), (1, 3));
    let (stretched, once) = looks(0.5, &[(1, 1.0), (130, 0.002)]);
    assert_eq!((once, stretched.lowest.len()), (1, 3));
    let far = stretched.lowest[0].residual > ENOUGH * stretched.smallest();
    assert!(far && stretched.smallest() <= 33.0 * (1.0 + ENOUGH));
    // From random vectors it takes longer.
    for rest_length in [0.5, 1.25] {
        let (found, often) = looks(rest_length, &[]);
        assert!(often > 1 && found.lowest.len() == 3, "{often}");
    }

    // λ_max is at least what is found less the rounding of a product, and at most 433.
    let rounding = SIGN * 433.0;
    assert!((stretched.smallest_within[0] - 33.0).abs() < 1e-12 && (stretched.largest_within[1] - 433.0).abs() < 1e-9);
    assert!((stretched.smallest_within[1] - stretched.smallest() - rounding).abs() < 0.5 * rounding);
    assert!((stretched.largest - stretched.largest_within[0] - rounding).abs() < 0.5 * rounding);
    assert_eq!(stretched.condition, stretched.largest / stretched.smallest());
    assert!(pressed.condition.is_nan());
}

/// A residual of a thousandth of the value is good enough, and a value within a thousandth of a bound from below; either alone is.
#[test]
fn a_search_goes_on_where_the_start_is_not_good_enough() {
    // −7 N/m with a residual of 0.0034 N/m.
    let (pressed, once) = looks(1.25, &[(130, 1.0), (129, 0.2)]);
    let residual = pressed.lowest[0].residual;
    assert!(once == 1 && (1e-3..7e-3).contains(&residual), "{once} {residual}");
    // 33.6 N/m, where nothing lies below 33.
    let (stretched, often) = looks(0.5, &[(1, 1.0), (130, 0.05)]);
    assert!(often > 1 && stretched.smallest() < 33.0 * (1.0 + ENOUGH), "{often}");
}

/// A particle that nothing holds, with an endless step: an eigenvalue of exactly zero proves nothing.
#[test]
fn zero_proves_nothing() {
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    let places = [0.0, 5.0, 6.0].map(|x| builder.particle([x, 0.0, 0.0], 1.0));
    builder.spring(places[1], places[2], Spring { stiffness: 3.0, rest_length: 0.5, damping: 0.0 });
    builder.hold(places[2]);
    let (system, state) = builder.build().unwrap();
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let mut estimator = Estimator::new(&system, &state, extensions, 1e200);
    let a = estimator.operator(Stiffness::Full);
    assert!(proven_floor(&a) == 0.0 && !proves_definite(&a));
    let start = eigenpair(&a, vec![1.0, 0.0]);
    let mut work = Work::default();
    let found = estimator.spectrum(&a, Some(&start), &mut work);
    assert_eq!((found.smallest(), found.condition.is_nan()), (0.0, true));
    // The search goes on, for all that it is worth.
    assert_eq!(work.multigrid_iterations, 40 * 3);
    // Without any spring there is nothing above zero at all.
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    builder.particle([0.0; 3], 1.0);
    let (system, state) = builder.build().unwrap();
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let estimator = Estimator::new(&system, &state, extensions, 1e200);
    assert!(!proves_definite(&estimator.operator(Stiffness::Full)));
}
