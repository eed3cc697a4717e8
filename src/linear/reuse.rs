//! Multigrid kept from one matrix to the next for as long as it pays.
//!
//! The finest level always has the matrix at hand. The coarse levels are recomputed when the iterations that their age has
//! cost since they were new add up to what recomputing costs: whatever comes next, this is at most twice the work of the
//! best choice of moments (the argument of renting or buying skis). All is counted in iterations, never in seconds: a run
//! does the same on every machine.

use super::outcome::{Evidence, SolveFailure};
use super::preconditioner::{MULTIGRID_SETUP, PreconditionerKind};
use crate::error::Result;
use crate::multigrid::{Multigrid, SetupFailure};
use crate::operator::SystemOperator;
use crate::system::System;
use crate::work::Work;
use nalgebra::Vector3;

/// What recomputing the coarse levels costs, in iterations.
const REBUILD: f64 = MULTIGRID_SETUP / PreconditionerKind::Multigrid.iteration_effort();

/// Iterations that old coarse levels may take in one solve, in those that new ones took.
const PATIENCE: f64 = 2.0;

/// Age of the coarse levels.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Coarse {
    /// Never computed, or refused.
    Missing,
    /// Not used yet.
    New,
    /// Iterations per digit when they were new, and iterations lost to their age since.
    Used { per_digit: f64, lost: f64 },
}

/// Multigrid with a memory of what it has cost.
#[derive(Debug)]
pub struct ReusedMultigrid {
    multigrid: Multigrid,
    coarse: Coarse,
}

impl ReusedMultigrid {
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

    /// Takes over a matrix, with new coarse levels if it is time.
    ///
    /// # Errors
    /// What shows that the matrix is not positive definite, or not finite.
    pub fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        self.multigrid.refill(a).map_err(failure)?;
        match self.coarse {
            Coarse::Used { lost, .. } if lost < REBUILD => Ok(()),
            _ => self.rebuild(a, work),
        }
    }

    /// Recomputes the coarse levels; counts it.
    ///
    /// # Errors
    /// What shows that the matrix is not positive definite, or not finite.
    pub fn rebuild(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        work.multigrid_setups += 1;
        self.coarse = Coarse::Missing;
        self.multigrid.rebuild(a).map_err(failure)?;
        self.coarse = Coarse::New;
        Ok(())
    }

    /// The most iterations that a solve which gains this many decimal digits should take before it asks for new coarse
    /// levels; `None` when they are new.
    pub fn patience(&self, digits: f64) -> Option<u64> {
        match self.coarse {
            Coarse::Used { per_digit, .. } => Some((PATIENCE * per_digit * digits + REBUILD) as u64),
            Coarse::New | Coarse::Missing => None,
        }
    }

    /// Takes note of what a solve has cost that gained this many decimal digits.
    pub fn record(&mut self, iterations: u64, digits: f64) {
        // A good first guess leaves too little to judge by.
        if digits.is_nan() || digits < 1.0 {
            return;
        }
        match &mut self.coarse {
            Coarse::New => self.coarse = Coarse::Used { per_digit: iterations as f64 / digits, lost: 0.0 },
            Coarse::Used { per_digit, lost } => *lost += (iterations as f64 - *per_digit * digits).max(0.0),
            Coarse::Missing => {}
        }
    }

    /// See [`Multigrid::apply`].
    pub fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        self.multigrid.apply(r, z);
    }
}

fn failure(failure: SetupFailure) -> SolveFailure {
    SolveFailure::Indefinite(match failure {
        SetupFailure::NonFinite => return SolveFailure::NonFinite,
        SetupFailure::Pivot(dof) => Evidence::Pivot(dof),
        SetupFailure::DiagonalBlock(dof) => Evidence::DiagonalBlock(dof),
        SetupFailure::CoarseLevel { level, dof } => Evidence::CoarseLevel { level, dof },
    })
}
