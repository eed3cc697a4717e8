//! The parts of the search, by hand.

use super::*;
use crate::error::Error;
use crate::spring::Spring;
use crate::system::fixtures::tethered;

/// A particle of 1 kg on 10 N/m, held 1 m from its rest.
fn oscillator() -> (System, State) {
    tethered(1.0, 1.0, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 })
}

fn options(accuracy: f64) -> AccuracyOptions {
    AccuracyOptions {
        accuracy,
        duration: 2.0,
        interval: 0.1,
        par: Par::Seq,
        method: None,
        stiffness: None,
        solver: None,
    }
}

fn candidate(method: Method, control: StepControl) -> Candidate {
    Candidate { configuration: Configuration { method, options: ImplicitOptions::default() }, control }
}

const ADAPTIVE: StepControl = StepControl::Adaptive { rtol: 1e-3, first_step: None };

/// Steps half as long cost twice as much and are 2^p times as exact; half of these digits are expected.
#[test]
fn finer_runs_have_half_the_step() {
    for (method, order) in [(Method::BackwardEuler, 1), (Method::Verlet, 2), (Method::Rodas4, 4), (Method::Dop853, 8)] {
        let fixed = candidate(method, StepControl::Step(0.5));
        assert_eq!(fixed.finer(2.0).control, StepControl::Step(0.25));
        assert_eq!(fixed.cost_ratio(&fixed.finer(2.0)), 2.0);
        assert!((fixed.improvement(2.0) - 2f64.powi(order).sqrt()).abs() < 1e-12, "{}", method.name());
        assert!(!fixed.is_at_the_limit());

        let adaptive = candidate(method, ADAPTIVE);
        let StepControl::Adaptive { rtol, .. } = adaptive.finer(2.0).control else { panic!("steps were adaptive") };
        assert!((rtol * 2f64.powi(order) / 1e-3 - 1.0).abs() < 1e-12, "{}: {rtol}", method.name());
        assert!((adaptive.cost_ratio(&adaptive.finer(2.0)) - 2.0).abs() < 1e-12, "{}", method.name());
        assert_eq!(fixed.cost_ratio(&adaptive), 1.0);
    }
    let finest = candidate(Method::Dop853, ADAPTIVE).finer(1e3);
    assert_eq!(finest.control, StepControl::Adaptive { rtol: 1e-11, first_step: None });
    assert!(finest.is_at_the_limit());
}

/// Verlet's method makes way for one of high order where steps four times as fine do not do, unless it was asked for.
#[test]
fn the_excess_of_the_error_decides_how_much_finer() {
    let (system, start) = oscillator();
    let fixed = |method| candidate(method, StepControl::Step(0.5));
    let refined = |method, from: Method, error, excess| {
        let options = AccuracyOptions { method, ..options(1e-4) };
        let (go_on, costs): (&dyn Fn() -> bool, _) = (&|| true, CostModel::of(&system));
        let observer = &mut ();
        let search =
            Search { system: &system, start: &start, options: &options, observer, go_on, costs, spent: 0.0, runs: 0 };
        let next = search.refined(fixed(from), error, excess);
        (next.configuration.method, next.control)
    };
    // A method of second order needs √(2 · 18) = 6 times as fine steps for 18 times the error allowed, √(2 · 4.5) = 3 times for 4.5.
    let (bdf2, verlet) = (Method::Bdf2, Method::Verlet);
    assert_eq!(refined(None, bdf2, Some(0.01), 18.0), (bdf2, StepControl::Step(0.5 / 6.0)));
    assert_eq!(refined(None, verlet, Some(0.01), 4.5), (verlet, StepControl::Step(0.5 / 3.0)));
    assert_eq!(refined(Some(verlet), verlet, Some(0.01), 18.0), (verlet, StepControl::Step(0.5 / 6.0)));
    let (method, control) = refined(None, verlet, Some(0.01), 18.0);
    assert!(method == Method::Dop853 && matches!(control, StepControl::Adaptive { .. }));
    // More than ten times as fine is a leap that a run between must show to pay.
    assert_eq!(refined(None, bdf2, Some(0.01), 51.0), (bdf2, StepControl::Step(0.125)));
    // An error that is saturated tells nothing of the step.
    assert_eq!(refined(None, bdf2, Some(0.5), 1e6), (bdf2, StepControl::Step(0.125)));
    assert_eq!(refined(None, bdf2, None, 1.0), (bdf2, StepControl::Step(0.125)));
}

/// Steps four times as fine pay where the error falls by half of the digits that the order promises, and nothing is known of another method.
#[test]
fn finer_steps_pay_where_errors_fall() {
    let (coarse, fine) =
        (candidate(Method::Verlet, StepControl::Step(0.5)), candidate(Method::Verlet, StepControl::Step(0.125)));
    let before = Some((coarse, 0.08));
    assert_eq!([0.005, 0.02, 0.021, f64::INFINITY].map(|error| fine.pays(error, before)), [true, true, false, false]);
    assert!(fine.pays(1.0, Some((coarse, f64::INFINITY))) && !fine.pays(f64::INFINITY, Some((coarse, f64::INFINITY))));
    assert!(!fine.pays(1e-9, None) && !candidate(Method::Bdf2, StepControl::Step(0.125)).pays(1e-9, before));
}

/// Every method that was asked for gets to the accuracy while its errors fall as they should; a per cent takes Euler's methods thousands
/// of steps. Below rounding nothing can be confirmed, and that is said.
#[test]
fn methods_of_fixed_steps_reach_their_accuracy() {
    let (system, start) = oscillator();
    let exact = 2.0 - (2.0 * 10f64.sqrt()).cos();
    let first_order = [Method::SymplecticEuler, Method::ForwardEuler, Method::LinearBackwardEuler];
    let asked = first_order.map(|method| (method, 1e-2)).into_iter().chain([(Method::Verlet, 1e-4)]);
    for (method, accuracy) in asked {
        let options = AccuracyOptions { method: Some(method), ..options(accuracy) };
        let answer = run_to_accuracy(&system, &start, &options, &mut (), &|| true).unwrap().unwrap();
        let error = (answer.state.positions[1].x - exact).abs() / extent(&answer.state.positions, &start.positions);
        assert!(answer.verdict == Verdict::Confirmed && error < accuracy, "{}: {error:e}", method.name());
    }
    for method in [None, Some(Method::Verlet)] {
        let options = AccuracyOptions { method, ..options(1e-14) };
        let verdict = run_to_accuracy(&system, &start, &options, &mut (), &|| true).unwrap().unwrap().verdict;
        assert!(matches!(&verdict, Verdict::Unconfirmed(why) if why.contains("rounding")), "{verdict:?}");
    }
}

/// The particle swings to 3 m, twice its distance from rest, and ends elsewhere.
#[test]
fn the_motion_is_the_largest_displacement() {
    let (system, start) = oscillator();
    let answer = run_to_accuracy(&system, &start, &options(1e-3), &mut (), &|| true).unwrap().unwrap();
    let extent = extent(&answer.state.positions, &start.positions);
    assert!((answer.motion * extent - 2.0).abs() < 0.01, "{}", answer.motion * extent);
    assert_eq!(answer.verdict, Verdict::Confirmed);
}

struct Full;

impl Observer for Full {
    type Records = ();

    fn begin(&mut self, _: &Monitor) -> Result<()> {
        Ok(())
    }

    fn record(&mut self, (): &mut (), number: u64, _: &State, _: &Monitor) -> Result<()> {
        if number < 3 { Ok(()) } else { Err(Error::Unsupported("the disk is full".into())) }
    }
}

#[test]
fn an_error_of_the_observer_ends_the_search() {
    let (system, start) = oscillator();
    let error = run_to_accuracy(&system, &start, &options(1e-3), &mut Full, &|| true).unwrap_err();
    assert!(error.to_string().contains("the disk is full"), "{error}");
}
