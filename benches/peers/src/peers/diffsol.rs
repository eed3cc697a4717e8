//! Integrators of the library `diffsol`.

use super::tolerance::Tolerance;
use crate::Failure;
use crate::limits::{Patience, TOO_LONG};
use crate::motion::Motion;
use ::diffsol::{
    FaerSparseLU, FaerSparseMat, NalgebraLU, NalgebraMat, OdeBuilder, OdeSolverMethod, OdeSolverStopReason, Vector,
};
use cpu_time::ThreadTime;

/// Those that are measured.
#[derive(Clone, Copy, PartialEq)]
pub enum Method {
    /// Backward differentiation formulas of order 1 to 5.
    Bdf,
    /// A Runge–Kutta method of order 3 with implicit stages and an explicit first one.
    Esdirk34,
    /// An explicit Runge–Kutta method of order 5.
    Tsit45,
}

/// From this many unknowns on, matrices are sparse.
const SPARSE: usize = 60;

/// Newton iterations that diverge shorten the step and are no reason to give up: only the time is limited.
const FAILURES: usize = 1_000_000;

/// y at the end of a piece of time.
///
/// The matrix of the iterations is factored by dense LU, or by faer's sparse LU where the scene is large enough to gain from it; its
/// entries come from products with the exact Jacobian, as few as the pattern allows. The search for that pattern is not timed: who knows it
/// need not search. The explicit method sees no matrix.
pub fn solve(
    method: Method,
    motion: &Motion<'_>,
    [from, to]: [f64; 2],
    first: &[f64],
    tolerance: Tolerance,
    patience: &Patience,
) -> Result<Vec<f64>, Failure> {
    macro_rules! with {
        ($problem:expr, $method:ident $(, $lu:ty)?) => {{
            let clock = ThreadTime::now();
            let mut problem = $problem;
            patience.excuse(clock.elapsed());
            problem.ode_options.max_nonlinear_solver_failures = FAILURES;
            problem.ode_options.max_error_test_failures = FAILURES;
            let mut solver = problem.$method$(::<$lu>)?()?;
            solver.set_stop_time(to)?;
            while !matches!(solver.step()?, OdeSolverStopReason::TstopReached) {
                if !patience.lasts() {
                    return Err(TOO_LONG.into());
                }
            }
            Ok(solver.interpolate(to)?.clone_as_vec())
        }};
    }
    macro_rules! problem {
        ($matrix:ty) => {
            OdeBuilder::<$matrix>::new()
                .t0(from)
                .rtol(tolerance.relative)
                .atol([tolerance.absolute])
                .h0(1e-4 * (to - from))
        };
    }
    macro_rules! implicit {
        ($matrix:ty) => {
            problem!($matrix)
                .use_coloring(true)
                .rhs_implicit(
                    |y: &[f64], _: &[f64], t, rate: &mut [f64]| motion.rate(t, y, rate),
                    |y: &[f64], _: &[f64], t, w: &[f64], out: &mut [f64]| motion.jacobian_product(t, y, w, out),
                )
                .init(|_: &[f64], _, y: &mut [f64]| y.copy_from_slice(first), motion.order())
                .build()?
        };
    }
    match (method, motion.order() < SPARSE) {
        (Method::Bdf, true) => with!(implicit!(NalgebraMat<f64>), bdf, NalgebraLU<f64>),
        (Method::Bdf, false) => with!(implicit!(FaerSparseMat<f64>), bdf, FaerSparseLU<f64>),
        (Method::Esdirk34, true) => with!(implicit!(NalgebraMat<f64>), esdirk34, NalgebraLU<f64>),
        (Method::Esdirk34, false) => with!(implicit!(FaerSparseMat<f64>), esdirk34, FaerSparseLU<f64>),
        (Method::Tsit45, _) => with!(
            problem!(NalgebraMat<f64>)
                .rhs(|y: &[f64], _: &[f64], t, rate: &mut [f64]| motion.rate(t, y, rate))
                .init(|_: &[f64], _, y: &mut [f64]| y.copy_from_slice(first), motion.order())
                .build()?,
            tsit45
        ),
    }
}
