use super::*;
use crate::integrate::ImplicitOptions;
use crate::integrate::fixtures::scene;
use crate::spring::Spring;
use crate::system::fixtures::tethered;

/// Two free particles on a chain from the origin, with weight and damping.
fn chain() -> (System, State) {
    let particles = [([0.0; 3], 7.0), ([2.0, 0.0, 0.0], 2.0), ([2.0, 3.0, 0.0], 0.5)];
    let mut builder = scene(&particles, &[(0, 1, [100.0, 2.0, 4.0]), (1, 2, [30.0, 4.0, 3.0])]);
    builder.gravity(3.0, -10.0, 0.0).hold(0);
    let (system, mut state) = builder.build().unwrap();
    state.velocities[1] = Vector3::new(0.0, 1.0, 0.0);
    state.velocities[2] = Vector3::new(0.0, 0.0, 2.0);
    (system, state)
}

fn newton<'s>(system: &'s System, state: &State, policy: impl Into<StiffnessPolicy>) -> Newton<'s> {
    let options = ImplicitOptions { stiffness: policy.into(), ..ImplicitOptions::default() };
    Newton::new(LinearSystem::new(system, state, &options).unwrap(), state, NewtonOptions::default()).unwrap()
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-12 * b.abs()
}

/// Everything that an evaluation gives, by hand.
#[test]
fn the_potential_its_slope_and_the_work_of_damping() {
    let (system, state) = chain();
    let mut newton = newton(&system, &state, Stiffness::Full);
    newton.displacement[1] = Vector3::new(0.5, 0.0, 0.0);
    newton.displacement[2] = Vector3::new(1.0, 1.0, 0.0);
    newton.direction[1] = Vector3::new(1.0, 0.0, 0.0);
    newton.direction[2] = Vector3::new(0.0, 2.0, 0.0);
    // To (3, 0, 0) at (2, 0, 0) m/s and to (3, 5, 0) at (2, 4, 0) m/s.
    let point = newton.evaluate(&state, 0.5, 0.5).unwrap();
    // Inertia 5 + 6, weight −6 + 8.5, springs 25 + 3.75.
    assert!(close(point.potential, 42.25), "{}", point.potential);
    let (a, b) = (Vector3::new(-60.0, 3.5, 0.0), Vector3::new(-0.5, -28.5, 2.0));
    assert!((newton.force[1] - a).norm() < 1e-12 && (newton.force[2] - b).norm() < 1e-12, "{:?}", newton.force);
    assert!(close(point.residual, a.norm().hypot(b.norm())));
    assert!(close(point.slope, 60.0 + 2.0 * 28.5), "{}", point.slope);
    // The same without the potential, at the same place.
    let force = newton.force.clone();
    newton.move_by(0.5);
    assert!(close(newton.residual(&state, 0.5).unwrap(), point.slope));
    assert!(force.iter().zip(&newton.force).all(|(a, b)| (a - b).norm() < 1e-12));
    assert!(close(point.damping_slope, 8.0 + 2.0 * 12.0), "{}", point.damping_slope);
    // Magnitudes of the terms; differences of velocities, 2·√5·(1 + 2) and 0.5·√24·(2 + √20); forces of springs on positions.
    let inertia = 6.0 * 5f64.sqrt() + 0.5 * 24f64.sqrt() * (2.0 + 20f64.sqrt());
    let springs = 50.0 * 3.0 + 7.5 * (3.0 + 34f64.sqrt());
    let noise = NOISE * 54.25 + f64::EPSILON * (inertia + springs);
    assert!(close(point.noise, noise), "{:e} {noise:e}", point.noise);
}

/// Forces whose squares overflow, energies that do though their forces do not, and slopes.
#[test]
fn what_overflows_is_refused() {
    for (stiffness, rest_length, length) in [(1e160, 1.0, 2.0), (1e-50, 1.0, 1e200)] {
        let (system, mut state) = tethered(1.0, 1.0, Spring { stiffness, rest_length, damping: 0.0 });
        let mut newton = newton(&system, &state, Stiffness::Full);
        assert!(newton.evaluate(&state, 1.0, 0.0).is_ok());
        // At this length from the start on, so that inertia has no part in it.
        state.positions[1].x = length;
        assert_eq!(newton.evaluate(&state, 1.0, 0.0).err(), Some(StepFailure::NonFinite), "{stiffness:e}");
    }
    let (system, state) = weight(36.0, 1.0);
    let mut newton = newton(&system, &state, Stiffness::Full);
    newton.displacement[1] = Vector3::new(0.25, 0.0, 0.0);
    assert!(newton.residual(&state, 0.5).is_ok());
    newton.direction[1] = Vector3::repeat(1e308);
    assert_eq!(newton.residual(&state, 0.5), Err(StepFailure::NonFinite));
}

/// A weight on a spring from the origin at its rest length of 1 m.
fn weight(stiffness: f64, speed: f64) -> (System, State) {
    let (system, mut state) = tethered(1.0, 1.0, Spring { stiffness, rest_length: 1.0, damping: 0.0 });
    state.velocities[1].x = speed;
    (system, state)
}

/// However much that stretches the spring; displacements and directions of an earlier step do not matter.
#[test]
fn it_starts_from_the_predicted_state() {
    for stiffness in [1e-3, 5.0, 1e6] {
        let (system, state) = weight(stiffness, 1.0);
        let mut newton = newton(&system, &state, Stiffness::Full);
        newton.displacement[1] = Vector3::repeat(9.0);
        newton.direction[1] = Vector3::repeat(9.0);
        let point = newton.start(&state, 0.5, 1.0).unwrap();
        assert_eq!(newton.displacement[1], Vector3::new(0.5, 0.0, 0.0));
        // U = ½ k 0.5², and no change of velocity.
        assert!(close(point.potential, 0.125 * stiffness), "{}", point.potential);
        assert_eq!(newton.linear.statistics.work.force_evaluations, 1);
    }
    // The predicted state would collapse the spring: the step is solved from rest.
    let (system, state) = weight(1e-3, -2.0);
    let mut newton = newton(&system, &state, Stiffness::Full);
    assert!(newton.start(&state, 0.5, 1.0).is_err());
    newton.solve(&state, 0.5).unwrap();
    let residual = newton.evaluate(&state, 0.5, 0.0).unwrap().residual;
    assert!(residual < 1e-9, "{residual:e}");
}

/// A refinement ends where the next correction would be smaller than the last, not more: it takes fewer iterations than a
/// solution, and is none. After a short step one is enough.
#[test]
fn refinements_end_early() {
    let (system, state) = chain();
    let mut newton = newton(&system, &state, Stiffness::Tension);
    let mut solve = |dt: f64, ends_early: bool| {
        let before = newton.linear.statistics.work.newton_iterations;
        let start = newton.start(&state, dt, 1.0).unwrap();
        if ends_early {
            newton.refine(&state, dt).unwrap();
        } else {
            newton.iterate(start, &state, dt, Stiffness::Tension.into(), false).unwrap();
        }
        let residual = newton.evaluate(&state, dt, 0.0).unwrap().residual;
        (newton.linear.statistics.work.newton_iterations - before, residual / start.residual)
    };
    assert_eq!(solve(0.1, true).0, 1);
    assert!(solve(0.1, false).0 > 2);
    let ((early, left), (whole, nothing)) = (solve(0.5, true), solve(0.5, false));
    assert!(early < whole && nothing < 1e-8 && (1e-3..1.0).contains(&left), "{early} {left:e} {whole} {nothing:e}");
}

/// `‖J Δ + r‖ ≤ η‖r‖` with the derivative of the residual taken by differences, springs that turn included.
#[test]
fn directions_solve_the_damped_equations_to_the_forcing_term() {
    let (system, state) = chain();
    let mut newton = newton(&system, &state, Stiffness::Full);
    let dt = 0.05;
    newton.start(&state, dt, 1.0).unwrap();
    let force = newton.force.clone();
    for eta in [1e-1, 1e-3, 1e-5, 1e-7] {
        newton.evaluate(&state, dt, 0.0).unwrap();
        let mut choice = MatrixChoice::new(Stiffness::Full.into());
        let [slope, damping_slope] = newton.prepare_direction(&mut choice, Combination::step(dt), eta).unwrap();
        assert!(close(slope, -dot(&system, &force, &newton.direction)));
        let h = 1e-4;
        let point = newton.evaluate(&state, dt, h).unwrap();
        let ahead = newton.force.clone();
        newton.evaluate(&state, dt, -h).unwrap();
        let change = ahead.iter().zip(&newton.force).map(|(a, b)| (a - b) / (2.0 * h));
        let left: Vec<Vector3<f64>> = change.zip(&force).map(|(change, force)| change + force).collect();
        let part = free_norm(&system, &left) / free_norm(&system, &force);
        assert!(part <= eta + 1e-7, "{eta:e}: {part:e}");
        // Only as far as is asked for.
        assert!(part >= 1e-3 * eta, "{eta:e}: {part:e}");
        assert!((damping_slope - point.damping_slope).abs() <= 1e-3 * damping_slope.abs());
    }
}

/// Invalid options are refused; the residual left after a solution is recorded.
#[test]
fn steps_are_solved_to_the_tolerance() {
    let is_valid = |tolerance| NewtonOptions { tolerance, ..NewtonOptions::default() }.check().is_ok();
    assert_eq!([0.0, 1e-3, -1e-300, f64::INFINITY, f64::NAN].map(is_valid), [true, true, false, false, false]);
    let (system, state) = chain();
    let mut newton = newton(&system, &state, StiffnessPolicy::OnDemand);
    newton.options.tolerance = 1e-3;
    newton.solve(&state, 0.5).unwrap();
    let Newton { linear, trial, term, force, .. } = &mut newton;
    let balance = ForceBalance::new(&system, &linear.extensions, [&state, trial], 0.5, term);
    let recorded = linear.statistics.max_relative_residual;
    assert_eq!(recorded, free_norm(&system, force) / balance.forces);
    assert!(recorded > 0.0 && recorded < 1e-3, "{recorded:e}");
}

/// A compressed spring takes 1.5 N/m across, more than the mass gives: masses are raised in steps of four.
#[test]
fn masses_are_raised_where_nothing_else_is_left() {
    let (system, state) = tethered(1.0, 1.0, Spring { stiffness: 3.0, rest_length: 2.0, damping: 0.0 });
    let mut newton = newton(&system, &state, Stiffness::Full);
    newton.evaluate(&state, 1.0, 0.0).unwrap();
    newton.force[1] = Vector3::new(0.0, 2.0, 0.0);
    let mut choice = MatrixChoice::new(Stiffness::Full.into());
    let outcome = newton.prepare_direction(&mut choice, Combination::step(1.0), 0.0);
    assert!(matches!(outcome, Err(SolveFailure::Indefinite(_))), "{outcome:?}");
    let mut choice = MatrixChoice::new(StiffnessPolicy::OnDemand);
    while let NewtonMatrix::Policy(_) = choice.matrix {
        choice.record(1.0, 1.0, true);
    }
    newton.prepare_direction(&mut choice, Combination::step(1.0), 0.0).unwrap();
    let shift = 1e-4 * 4f64.powi(7);
    assert!(matches!(choice.matrix, NewtonMatrix::Shifted(by) if close(by, shift)), "{:?}", choice.matrix);
    assert!((newton.direction[1] - Vector3::new(0.0, 2.0 / (1.0 + shift - 1.5), 0.0)).norm() < 1e-12);
}

/// Steps are shortened where the spring would collapse, and where φ would rise above the highest that counts.
#[test]
fn line_searches_shorten_steps() {
    let (system, state) = tethered(1.0, 1.0, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
    let mut newton = newton(&system, &state, Stiffness::Full);
    let high = Point { residual: 1.0, potential: 1e9, noise: 0.0, slope: -1.0, damping_slope: 0.0 };
    newton.direction[1].x = -1.0;
    let (step, _) = newton.line_search(&state, 1.0, high, high.potential).unwrap();
    assert_eq!((step, newton.displacement[1].x), (0.5, -0.5));
    // Φ = u² here, for a displacement u along the axis: from u = −1/2 a step of 3 ends at 2.5, its slope's zero is at 1/6.
    newton.direction[1].x = 3.0;
    let from = newton.evaluate(&state, 1.0, 0.0).unwrap();
    let (step, point) = newton.line_search(&state, 1.0, from, from.potential).unwrap();
    assert!(close(step, 1.0 / 6.0) && newton.displacement[1].x.abs() < 1e-15 && point.potential < 1e-30, "{step}");
    // Below what an earlier iteration had, φ may rise: to 6.25.
    newton.displacement[1].x = -0.5;
    let from = newton.evaluate(&state, 1.0, 0.0).unwrap();
    let (step, point) = newton.line_search(&state, 1.0, from, 7.0).unwrap();
    assert_eq!((step, point.potential), (1.0, 6.25));
}
