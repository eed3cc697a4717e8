//! Identifies the stiffnesses of a net from its motion, with the L-BFGS method of the crate `argmin`.
//!
//! The cost is half the sum of squares of the distances to the measured positions. Its gradient by all stiffnesses takes one linear solve a
//! step, whatever their number. Unknowns are the logarithms of stiffnesses, so that these stay positive.

use argmin::core::{CostFunction, Error, Executor, Gradient, State as _};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;
use sprung::gradient::{Cotangent, DifferentiableRun};
use sprung::nalgebra::Vector3;
use sprung::{Method, Spring, State, System, SystemBuilder};

const SIDE: usize = 5;
const DT: f64 = 0.02;
const DURATION: f64 = 0.8;

/// Steps from one measurement to the next.
const EVERY: usize = 4;

struct Identification {
    system: System,
    start: State,
    measured: Vec<Vec<Vector3<f64>>>,
}

impl Identification {
    /// Computes with the run for some stiffnesses, given by their logarithms.
    fn with_run<T>(&self, unknowns: &[f64], f: impl Fn(&DifferentiableRun) -> sprung::Result<T>) -> sprung::Result<T> {
        let springs = self.system.springs().iter().zip(unknowns);
        let springs = springs.map(|(spring, p)| Spring { stiffness: p.exp(), ..*spring }).collect();
        let system = self.system.with_springs(springs)?;
        f(&DifferentiableRun::new(&system, &self.start, Method::ImplicitMidpoint, DT, DURATION)?)
    }

    /// Computed less measured positions: the derivatives of the cost by the computed ones.
    fn residuals(&self, run: &DifferentiableRun) -> Vec<Cotangent> {
        let states = run.states().enumerate().step_by(EVERY).zip(&self.measured);
        let residual = |((step, state), measured): ((usize, &State), &Vec<Vector3<f64>>)| Cotangent {
            step,
            positions: state.positions.iter().zip(measured).map(|(computed, measured)| computed - measured).collect(),
            velocities: vec![Vector3::zeros(); measured.len()],
        };
        states.map(residual).collect()
    }
}

impl CostFunction for Identification {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, unknowns: &Vec<f64>) -> Result<f64, Error> {
        let squares = |residual: &Cotangent| residual.positions.iter().map(|d| d.norm_squared()).sum::<f64>();
        Ok(self.with_run(unknowns, |run| Ok(0.5 * self.residuals(run).iter().map(squares).sum::<f64>()))?)
    }
}

impl Gradient for Identification {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;

    fn gradient(&self, unknowns: &Vec<f64>) -> Result<Vec<f64>, Error> {
        let gradient = self.with_run(unknowns, |run| run.gradient(&self.residuals(run)))?;
        Ok(gradient.stiffness.iter().zip(unknowns).map(|(by_stiffness, p)| by_stiffness * p.exp()).collect())
    }
}

pub(crate) fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, 0.0, -9.81);
    for p in 0..SIDE * SIDE {
        let (column, row) = (p % SIDE, p / SIDE);
        builder.particle([column as f64, row as f64, 0.1 * (p as f64).sin()], 1.0);
        for (other, is_there) in [(p.wrapping_sub(1), column > 0), (p.wrapping_sub(SIDE), row > 0)] {
            if is_there {
                builder.spring(other, p, Spring { stiffness: 60.0, rest_length: 0.9, damping: 0.2 });
            }
        }
    }
    for corner in [0, SIDE - 1, SIDE * (SIDE - 1), SIDE * SIDE - 1] {
        builder.hold(corner);
    }
    let (system, start) = builder.build()?;

    // The measured motion is that of a net with other stiffnesses.
    let truth: Vec<f64> = (0..system.springs().len()).map(|s| 60.0 + 20.0 * (1.7 * s as f64).sin()).collect();
    let first: Vec<f64> = system.springs().iter().map(|spring| spring.stiffness.ln()).collect();
    let mut problem = Identification { system, start, measured: Vec::new() };
    let logarithms: Vec<f64> = truth.iter().map(|k| k.ln()).collect();
    problem.measured = problem
        .with_run(&logarithms, |run| Ok(run.states().step_by(EVERY).map(|state| state.positions.clone()).collect()))?;

    let before = problem.cost(&first)?;
    let method = LBFGS::new(MoreThuenteLineSearch::new(), 10).with_tolerance_grad(1e-7)?;
    let result = Executor::new(problem, method).configure(|state| state.param(first).max_iters(200)).run()?;
    let state = result.state();
    let found = state.get_best_param().ok_or("no point was computed")?;
    let error = found.iter().zip(&truth).map(|(p, k)| (p.exp() / k - 1.0).abs()).fold(0.0, f64::max);
    println!(
        "{} stiffnesses in {} iterations: cost {before:.2e} → {:.2e} m², largest relative error {error:.1e}",
        truth.len(),
        state.get_iter(),
        state.get_best_cost()
    );
    assert!(error < 1e-4);
    Ok(())
}
