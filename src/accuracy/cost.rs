//! Work in one unit, so that methods that do different things can be compared on any machine.

use crate::error::Result;
use crate::linear::{CholeskySolver, FactorSize};
use crate::system::System;
use crate::work::Work;
use faer::Par;

/// What the operations of a step cost on one system, in units of one force evaluation.
///
/// A force evaluation visits every active spring once. The other weights are operations counted on the system's own
/// pattern, divided by those of a force evaluation. The few constants that turn operations of one kind into those of another are
/// rounded: on cloths of 144 particles a unit takes about the same time (7 to 9 µs) by factorization and by conjugate
/// gradients, on scenes of a few particles twice as long in implicit methods as in explicit ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CostModel {
    assembly: f64,
    factorization: f64,
    direct_solve: f64,
    cg_iteration: f64,
}

/// Operations of one spring in a force evaluation: differences, a norm, two updates, in units of multiply–adds of a
/// supernodal factorization.
const OPERATIONS_PER_SPRING: f64 = 60.0;

/// A stored entry of the factor is read and written once by a factorization, whatever the arithmetic.
const OPERATIONS_PER_ENTRY: f64 = 6.0;

/// A step touches every degree of freedom a few times, with or without springs.
const OPERATIONS_PER_DOF: f64 = 10.0;

impl CostModel {
    /// Of a system; analyses its pattern.
    ///
    /// # Errors
    /// When the factor of the system's matrix is too large.
    pub fn of(system: &System) -> Result<Self> {
        Ok(Self::with_factor(system, &CholeskySolver::new(system, Par::Seq, &mut Work::default())?.size()))
    }

    /// Of a system whose factor is known.
    pub fn with_factor(system: &System, size: &FactorSize) -> Self {
        let springs = system.active_springs().len() as f64;
        let dofs = system.dofs().len() as f64;
        let force = OPERATIONS_PER_SPRING * springs + OPERATIONS_PER_DOF * dofs;
        let entries = size.entries as f64;
        let unit = force.max(1.0);
        Self {
            assembly: 2.0,
            factorization: (size.flops / 2.0 + OPERATIONS_PER_ENTRY * entries + OPERATIONS_PER_DOF * dofs) / unit,
            direct_solve: (2.0 * entries + OPERATIONS_PER_DOF * dofs) / unit,
            cg_iteration: 1.0,
        }
    }

    /// Of a system on which nothing is factored.
    pub fn without_factor() -> Self {
        Self { assembly: 2.0, factorization: 0.0, direct_solve: 0.0, cg_iteration: 1.0 }
    }

    /// The cost of some work, in force evaluations of this system.
    pub fn cost(&self, work: &Work) -> f64 {
        // Conjugate gradients count their solves too, but what these cost is in the iterations.
        let direct_solves = if work.factorizations > 0 { work.solves } else { 0 };
        work.force_evaluations as f64
            + self.assembly * work.assemblies as f64
            + self.factorization * work.factorizations as f64
            + self.direct_solve * direct_solves as f64
            + self.cg_iteration * work.cg_iterations as f64
    }
}
