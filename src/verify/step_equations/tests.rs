//! Residuals of states that solve nothing, on three particles along a line: large, and worked out by hand.

use super::*;
use crate::system::{Axes, Constraint};
use crate::verify::fixtures::{self, assert_close, case, chain, line_state as state, moved, pair, path};

const DT: f64 = 0.5;

/// Masses of 2, 1 and 5 kg at 1, 4 and 9 m with velocities of 1, −2 and 4 m/s, the last one prescribed; springs of k = 4 N,
/// l0 = 2 m, b = ½ and of k = 12 N, l0 = 4 m, b = 1 N·s/m. Their lengths are 3 m and 5 m; gravity is −2 m/s².
///
/// ```text
/// k/l0 = 2 and 3        f_el = 2, 1, −3        f_d = −1.5, 7.5, −6        m gravity = −4, −2, −10
/// ```
fn line(motion: Motion) -> TestCase {
    let mut builder = fixtures::line();
    builder.constrain(Constraint { particles: vec![2], axes: Axes::of(&[0]), motion });
    TestCase { state: state(0.0, [1.0, 4.0, 9.0], [1.0, -2.0, 4.0]), ..case(builder, DT) }
}

/// A state that solves none of the equations.
fn after() -> State {
    state(DT, [2.0, 6.0, 12.0], [3.0, -1.0, 6.0])
}

/// With v' = 3, −1 and 4: `K δx = −4, 11.5` and `G v' = −2, 7` on the free particles. The step of the third one, 2 m, is known: its
/// `3 · 2 + 1 · 4 = 10` belong to b. The magnitudes in b are largest on the third, `5 (4/dt + 2) + 12 (5 + 4)/4 = 77`, and those
/// in A on the second, `1/dt² + 2√3 (4/2 + 4/3 + ½/dt + 12/4 + 12/5 + 1/dt)`.
#[test]
fn the_linear_residual_by_hand() {
    let case = line(Motion::Held);
    let after = state(DT, [0.0; 3], [3.0, -1.0, 4.0]);
    let residual = linear_residual(&case, Stiffness::Axial, DT, &case.state, &after);
    assert_eq!(residual.rows, [2.0 - 12.0 - 4.0 - 2.0, -5.0 + 2.0 + 11.5 + 7.0]);
    assert_eq!(residual.right_hand_side, [2.0, -5.0 + 10.0]);
    let matrix = 4.0 + 2.0 * (2.0 + 4.0 / 3.0 + 1.0 + 7.4) * 3f64.sqrt();
    assert_close(residual.unit, U * (matrix * 2.0 + 77.0));
}

/// The largest of the rows 3 and −4, and their norm 5 over 1e-10 ‖b‖ and 30 units a row.
#[test]
fn residuals_are_weighed_by_rounding_or_by_the_tolerance() {
    let residual = Residual { rows: vec![3.0, -4.0, 0.0, 0.0], right_hand_side: vec![6.0, 8.0], unit: 1e-11 };
    assert_close(residual.in_units(), 4e11);
    assert_close(residual.over_tolerance(), 5.0 / (10e-10 + 30.0 * 1e-11 * 2.0));
}

/// At x' and v': `f_el = 4, 2`, `f_d = −2, 9`, magnitudes of 18 and 53 N, 34 and 59 with inertia.
#[test]
fn the_residual_over_newtons_tolerance_by_hand() {
    let case = line(Motion::Held);
    // M (v' − v)/dt − f = 8 + 2 and 2 − 9.
    let rows = 10f64.hypot(-7.0);
    // (k/l0 + k/l)(|x_i| + |x_j|) of the springs is 3 · 8 and 5 · 18.
    let rounding = (24f64.powi(2) + 114f64.powi(2) + 90f64.powi(2)).sqrt();
    let expected = rows / (1e-10 * 34f64.hypot(59.0) + UNITS * U * rounding);
    assert_close(newton_error(&case, DT, &case.state, &after()), expected);
}

/// The velocities predicted for the second force are 1/8, 5/4 and 4 m/s: it is 0.5625 and 2.1875 N, with magnitudes of 16.6875 and
/// 49.9375 N. In the first step the velocities are the worse, in the second the positions.
#[test]
fn the_residual_of_verlets_method_by_hand() {
    let case = line(Motion::Held);
    let error = |after: State| verlet_error(&case, DT, &[case.state.clone(), after]);
    let speeds = 9.46875f64.hypot(-2.34375) / (UNITS * U * 48.1875f64.hypot(102.4375));
    assert_close(error(after()), speeds);
    let places = 5.75f64.hypot(8.75) / (UNITS * U * (36.1875 + 24.0f64).hypot(104.4375 + 40.0));
    assert_close(error(state(DT, [2.0, 6.0, 12.0], [0.0, 2.0, 6.0])), places);
}

/// A step is passed over if a path has its corner within it or at its end, and so are all that follow; a corner where it begins, or a
/// little after its end, does not matter.
#[test]
fn steps_over_a_corner_of_a_path_are_passed_over() {
    let error = |corner: f64, steps: usize| {
        let case = line(path(&[corner, 100.0]));
        let mut states = [case.state.clone(), after(), case.state.clone()];
        states.iter_mut().zip([0.5, 1.0, 1.5]).for_each(|(state, time)| state.time = time);
        verlet_error(&case, DT, &states[..=steps])
    };
    let whole = error(50.0, 1);
    assert!(whole > 1.0);
    assert_eq!([0.25, 0.5, 0.75, 1.0, 1.0 + 1e-9, 1.25].map(|t| error(t, 1)), [whole, whole, 0.0, 0.0, whole, whole]);
    assert_eq!([0.75, 1.0, 1.25, 1.5].map(|t| error(t, 2)), [0.0, 0.0, whole, whole]);
    assert!(error(0.5, 2) > 1.2 * whole);
}

/// The positions of the first particle are worst: 1 m and v = 1, then 3 m and v = 3.
#[test]
fn positions_follow_the_old_the_new_or_the_mean_velocity() {
    let case = line(Motion::Held);
    let after = state(DT, [3.0, 3.75, 11.0], [3.0, -1.0, 4.0]);
    let error = |method| displacement_error(&case, method, DT, &case.state, &after);
    assert_close(error(Method::SymplecticEuler), 0.5 / (6.0 * U));
    assert_close(error(Method::ForwardEuler), 1.5 / (6.0 * U));
    assert_close(error(Method::ImplicitMidpoint), 1.0 / (6.0 * U));
}

/// Every method but those of several stages is put into its own equations; linear backward Euler has a family of its own.
#[test]
fn every_method_is_put_into_its_own_equations() {
    let checks = others(&chain(5, 0.2)).unwrap();
    let residuals: Vec<&str> = checks.iter().filter_map(|c| c.name.strip_prefix("residual of a step, ")).collect();
    let own = ["backward-euler", "implicit-midpoint", "verlet", "forward-euler", "symplectic-euler"];
    assert_eq!(residuals, [&own[..], &["bdf2, full", "bdf2, tension", "bdf2, axial", "bdf2, absolute"]].concat());
    let moved: Vec<&str> = checks.iter().filter_map(|c| c.name.strip_prefix("x' = x + dt v, ")).collect();
    let linear =
        ["full", "tension", "axial", "absolute", "on-demand"].map(|option| format!("linear-backward-euler, {option}"));
    let linear: Vec<&str> = linear.iter().map(String::as_str).collect();
    assert_eq!(
        moved,
        [&linear[..], &["backward-euler", "implicit-midpoint", "forward-euler", "symplectic-euler"]].concat()
    );
    assert!(checks.iter().all(Check::passed));
    let why = |name: &str| checks.iter().find(|c| c.name.ends_with(name)).map(|c| c.why.contains("Newton")).unwrap();
    assert!(why("a step, backward-euler") && !why("a step, verlet"));
}

/// Steps of half a second around t = 1 s; times within 5e-10 s are the same. A corner at the beginning of the step or within it parts
/// it from the one before, and so does one within the one before; not if both have one.
#[test]
fn a_corner_parts_two_steps() {
    let parted = |corners: &[f64]| starts_afresh(&moved(path(corners), 0.5), 1.0, 0.5);
    let alone = |corner: f64| parted(&[corner, 100.0]);
    assert_eq!([1.0, 1.2, 1.5 - 1e-9, 0.7, 0.5 + 1e-9, 1.0 - 1e-9].map(alone), [true; 6]);
    assert_eq!([1.5, 1.0 + 0.5 - 5e-10, 1.7, 0.5, 0.2].map(alone), [false; 5]);
    assert_eq!([parted(&[0.5, 1.2]), parted(&[0.7, 1.2]), parted(&[0.5, 1.0])], [false; 3]);
    assert_eq!([parted(&[0.2, 1.2]), parted(&[0.2, 0.7]), parted(&[1.0, 1.5])], [true; 3]);
}

/// The magnitudes are: pull 10, 37, 27, damping 1.5, 7.5, 6, stiffness times positions 50/3 and 70.2.
#[test]
fn the_equations_of_bdf2_by_hand() {
    let case = line(Motion::Held);
    let base = state(0.0, [1.0, 4.0, 9.0], [0.0, -1.0, 4.0]);
    let step = Bdf2Step { tau: 0.5, base, prediction: case.state.clone() };
    let (rows, sizes) = step.residual(&case, &step.prediction);
    // M (v − ṽ)/τ = 4, −2, 0 and m gravity = −4, −2, −10.
    assert_eq!([rows[0].x, rows[1].x], [4.0 - 2.0 + 1.5 + 4.0, -2.0 - 1.0 - 7.5 + 2.0]);
    let reach = [50.0 / 3.0, 50.0 / 3.0 + 70.2, 70.2];
    let others = [10.0 + 1.5 + 4.0 + 4.0, 37.0 + 7.5 + 6.0 + 2.0, 27.0 + 6.0 + 80.0 + 10.0];
    (0..3).for_each(|p| assert_close(sizes[p], others[p] + reach[p]));
    // x' − y is 1 and 2 m: M/τ² of it is 8 and 8, −G/τ of it −1 and 5.
    let after = state(0.0, [2.0, 6.0, 12.0], [3.0, 0.0, 0.0]);
    let value = step.linear_error(&case, &after, &[Vector3::zeros(); 3]);
    // The row of the second particle: 1/dt² + 2√3 ((4/2 + 4/3 + ½/dt) + (12/4 + 12/5 + 1/dt)); the third one is held.
    let matrix = 4.0 + 2.0 * (2.0 + 4.0 / 3.0 + 1.0 + 7.4) * 3f64.sqrt();
    assert_close(value, (7.5 + 8.0 - 1.0) / (U * (matrix * (2.0 + 12.0) + others[2] + reach[2])));
    // The second particle goes 2 m in ½ s, and has no velocity; the first one's is off by 1 m/s.
    assert_close(step.velocity_error(&case, &after), 4.0 / (U * (6.0 + 8.0) / 0.5));
}

/// A spring of k = 100 N at its rest length of 1 m has no force before; after a step of ½ m the residual is 2 + 50 N on 1 kg, with magnitudes of
/// `250 + 250 + 2` N along each axis.
#[test]
fn a_residual_from_nothing_is_compared_with_rounding() {
    let case = pair(1.0, 0.5);
    let mut after = case.state.clone();
    after.positions[1].x = 1.5;
    let step = Bdf2Step { tau: 0.5, base: case.state.clone(), prediction: case.state.clone() };
    let rounding = 30.0 * U * (502.0 + 1.5 / 0.25) * 3f64.sqrt();
    assert_close(step.contraction(&case, &after), 52.0 / (rounding / 0.5));
}
