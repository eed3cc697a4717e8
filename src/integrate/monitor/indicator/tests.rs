use super::super::Figures;
use super::{Warning, doubtful, percent, times};
use crate::integrate::Method;

/// Figures of a run of ten steps in which nothing is wrong.
fn harmless() -> Figures {
    Figures { steps: 10, duration: 1.0, extent: 1.0, exchanged: 1.0, ..Figures::default() }
}

/// Figures that are exactly at a limit are harmless, and those a little beyond it are not.
#[test]
fn warnings_begin_beyond_their_limits() {
    for (figures, method, beyond, warning) in [
        (
            Figures { change: 0.033, ..harmless() },
            Method::BackwardEuler,
            Figures { change: 0.034, ..harmless() },
            Warning::Wrong(0.034),
        ),
        (
            Figures { way: 8.0, reach: 0.5, embedded: 2e-3, ..harmless() },
            Method::Rodas4,
            Figures { way: 8.5, reach: 0.5, embedded: 2e-3, ..harmless() },
            Warning::Crumpled { way: 8.5, more: 10.0 },
        ),
        (
            Figures { way: 9.0, reach: 0.3, embedded: 2e-3, ..harmless() },
            Method::Rodas4,
            Figures { way: 9.0, reach: 0.31, embedded: 2e-3, ..harmless() },
            Warning::Crumpled { way: 9.0, more: 10.0 },
        ),
        (
            Figures { way: 9.0, reach: 0.5, carried: 3e-3, ..harmless() },
            Method::Rodas4,
            Figures { way: 9.0, reach: 0.5, carried: 3.3e-3, ..harmless() },
            Warning::Crumpled { way: 9.0, more: 10.0 },
        ),
        (
            Figures { way: 9.0, reach: 0.5, embedded: 0.3 / 256.0 / 1001.0, ..harmless() },
            Method::Dop853,
            Figures { way: 9.0, reach: 0.5, embedded: 0.3 / 256.0 / 999.0, ..harmless() },
            Warning::Crumpled { way: 9.0, more: 1000.0 },
        ),
        (
            Figures { gained: 2.0, slip: 0.01, ..harmless() },
            Method::Bdf2,
            Figures { gained: 2.5, slip: 0.01, ..harmless() },
            Warning::Gained { gained: 2.5, exchanged: 1.0 },
        ),
        (
            Figures { gained: 7.5, exchanged: 4.0, slip: 0.01, ..harmless() },
            Method::Bdf2,
            Figures { gained: 8.5, exchanged: 4.0, slip: 0.01, ..harmless() },
            Warning::Gained { gained: 8.5, exchanged: 4.0 },
        ),
        (
            Figures { gained: 2.5, slip: 0.003, ..harmless() },
            Method::Bdf2,
            Figures { gained: 2.5, slip: 0.004, ..harmless() },
            Warning::Gained { gained: 2.5, exchanged: 1.0 },
        ),
        (
            Figures { gained: 0.5, gained_way: 2.0, ..harmless() },
            Method::Bdf2,
            Figures { gained: 0.5, gained_way: 2.1, ..harmless() },
            Warning::Gained { gained: 0.5, exchanged: 1.0 },
        ),
        (
            Figures { can_fold: true, lost: 0.1, lost_way: 0.8, ..harmless() },
            Method::Bdf2,
            Figures { can_fold: true, lost: 0.1, lost_way: 0.9, ..harmless() },
            Warning::Damped { lost: 0.1, exchanged: 1.0 },
        ),
    ] {
        assert_eq!(figures.warnings(method, None), [], "{figures:?}");
        assert_eq!(beyond.warnings(method, None), [warning], "{beyond:?}");
    }
}

/// Causes of a run that is wrong, at their limits and beyond.
#[test]
fn causes_are_named_beyond_their_limits() {
    let wrong = Figures { change: 0.05, slip: 0.05, embedded: 0.05, ..harmless() };
    let causes = |figures: Figures, method: Method| figures.warnings(method, None)[1..].to_vec();
    let turning = |defect| causes(Figures { defect, ..wrong }, Method::LinearBackwardEuler);
    assert_eq!((turning(4.0), turning(4.5)), (vec![], vec![Warning::Turning(4.5)]));
    let braked = |lifted_twice| causes(Figures { lifted_twice, ..wrong }, Method::Rodas4);
    assert_eq!((braked(0.125), braked(0.25)), (vec![], vec![Warning::Braked(0.1)]));
    for (exchanged, at, beyond) in [(1.0, 0.2, 0.25), (4.0, 0.75, 0.875)] {
        let damped = |lost| causes(Figures { lost, exchanged, ..wrong }, Method::Bdf2);
        assert_eq!((damped(at), damped(beyond)), (vec![], vec![Warning::Damped { lost: beyond, exchanged }]));
    }
    // A third of the errors carried on counts, of rodas4.
    let carried = |carried| causes(Figures { carried, embedded: 0.0625, ..wrong }, Method::Rodas4);
    assert_eq!((carried(1.875), carried(3.75)), (vec![], vec![Warning::Magnified(20.0)]));
    let long = |reach| causes(Figures { reach, ..wrong }, Method::Bdf2);
    assert_eq!((long(1.0), long(1.5)), (vec![], vec![Warning::Long(1.5)]));
}

/// A step longer than a spring is named beside whatever is wrong, each of which is enough.
#[test]
fn long_steps_are_named_where_anything_is_wrong() {
    let long = Figures { reach: 2.0, ..harmless() };
    let last = |figures: Figures, method: Method| figures.warnings(method, None).last().copied();
    assert_eq!(last(long, Method::Bdf2), None);
    for (figures, method) in [
        (Figures { slip: 0.05, ..long }, Method::Bdf2),
        (Figures { can_fold: true, lost_way: 1.0, ..long }, Method::Bdf2),
        (Figures { gained_way: 3.0, ..long }, Method::Bdf2),
        (Figures { way: 9.0, embedded: 2e-3, ..long }, Method::Rodas4),
    ] {
        assert_eq!(last(figures, method), Some(Warning::Long(2.0)), "{figures:?}");
    }
}

/// Of velocities that never change nothing is known about their pace: the estimate is the one of steps that resolve it.
#[test]
fn motions_without_change_have_no_pace() {
    let figures = Figures { bend: 0.24, ..harmless() };
    assert_eq!(figures.estimate(Method::Verlet), Some(0.24 / 24.0));
    assert_eq!(figures.estimate(Method::SymplecticEuler), Some(0.0));
}

#[test]
fn every_method_has_a_limit_of_a_few_percent_at_most() {
    let limits = Method::ALL.map(doubtful);
    assert_eq!(limits, [0.0215, 0.033, 0.018, 0.0175, 0.01, 0.011, 0.016, 0.3 / 256.0, 0.03, 0.013]);
}

#[test]
fn warnings_are_sentences() {
    for (warning, text) in [
        (Warning::Wrong(0.0345), "wrong by about 3.5 % of the extent"),
        (
            Warning::Turning(12.34),
            "springs that turn are stretched by the steps and brake the motion: linearising leaves out forces 12.3 times those \
             that move the particles",
        ),
        (
            Warning::Braked(0.12),
            "springs that turn are stretched by the steps and brake the motion: by about 12 % of its kinetic energy",
        ),
        (Warning::Magnified(345.4), "the motion magnified the errors of its steps about 345 times on the way"),
        (Warning::Magnified(1e6), "the motion magnified the errors of its steps about 1e6 times on the way"),
        (
            Warning::Crumpled { way: 9.0, more: 1000.0 },
            "the scene has crumpled, its particles having gone 9.0 times its extent: such motions magnify errors, and this one may \
             be 1000 times as wrong as the estimate says",
        ),
        (
            Warning::Damped { lost: 12.0, exchanged: 3.5 },
            "fast modes were damped away by the method: it took 1.20e1 J, where the motion exchanged 3.50e0 J",
        ),
        (
            Warning::Gained { gained: f64::INFINITY, exchanged: 3.5 },
            "energy was gained: more than 1e308 J appeared from nowhere, where the motion exchanged 3.50e0 J",
        ),
        (Warning::Long(2.0), "a step was longer than a spring: its ends passed each other by 2.0 of its lengths"),
    ] {
        assert_eq!(warning.to_string(), text);
    }
}

/// Numbers stay readable up to their borders.
#[test]
fn numbers_are_told_to_people() {
    assert_eq!([2.25, 999_999.5, 1e6, 2.5e7].map(times), ["2.2", "999999.5", "1.0e6", "2.5e7"]);
    // Hundreds of percent are rounded to tens.
    assert_eq!([0.956, 99.94, 99.95, 100.0].map(percent), ["100 %", "9990 %", "more than 9990 %", "more than 9990 %"]);
}
