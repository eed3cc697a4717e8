//! Error control of the second-order backward differentiation formula where prescribed paths have kinks.

use nalgebra::Vector3;
use sprung::integrate::{AdaptiveOptions, ImplicitOptions, Method, OutputTimes, run_adaptive};
use sprung::system::Axes;
use sprung::{Constraint, Motion, Spring, SystemBuilder};
use std::ops::ControlFlow;

/// Velocities of prescribed particles jump at kinks; that is no error of a step that ends there, however short.
#[test]
fn steps_end_at_kinks_and_go_on() {
    let mut builder = SystemBuilder::new();
    for x in [0.0, 1.0, 2.0] {
        builder.particle([x, 0.0, 0.0], 1.0);
    }
    for i in 0..2 {
        builder.spring(i, i + 1, Spring { stiffness: 500.0, rest_length: 1.1, damping: 0.5 });
    }
    let offsets = [[0.0; 3], [0.1, 0.2, 0.0], [-0.1, 0.0, 0.0]].map(Vector3::from).to_vec();
    let motion = Motion::Path { times: vec![0.1, 0.4, 0.7], offsets };
    builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
    builder.gravity(0.0, -9.81, 0.0);
    let (system, start) = builder.build().unwrap();
    let end = |method: Method, rtol| {
        let mut state = start.clone();
        let options = ImplicitOptions::default();
        let mut stepper = method.adaptive_stepper(&system, &start, &options).unwrap().unwrap();
        let how =
            AdaptiveOptions { duration: 1.0, rtol, first_step: None, sampling: OutputTimes::Steps, part_of: None };
        let outcome = run_adaptive(&mut *stepper, &system, &mut state, &how, |_, _| ControlFlow::Continue(()));
        assert!(outcome.end.is_ok(), "{}: {outcome:?}", method.name());
        state
    };
    let truth = end(Method::Dop853, 1e-9);
    let apart = |rtol| {
        let found = end(Method::Bdf2, rtol);
        let squares = found.positions.iter().zip(&truth.positions).map(|(a, b)| (a - b).norm_squared());
        squares.sum::<f64>().sqrt()
    };
    for rtol in [1e-2, 1e-3, 1e-4] {
        let error = apart(rtol);
        assert!(error < 10.0 * rtol, "{rtol:e}: {error:e}");
    }
}
