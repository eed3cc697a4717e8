//! Multigrid whose coarse levels lag behind the matrix for as long as that pays.
//!
//! The finest level always has the matrix at hand. The coarse levels are recomputed when the iterations that their age has cost since they were new add
//! up to what recomputing costs: whatever comes next, this is at most twice the work of the best choice of moments (the argument of renting or
//! buying skis). All is counted in iterations, never in seconds: a run does the same whenever it is repeated.

use super::outcome::{Evidence, SolveFailure};
use crate::error::Result;
use crate::multigrid::{Multigrid, SetupFailure};
use crate::operator::SystemOperator;
use crate::system::System;
use crate::work::Work;
use nalgebra::Vector3;

/// Iterations that recomputing the coarse levels costs; 10 to 12 by `cargo bench --bench multigrid`, and a little less so that
/// a motion that goes on ageing them finds new ones in time.
const REBUILD: f64 = 8.0;

/// State of the coarse levels.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Coarse {
    /// Never computed, or refused.
    Missing,
    /// Not used yet.
    New,
    /// Iterations per digit when they were new, and iterations lost to their age since.
    Used { per_digit: f64, lost: f64 },
}

/// Multigrid that keeps its coarse levels from one matrix to the next.
#[derive(Debug)]
pub struct LaggedMultigrid {
    multigrid: Multigrid,
    coarse: Coarse,
}

impl LaggedMultigrid {
    /// Analyses a system, see [`Multigrid::new`].
    ///
    /// # Errors
    /// More matrix blocks than 32-bit indices can count.
    pub fn new(system: &System) -> Result<Self> {
        Ok(Self { multigrid: Multigrid::new(system)?, coarse: Coarse::Missing })
    }

    /// See [`Multigrid::place`].
    pub fn place(&mut self, positions: &[Vector3<f64>]) {
        self.multigrid.place(positions);
    }

    /// Takes over a matrix, with new coarse levels where the old ones have cost too much; counts a set-up.
    ///
    /// # Errors
    /// What shows that the matrix is not positive definite, or not finite.
    pub fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        self.multigrid.refill(a)?;
        if matches!(self.coarse, Coarse::Used { lost, .. } if lost < REBUILD) {
            return Ok(());
        }
        work.multigrid_setups += 1;
        self.coarse = Coarse::Missing;
        self.multigrid.rebuild(a)?;
        self.coarse = Coarse::New;
        Ok(())
    }

    /// Records the iterations of a solve that gained so many decimal digits.
    pub fn record(&mut self, iterations: u64, digits: f64) {
        // A good first guess leaves too little to judge by.
        if digits.is_nan() || digits < 1.0 {
            return;
        }
        match &mut self.coarse {
            Coarse::Missing => {}
            Coarse::New => self.coarse = Coarse::Used { per_digit: iterations as f64 / digits, lost: 0.0 },
            Coarse::Used { per_digit, lost } => *lost += (iterations as f64 - *per_digit * digits).max(0.0),
        }
    }

    /// See [`Multigrid::apply`].
    pub fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        self.multigrid.apply(r, z);
    }
}

impl From<SetupFailure> for SolveFailure {
    fn from(failure: SetupFailure) -> Self {
        Self::Indefinite(match failure {
            SetupFailure::NonFinite => return Self::NonFinite,
            SetupFailure::Pivot(dof) => Evidence::Pivot(dof),
            SetupFailure::DiagonalBlock(dof) => Evidence::DiagonalBlock(dof),
            SetupFailure::CoarseLevel { level, dof } => Evidence::CoarseLevel { level, dof },
        })
    }
}

#[cfg(all(test, feature = "scene"))]
mod tests;
