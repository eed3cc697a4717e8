//! Integrators of the library `diffsol` on a mass–spring system.

use crate::Failure;
use crate::limits::TOO_LONG;
use crate::motion::Motion;
use diffsol::{
    FaerSparseLU, FaerSparseMat, NalgebraLU, NalgebraMat, OdeBuilder, OdeSolverMethod, OdeSolverStopReason, Vector,
};
use sprung::accuracy::extent;
use sprung::{State, System};

/// A method of variable step.
#[derive(Clone, Copy)]
pub enum Integrator {
    /// Backward differentiation formulas of order 1 to 5.
    Bdf,
    /// A Runge–Kutta method of order 3 with implicit stages and an explicit first one.
    Esdirk34,
}

impl Integrator {
    /// The name in tables and legends.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bdf => "diffsol BDF",
            Self::Esdirk34 => "diffsol ESDIRK34",
        }
    }
}

/// From this many unknowns on, matrices are sparse.
const SPARSE: usize = 60;

/// Newton iterations that diverge shorten the step and are no reason to give up: only the time is limited.
const FAILURES: usize = 1_000_000;

/// The state `duration` seconds after `start`, to a local relative tolerance. The absolute one is as much of the scene's extent.
///
/// The matrix of the iterations is factored by dense LU, or by faer's sparse LU where the scene is large enough to gain from it; its
/// entries come from products with the exact Jacobian, as few as the pattern allows.
pub fn diffsol(
    integrator: Integrator,
    system: &System,
    start: &State,
    duration: f64,
    rtol: f64,
    go_on: &dyn Fn() -> bool,
) -> Result<State, Failure> {
    let motion = Motion::new(system, start)?;
    let first = motion.first();
    let end = start.time + duration;
    macro_rules! with {
        ($matrix:ty, $lu:ty) => {{
            let mut problem = OdeBuilder::<$matrix>::new()
                .t0(start.time)
                .rtol(rtol)
                .atol([rtol * extent(&start.positions, &start.positions)])
                .h0(1e-4 * duration)
                .use_coloring(true)
                .rhs_implicit(
                    |y: &[f64], _: &[f64], t, rate: &mut [f64]| motion.rate(t, y, rate),
                    |y: &[f64], _: &[f64], t, w: &[f64], out: &mut [f64]| motion.jacobian_product(t, y, w, out),
                )
                .init(|_: &[f64], _, y: &mut [f64]| y.copy_from_slice(&first), motion.order())
                .build()?;
            problem.ode_options.max_nonlinear_solver_failures = FAILURES;
            problem.ode_options.max_error_test_failures = FAILURES;
            macro_rules! run {
                ($solver:expr) => {{
                    let mut solver = $solver;
                    solver.set_stop_time(end)?;
                    while !matches!(solver.step()?, OdeSolverStopReason::TstopReached) {
                        if !go_on() {
                            return Err(TOO_LONG.into());
                        }
                    }
                    solver.interpolate(end)?.clone_as_vec()
                }};
            }
            match integrator {
                Integrator::Bdf => run!(problem.bdf::<$lu>()?),
                Integrator::Esdirk34 => run!(problem.esdirk34::<$lu>()?),
            }
        }};
    }
    let y = if motion.order() < SPARSE {
        with!(NalgebraMat<f64>, NalgebraLU<f64>)
    } else {
        with!(FaerSparseMat<f64>, FaerSparseLU<f64>)
    };
    let state = motion.state(end, &y);
    if state.is_finite() { Ok(state) } else { Err("non finite".into()) }
}
