//! This crate's methods beside general-purpose integrators of other libraries, on the same scenes, machine and error norm.
//!
//! Peers are the BDF method and the ESDIRK method of `diffsol` (variable step, dense LU, Jacobian products from K and G as
//! this crate has them) and DOP853 of `ode_solvers`. Prints a Markdown table: for each scene and method the error at the end and
//! the best of three times.

use diffsol::{NalgebraLU, NalgebraMat, OdeBuilder, OdeSolverMethod, OdeSolverStopReason, VectorCommon};
use nalgebra::Vector3;
use sprung::accuracy::{Configuration, Pace, relative_position_error, trial};
use sprung::chart::{Reference, dop853};
use sprung::force::{Extensions, add_damping_force, add_elastic_force, add_weight};
use sprung::integrate::{ImplicitOptions, Method};
use sprung::operator::{Combination, LinearOperator, SystemOperator};
use sprung::scene::{Kind, Scene, builtin};
use sprung::{State, Stiffness, System};
use std::path::Path;
use std::time::{Duration, Instant};

type Failure = Box<dyn std::error::Error>;

/// M⁻¹ on a reduced vector.
fn accelerate(system: &System, force: &mut [f64]) {
    for (f, dof) in force.iter_mut().zip(system.dofs().iter()) {
        *f /= system.masses()[dof.particle];
    }
}

fn state_at(system: &System, start: &State, t: f64, y: &[f64]) -> State {
    let mut state = start.clone();
    let (x, v) = y.split_at(system.dofs().len());
    state.time = t;
    state.prescribe(system);
    system.dofs().scatter(x, &mut state.positions);
    system.dofs().scatter(v, &mut state.velocities);
    state
}

/// `(x, v)' = (v, M⁻¹ f)`.
fn right_hand_side(system: &System, start: &State, t: f64, y: &[f64], dy: &mut [f64]) {
    let n = system.dofs().len();
    let state = state_at(system, start, t, y);
    let Ok(extensions) = Extensions::at(system, &state.positions) else { return dy.fill(f64::NAN) };
    let mut force = vec![Vector3::zeros(); system.particles()];
    add_elastic_force(system, &extensions, &mut force);
    add_damping_force(system, &extensions, &state.velocities, &mut force);
    add_weight(system, &mut force);
    dy[..n].copy_from_slice(&y[n..]);
    system.dofs().gather(&force, &mut dy[n..]);
    accelerate(system, &mut dy[n..]);
}

/// `(w_v, M⁻¹ (K w_x + G w_v))`.
fn jacobian_product(system: &System, start: &State, t: f64, y: &[f64], w: &[f64], out: &mut [f64]) {
    let n = system.dofs().len();
    let state = state_at(system, start, t, y);
    let Ok(extensions) = Extensions::at(system, &state.positions) else { return out.fill(f64::NAN) };
    let product = |combination, w: &[f64], out: &mut [f64]| {
        SystemOperator::new(system, &extensions, Stiffness::Full, combination).apply(w, out);
    };
    let mut damping = vec![0.0; n];
    product(Combination::DAMPING, &w[n..], &mut damping);
    out[..n].copy_from_slice(&w[n..]);
    product(Combination::STIFFNESS, &w[..n], &mut out[n..]);
    out[n..].iter_mut().zip(damping).for_each(|(a, b)| *a += b);
    accelerate(system, &mut out[n..]);
}

fn diffsol(system: &System, start: &State, duration: f64, rtol: f64, bdf: bool) -> Result<State, Failure> {
    let n = system.dofs().len();
    let mut first = vec![0.0; 2 * n];
    system.dofs().gather(&start.positions, &mut first[..n]);
    system.dofs().gather(&start.velocities, &mut first[n..]);
    let problem = OdeBuilder::<NalgebraMat<f64>>::new()
        .rtol(rtol)
        .atol([1e-2 * rtol])
        .h0(1e-4 * duration)
        .rhs_implicit(
            |y: &[f64], _: &[f64], t, dy: &mut [f64]| right_hand_side(system, start, t, y, dy),
            |y: &[f64], _: &[f64], t, w: &[f64], out: &mut [f64]| jacobian_product(system, start, t, y, w, out),
        )
        .init(|_: &[f64], _, y: &mut [f64]| y.copy_from_slice(&first), 2 * n)
        .build()?;
    macro_rules! run {
        ($solver:expr) => {{
            let mut solver = $solver;
            solver.set_stop_time(duration)?;
            while !matches!(solver.step()?, OdeSolverStopReason::TstopReached) {}
            let y = solver.interpolate(duration)?;
            Ok(state_at(system, start, duration, y.inner().as_slice()))
        }};
    }
    if bdf { run!(problem.bdf::<NalgebraLU<f64>>()?) } else { run!(problem.esdirk34::<NalgebraLU<f64>>()?) }
}

/// The best of three times, and the last result.
fn timed(run: impl Fn() -> Result<State, Failure>) -> (f64, Result<State, Failure>) {
    let once = || {
        let clock = Instant::now();
        let result = run();
        (clock.elapsed().as_secs_f64(), result)
    };
    let (first, result) = once();
    (once().0.min(once().0).min(first), result)
}

fn main() -> Result<(), Failure> {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../verification/scenes");
    let mut cloth = builtin(Kind::Cloth, 6)?;
    cloth.time.duration = Some(0.2);
    println!("| scene | method | error | time, ms |\n|---|---|---|---|");
    for scene in
        [Scene::load(scenes.join("stiff_pendulum.toml"))?, Scene::load(scenes.join("tetrahedron.toml"))?, cloth]
    {
        let (system, start) = scene.build()?;
        let (dt, duration) = scene.time.dt.zip(scene.time.duration).ok_or("a scene without time")?;
        let reference = Reference::compute(&system, &start, [dt, duration], Duration::from_secs(60))?.ok_or("none")?;
        let report = |name: String, run: &dyn Fn() -> Result<State, Failure>| {
            let (seconds, result) = timed(run);
            let error = match result {
                Ok(state) => {
                    let positions = &reference.state.positions;
                    format!("{:.1e}", relative_position_error(&state.positions, positions, &start.positions))
                }
                Err(why) => why.to_string(),
            };
            println!("| {} | {name} | {error} | {:.3} |", scene.name, 1e3 * seconds);
        };
        for rtol in [1e-3, 1e-5, 1e-7] {
            report(format!("diffsol BDF, rtol {rtol:e}"), &|| diffsol(&system, &start, duration, rtol, true));
            report(format!("diffsol ESDIRK34, rtol {rtol:e}"), &|| diffsol(&system, &start, duration, rtol, false));
            report(format!("ode_solvers DOP853, rtol {rtol:e}"), &|| {
                let deadline = Instant::now() + Duration::from_secs(60);
                dop853(&system, &start, duration, rtol, deadline).ok_or_else(|| "gave up".into())
            });
            report(format!("sprung w2, adaptive, rtol {rtol:e}"), &|| {
                let configuration = Configuration { method: Method::W2, options: ImplicitOptions::default() };
                let pace = Pace::Adaptive { rtol, first_step: 1e-3 * duration };
                Ok(trial(&system, &start, &configuration, pace, duration, &|| true)?.state)
            });
        }
        for steps in [64.0, 512.0, 4096.0] {
            for method in [Method::W2, Method::ImplicitMidpoint, Method::LinearBackwardEuler, Method::SymplecticEuler] {
                let configuration = Configuration { method, options: ImplicitOptions::default() };
                report(format!("sprung {}, {steps} steps", method.name()), &|| {
                    let pace = Pace::Step(duration / steps);
                    Ok(trial(&system, &start, &configuration, pace, duration, &|| true)?.state)
                });
            }
        }
    }
    Ok(())
}
