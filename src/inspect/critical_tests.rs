//! Searches whose every trial is known by hand: particles that move along one axis each.

use super::critical::{Bound, CriticalSteps, Facts, LargestStep};
use crate::inspect::Property::{Definite, Stable};
use crate::inspect::fixtures::{Pin, pin, pinned};
use crate::inspect::tests::chain;
use crate::spring::{Spring, Stiffness};
use crate::system::{State, System, SystemBuilder};
use faer::Par;

const FULL: Stiffness = Stiffness::Full;

fn steps<'s>((system, state): &'s (System, State)) -> CriticalSteps<'s> {
    CriticalSteps::new(system, state, Par::Seq).unwrap()
}

fn limit(step: LargestStep) -> [f64; 2] {
    let LargestStep::UpTo { dt, refused } = step else { panic!("{step:?}") };
    [dt, refused]
}

/// Along (3): 18 s² + 18 s − 108 vanishes at 2, where it rises by 90 for every unit of s; ‖P‖ is at most 8 + 2·12. Of the other requirement 72 s² +
/// 36 s − 108 vanishes at 1.
#[test]
fn a_bound_is_the_root_along_a_direction() {
    let held = pinned(&[Pin { mass: 2.0, taken: 12.0, damping: 2.0 }]);
    let mut steps = steps(&held);
    let nothing = || Bound { s: 0.0, rounding: 0.0 };
    for (requirement, root) in [(Definite, 2.0), (Stable, 1.0)] {
        let mut bound = nothing();
        steps.pencil.property = requirement;
        assert!(steps.raise(&mut bound, &[3.0]));
        assert_eq!(bound.s, root);
        let expected = 2.0 * f64::EPSILON * (2.0 + 9.0 * 32.0 / 180.0);
        assert!((bound.rounding / expected - 1.0).abs() < 1e-12, "{}", bound.rounding / expected);
        // No higher: the bound stays.
        assert!(!steps.raise(&mut bound, &[-1.0]) && bound.s == root);
        let mut higher = Bound { s: 2.5, rounding: 0.0 };
        assert!(!steps.raise(&mut higher, &[3.0]) && higher.s == 2.5);
    }
    (steps.pencil.property, steps.pencil.option) = (Definite, Stiffness::Tension);
    assert!(!steps.raise(&mut nothing(), &[3.0]));
}

/// One takes 12 N/m, one adds 5: the limit is that of the first, whatever direction is known before. Where the other takes too the lower limit
/// counts.
#[test]
fn a_direction_of_negative_curvature_is_found() {
    for (other, expected) in [(-5.0, 6.0f64.sqrt()), (8.0, 8.0f64.sqrt())] {
        let held = pinned(&[pin(2.0, 12.0), pin(1.0, other)]);
        let [dt, refused] = limit(steps(&held).largest_step(Definite, FULL));
        assert!((dt * expected - 1.0).abs() < 1e-12 && refused > dt && refused < dt * (1.0 + 1e-12), "{dt} {refused}");
        for option in [Stiffness::Tension, Stiffness::Axial] {
            assert_eq!(steps(&held).largest_step(Definite, option), LargestStep::Every);
        }
    }
    let held = pinned(&[pin(2.0, 12.0), pin(1.0, -5.0)]);
    let mut steps = steps(&held);
    assert!(steps.curves_downwards());
    steps.pencil.option = Stiffness::Axial;
    assert!(!steps.curves_downwards());
}

/// Springs that are pressed by no more than the rounding of their lengths limit no step, however stiff they are.
#[test]
fn what_is_pressed_by_rounding_alone_limits_no_step() {
    for stiffness in [1e-6, 1.0, 1e6] {
        let pressed = |parts: f64| {
            let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
            let ends = [0.0, 1.0].map(|x| builder.particle([x, 0.0, 0.0], 1.0));
            let rest_length = 1.0 + parts * f64::EPSILON;
            builder.spring(ends[0], ends[1], Spring { stiffness, rest_length, damping: 0.0 });
            builder.hold(ends[1]);
            let held = builder.build().unwrap();
            steps(&held).largest_step(Definite, FULL)
        };
        assert_eq!(pressed(8.0), LargestStep::Every, "{stiffness}");
        let [dt, _] = limit(pressed(64.0));
        assert!((dt * dt * stiffness * 64.0 * f64::EPSILON - 1.0).abs() < 0.1, "{stiffness} {dt}");
    }
}

/// Facts about A at the limit s = 2: a direction, and an s that was proven.
fn known(direction: &[f64], definite_from: Option<f64>) -> Facts {
    Facts { curves_downwards: Some(true), direction: Some(direction.to_vec()), definite_from }
}

/// Nothing is factored where the limit is known already to as many digits as a factorization tells.
#[test]
fn a_bracket_that_is_narrow_enough_is_not_narrowed() {
    let held = pinned(&[pin(5.0, 20.0)]);
    let mut found = steps(&held);
    let proven = 2.0 * (1.0 + 2.0 * f64::EPSILON);
    assert_eq!(limit(found.search(Definite, FULL, known(&[1.0], Some(proven)))), [1.0 / proven, 0.5]);
    assert_eq!(found.work.factorizations, 0);
    // A bracket of 1 + 10⁻⁶ is wide. Where the direction belongs to another eigenvalue, exactly, the factorization that refuses a step beyond its root
    // finds the right one, and the next proves it.
    let other = pinned(&[pin(5.0, 20.0), pin(5.0, 5.0)]);
    for (held, direction, factorizations) in [(&held, &[1.0][..], 1), (&other, &[0.0, 1.0], 2)] {
        let mut found = steps(held);
        let [dt, refused] = limit(found.search(Definite, FULL, known(direction, None)));
        assert!(dt < 0.5 && refused == 0.5 && 0.5 - dt < 1e-15, "{dt} {refused}");
        assert_eq!(found.work.factorizations, factorizations);
    }
}

/// A particle in a corner, pressed by one spring and damped at an angle: its own limit is at s = 0.033 or so, far below where all is definite for
/// certain; that of another particle is at 0.9. A trial between both finds it.
#[test]
fn a_bound_that_says_little_is_bettered_from_above() {
    let search = |damping: f64| {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        let mut joined = |at: [f64; 2], from: [f64; 2], spring: Spring| {
            let [free, wall] = [at, from].map(|[x, y]| builder.particle([x, y, 0.0], 1.0));
            builder.hold(wall);
            builder.spring(free, wall, spring);
            free
        };
        let first = joined([0.0, 0.0], [1.0, 0.0], Spring { stiffness: 2.0, rest_length: 2.0, damping: 0.0 });
        joined([5.0, 0.0], [6.0, 0.0], Spring { stiffness: 1.62, rest_length: 2.0, damping: 0.0 });
        let wall = builder.particle([1.0, 1.0, 0.0], 1.0);
        builder.hold(wall);
        builder.spring(first, wall, Spring { stiffness: 1e-30, rest_length: 2f64.sqrt(), damping });
        let held = builder.build().unwrap();
        let mut steps = steps(&held);
        let [dt, refused] = limit(steps.largest_step(Definite, FULL));
        assert!((dt * 0.9 - 1.0).abs() < 1e-12 && refused > dt && refused < dt * (1.0 + 1e-12), "{dt} {refused}");
        steps.work.factorizations
    };
    assert!(search(61.0) <= 4 && search(620.0) <= 4);
}

/// The direction is that of another eigenvalue of a chain, exactly: refusals make trials bolder until one lies beyond the limit.
#[test]
fn refusals_make_trials_bolder() {
    let free = 30;
    let held = chain(free, 1.25);
    let mode = |j: usize| -> Vec<f64> {
        let phase = |p: usize| (j * (p + 1)) as f64 * std::f64::consts::PI / (free + 1) as f64;
        (0..free).flat_map(|p| [0.0, phase(p).sin()]).collect()
    };
    let exact = (2.0 / 40.0f64).sqrt() / (free as f64 * std::f64::consts::PI / (2 * free + 2) as f64).sin();
    let mut steps = steps(&held);
    let [dt, refused] = limit(steps.search(Definite, FULL, known(&mode(free - 3), None)));
    assert!((dt / exact - 1.0).abs() < 1e-12 && refused > dt && refused < dt * (1.0 + 1e-12), "{dt} {refused}");
    assert!(steps.work.factorizations < 30, "{:?}", steps.work);
}
