//! Which steps a corner parts from the one before, and residuals of states that solve nothing, by hand.

use super::*;
use crate::integrate::{Method, StiffnessPolicy};
use crate::spring::Spring;
use crate::system::{Axes, Constraint, SystemBuilder};
use crate::verify::fixtures;

/// Steps of half a second around t = 1 s; times within 5e-10 s are the same. A corner at the beginning of the step or within it parts
/// it from the one before, and so does one within the one before; not if both have one.
#[test]
fn a_corner_parts_two_steps() {
    let parted = |corners: &[f64]| {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        let motion = Motion::Path { times: corners.to_vec(), offsets: vec![Vector3::zeros(); corners.len()] };
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
        let (system, state) = builder.build().unwrap();
        is_parted(&TestCase { name: "led".into(), system, state, dt: 0.5 }, 1.0, 0.5)
    };
    let alone = |corner: f64| parted(&[corner, 100.0]);
    assert_eq!([1.0, 1.2, 1.5 - 1e-9, 0.7, 0.5 + 1e-9, 1.0 - 1e-9].map(alone), [true; 6]);
    assert_eq!([1.5, 1.0 + 0.5 - 5e-10, 1.7, 0.5, 0.2].map(alone), [false; 5]);
    assert_eq!([parted(&[0.5, 1.2]), parted(&[0.7, 1.2]), parted(&[0.5, 1.0])], [false; 3]);
    assert_eq!([parted(&[0.2, 1.2]), parted(&[0.2, 0.7]), parted(&[1.0, 1.5])], [true; 3]);
}

fn line(positions: [f64; 3], velocities: [f64; 3]) -> State {
    let along = |numbers: [f64; 3]| numbers.map(|x| Vector3::new(x, 0.0, 0.0)).to_vec();
    State { time: 0.0, positions: along(positions), velocities: along(velocities) }
}

fn is(value: f64, expected: f64) {
    assert!((value / expected - 1.0).abs() < 1e-12, "{value:e} is not {expected:e}");
}

/// Masses of 2, 1 and 5 kg at 1, 4 and 9 m, the last one held; springs of k = 4 N, l0 = 2 m, b = ½ and of k = 12 N, l0 = 4 m,
/// b = 1 N·s/m; gravity is −2 m/s².
///
/// ```text
/// f_el = 2, 1, −3      f_d = −1.5, 7.5, −6      magnitudes: pull 10, 37, 27, damping 1.5, 7.5, 6, reach 50/3 and 70.2
/// ```
#[test]
fn the_equations_of_a_step_by_hand() {
    let mut builder = fixtures::line();
    builder.hold(2);
    let (system, state) = builder.build().unwrap();
    let subject = TestCase { name: "line".into(), system, state, dt: 0.5 };
    let prediction = line([1.0, 4.0, 9.0], [1.0, -2.0, 4.0]);
    let formula = Formula { tau: 0.5, base: line([1.0, 4.0, 9.0], [0.0, -1.0, 4.0]), prediction };
    let (rows, sizes) = residual(&subject, &formula, &formula.prediction);
    // M (v − ṽ)/τ = 4, −2, 0 and m gravity = −4, −2, −10.
    assert_eq!([rows[0].x, rows[1].x], [4.0 - 2.0 + 1.5 + 4.0, -2.0 - 1.0 - 7.5 + 2.0]);
    let reach = [50.0 / 3.0, 50.0 / 3.0 + 70.2, 70.2];
    let others = [10.0 + 1.5 + 4.0 + 4.0, 37.0 + 7.5 + 6.0 + 2.0, 27.0 + 6.0 + 80.0 + 10.0];
    (0..3).for_each(|p| is(sizes[p], others[p] + reach[p]));
    // x' − y is 1 and 2 m: M/τ² of it is 8 and 8, −G/τ of it −1 and 5.
    let after = line([2.0, 6.0, 12.0], [3.0, 0.0, 0.0]);
    let value = linear_rows(&subject, &formula, &after, &[Vector3::zeros(); 3]);
    // The row of the second particle: 1/dt² + 2√3 ((4/2 + 4/3 + ½/dt) + (12/4 + 12/5 + 1/dt)); the third one is held.
    let matrix = 4.0 + 2.0 * (2.0 + 4.0 / 3.0 + 1.0 + 7.4) * 3f64.sqrt();
    is(value, (7.5 + 8.0 - 1.0) / (U * (matrix * (2.0 + 12.0) + others[2] + reach[2])));
    // The second particle goes 2 m in ½ s, and has no velocity; the first one's is off by 1 m/s.
    is(velocity_error(&subject, &formula, &after), 4.0 / (U * (6.0 + 8.0) / 0.5));
}

/// A spring of k = 6 N at its rest length of 2 m has no force before; after a step of ½ m the residual is 8 + 1.5 N on 4 kg, with
/// magnitudes of `10.5 + 31.5 + 8` N.
#[test]
fn what_is_left_is_measured_by_rounding_where_nothing_was_there_before() {
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    for (x, mass) in [(1.0, 4.0), (3.0, 1.0)] {
        builder.particle([x, 0.0, 0.0], mass);
    }
    builder.spring(0, 1, Spring { stiffness: 6.0, rest_length: 2.0, damping: 0.0 });
    builder.hold(1);
    let (system, state) = builder.build().unwrap();
    let subject = TestCase { name: "pair".into(), system, state: state.clone(), dt: 0.5 };
    let mut after = state.clone();
    after.positions[0].x = 1.5;
    let formula = Formula { tau: 0.5, base: state.clone(), prediction: state };
    let rounding = 30.0 * U * 50.0 / 2.0 + 30.0 * U * 4.0 * 1.5 / 0.25 / 2.0;
    is(left(&subject, &formula, &after), 9.5 / 2.0 / (rounding / 0.5));
}

/// Steps along a curve meet their own equations, under every option.
#[test]
fn steps_meet_their_own_equations() {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.5, -9.0, 0.25);
    for n in 0..5 {
        let t = f64::from(n);
        let particle = builder.particle([1.1 * t, (0.9 * t).sin(), (0.7 * t).cos()], 1.0 + 0.1 * t);
        if n > 0 {
            builder.spring(
                particle - 1,
                particle,
                Spring { stiffness: 40.0, rest_length: 1.0 + 0.1 * t, damping: 0.5 },
            );
        }
    }
    builder.hold(0);
    let (system, state) = builder.build().unwrap();
    let subject = TestCase { name: "chain".into(), system, state, dt: 0.1 };
    for stiffness in [StiffnessPolicy::Always(crate::spring::Stiffness::Tension), StiffnessPolicy::OnDemand] {
        let found = checks(&subject, Way { method: Method::Bdf2, stiffness }).unwrap();
        assert_eq!(found.len(), if stiffness == StiffnessPolicy::OnDemand { 2 } else { 3 });
        assert!(found.iter().all(Check::passed), "{found:?}");
    }
}
