//! The preconditioner of conjugate gradients that is chosen while they solve, and the watch over what none looks at.

use crate::linear::block_jacobi::{BlockJacobi, DiagonalPart};
use crate::linear::contest::Contest;
use crate::linear::cost::CostModel;
use crate::linear::outcome::SolveFailure;
use crate::linear::preconditioner::refused;
use crate::linear::preconditioner_kind::PreconditionerKind;
use crate::operator::{Margins, SurelyDefinite, SystemOperator};
use crate::system::System;
use nalgebra::Vector3;

/// A choice that is not made yet, and where the particles are, for multigrid.
#[derive(Debug)]
pub(super) struct Choice {
    pub contest: Contest,
    pub places: Vec<Vector3<f64>>,
    /// By how much masses outweigh springs in the matrix at hand.
    margins: Margins,
    /// What of it is definite for certain.
    definite: SurelyDefinite,
    /// Its diagonal blocks, of which it is not certain, where nothing is preconditioned.
    pub watch: Option<BlockJacobi>,
}

impl Choice {
    pub fn new(system: &System, costs: &CostModel) -> Self {
        Self {
            contest: Contest::new(system, costs),
            places: vec![Vector3::zeros(); system.particles()],
            margins: Margins::new(system),
            definite: SurelyDefinite::Nothing,
            watch: None,
        }
    }

    /// Whether another preconditioner should have this matrix, which comes after those that one has had.
    pub fn next(
        &mut self,
        kind: PreconditionerKind,
        a: &SystemOperator,
        costs: &CostModel,
    ) -> Option<PreconditionerKind> {
        self.definite = a.surely_definite(&mut self.margins);
        self.contest.next(kind, costs, self.definite)
    }

    /// Whether blocks of a matrix that nothing else looks at are to be made.
    pub fn is_watchful(&self) -> bool {
        self.definite == SurelyDefinite::Nothing || !self.contest.knows_blocks()
    }

    /// Makes the blocks that may show that the matrix is not definite; of the first matrix all, which show whether they would be of use.
    pub fn watch(&mut self, a: &SystemOperator) -> Result<(), SolveFailure> {
        let Self { contest, margins, watch, .. } = self;
        let blocks = watch.get_or_insert_with(|| BlockJacobi::new(DiagonalPart::Blocks, a.system().dofs()));
        let updated = if contest.knows_blocks() {
            blocks.update_some(a, |particle| margins.is_doubtful(particle))
        } else {
            blocks.update(a)
        };
        if updated.is_ok() && !contest.knows_blocks() {
            contest.see_blocks(blocks.spread());
        }
        updated.map_err(|block| refused(a, block))
    }
}
