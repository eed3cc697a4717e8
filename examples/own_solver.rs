//! Hands a linear solver of your own to a time step: here a dense Cholesky factorization by nalgebra.
//!
//! A solver is given every matrix once (`update`) and then solves with it (`solve`). What it cannot solve it must refuse, so that the
//! method can do something else: here a matrix that is not positive definite, for which `on-demand` then hands over a softer one.

use sprung::assembly::{SpringPattern, SystemMatrix};
use sprung::integrate::{ImplicitOptions, LinearBackwardEuler, TimeStepper};
use sprung::linear::{Definiteness, LinearSolver, PreparedMatrix, Solution, SolveFailure};
use sprung::nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use sprung::operator::{LinearOperator, SystemOperator};
use sprung::work::Work;
use sprung::{Spring, System, SystemBuilder};
use std::sync::Arc;

struct Dense {
    matrix: SystemMatrix,
    factor: Option<Cholesky<f64, Dyn>>,
}

impl Dense {
    fn new(system: &System) -> sprung::Result<Self> {
        Ok(Self { matrix: SystemMatrix::zeros(Arc::new(SpringPattern::of_stiffness(system)?)), factor: None })
    }
}

impl LinearSolver for Dense {
    fn name(&self) -> &'static str {
        "dense"
    }

    fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<Definiteness, SolveFailure> {
        self.matrix.refill(a);
        work.factorizations += 1;
        self.factor = Cholesky::new(DMatrix::from(&self.matrix.matrix().to_csc()));
        match self.factor {
            Some(_) => Ok(Definiteness::Positive),
            None => Err(SolveFailure::INDEFINITE),
        }
    }

    fn solve(
        &mut self,
        a: PreparedMatrix<'_>,
        b: &[f64],
        x: &mut [f64],
        work: &mut Work,
    ) -> Result<Solution, SolveFailure> {
        let factor = self.factor.as_ref().ok_or(SolveFailure::Unprepared)?;
        work.solves += 1;
        let b = DVector::from_column_slice(b);
        x.copy_from_slice(factor.solve(&b).as_slice());
        let mut product = vec![0.0; x.len()];
        a.apply(x, &mut product);
        let residual = (&b - DVector::from_vec(product)).norm();
        Ok(Solution { relative_residual: if residual == 0.0 { 0.0 } else { residual / b.norm() } })
    }
}

pub(crate) fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -9.81, 0.0);
    for p in 0..8 {
        builder.particle([0.3 * f64::from(p), 0.0, 0.0], 0.1);
        if p > 0 {
            let spring = Spring { stiffness: 50.0, rest_length: 0.3, damping: 0.01 };
            builder.spring(p as usize - 1, p as usize, spring);
        }
    }
    builder.hold(0);
    let (system, start) = builder.build()?;

    let options = ImplicitOptions::default();
    let solver = Box::new(Dense::new(&system)?);
    let mut own = LinearBackwardEuler::with_solver(&system, &start, &options, solver)?;
    let mut builtin = LinearBackwardEuler::new(&system, &start, &options)?;
    let (mut a, mut b) = (start.clone(), start);
    for _ in 0..50 {
        own.step(&mut a, 0.01)?;
        builtin.step(&mut b, 0.01)?;
    }
    let apart = a.positions.iter().zip(&b.positions).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    let name = own.linear_solver().map_or("none", |solver| solver.name());
    println!("{name}: {} factorizations, {apart:.1e} m from llt", own.statistics().work.factorizations);
    assert!(apart < 1e-10);
    Ok(())
}
