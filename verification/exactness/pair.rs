//! One run done twice: with linear systems solved to the last digit, and as exactly as the motion needs.

use super::study::runs::{Ask, Run, TestCase};
use super::study::store::Store;
use super::study::{random, rows};
use faer::Par;
use sprung::accuracy::relative_position_error;
use sprung::integrate::{ImplicitOptions, Method, MonitorOptions};
use sprung::linear::{PreconditionerKind, SolverChoice, SolverOptions, Tolerance};

/// The methods whose solves follow their errors.
pub const METHODS: [Method; 3] = [Method::LinearBackwardEuler, Method::Bdf2, Method::Rodas4];

/// Where the other run of a pair stops.
pub const STRICT: f64 = 1e-12;

/// Steps of fixed length, in parts of a run.
const PARTS: [f64; 3] = [30.0, 100.0, 300.0];

/// Tolerances of adaptive runs.
const RTOLS: [f64; 2] = [1e-2, 1e-4];

/// Preconditioners with which few and many iterations reach the same residual, in turn.
const PRECONDITIONERS: [PreconditionerKind; 2] = [PreconditionerKind::BlockJacobi, PreconditionerKind::Multigrid];

/// Both runs.
pub struct Pair {
    pub seed: u64,
    pub method: Method,
    pub preconditioner: PreconditionerKind,
    pub ask: Ask,
    pub strict: Run,
    pub needed: Run,
    /// Between where they end, relative to the extent.
    pub difference: f64,
    /// Iterations of conjugate gradients: strict, as needed.
    pub iterations: [u64; 2],
}

impl Pair {
    /// Both runs were completed.
    pub fn is_completed(&self) -> bool {
        self.strict.is_completed() && self.needed.is_completed()
    }

    /// One line.
    pub fn line(&self) -> String {
        let (what, size) = match self.ask {
            Ask::Dt(dt) => ("dt", dt),
            Ask::Rtol(rtol) => ("rtol", rtol),
            Ask::Accuracy(accuracy) => ("accuracy", accuracy),
        };
        format!(
            "| {} | {}, {what} {} | {} | {} / {} | {} / {} | {} |",
            random::name(self.seed),
            self.method.name(),
            rows::number(size),
            self.preconditioner.name(),
            self.strict.status,
            self.needed.status,
            rows::number(self.strict.error()),
            rows::number(self.needed.error()),
            rows::number(self.difference),
        )
    }
}

/// Every pair of a random scene; none where it has no reference.
///
/// # Errors
/// A scene that does not build, which would be a mistake of the generator.
pub fn pairs(seed: u64, store: &Store) -> sprung::Result<Vec<Pair>> {
    let scene = random::scene(seed).scene;
    let (system, start) = scene.build()?;
    let duration = scene.time.duration.unwrap_or(1.0);
    let Some(reference) = store.reference(&scene, duration)? else { return Ok(Vec::new()) };
    let subject = TestCase { system: &system, start: &start, duration, reference: &reference };
    let kind = PRECONDITIONERS[(seed % 2) as usize];
    let mut pairs = Vec::new();
    for method in METHODS {
        let adaptive = RTOLS.into_iter().filter(|_| method.estimates_errors()).map(Ask::Rtol);
        for ask in PARTS.into_iter().map(|parts| Ask::Dt(duration / parts)).chain(adaptive) {
            let run = |tolerance| {
                let (solver, preconditioner, par) = (SolverChoice::Cg, Some(kind), Par::Seq);
                let linear = SolverOptions { solver, preconditioner, tolerance, par, ..SolverOptions::default() };
                // Solves for the propagated error are not the steps'.
                subject.run_with(
                    method,
                    &ImplicitOptions { linear, ..ImplicitOptions::default() },
                    MonitorOptions::ENERGY,
                    ask,
                )
            };
            let (strict, end, work) = run(Tolerance::Fixed(STRICT))?;
            let (needed, other_end, less) = run(Tolerance::Adaptive)?;
            pairs.push(Pair {
                seed,
                method,
                preconditioner: kind,
                ask,
                difference: relative_position_error(&other_end.positions, &end.positions, &start.positions),
                iterations: [work.work.cg_iterations, less.work.cg_iterations],
                strict,
                needed,
            });
        }
    }
    Ok(pairs)
}
