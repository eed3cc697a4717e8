//! The preconditioners of conjugate gradients behind one type.

use super::block_jacobi::{BlockJacobi, DiagonalPart, NotPositiveBlock};
use super::lagged_multigrid::LaggedMultigrid;
use super::options::PreconditionerKind;
use super::outcome::{Evidence, SolveFailure};
use super::vector::dot;
use crate::error;
use crate::operator::SystemOperator;
use crate::system::System;
use crate::work::Work;
use nalgebra::Vector3;

/// A preconditioner of the caller's, for [`CgSolver::with_preconditioner`](super::CgSolver::with_preconditioner).
///
/// It must be symmetric and positive definite; otherwise conjugate gradients stagnate, or report negative curvature that A does not have.
pub trait CustomPreconditioner: std::fmt::Debug + Send {
    /// Its name in summaries.
    fn name(&self) -> &'static str;

    /// Sets the positions of all particles, in m.
    fn set_positions(&mut self, _positions: &[Vector3<f64>]) {}

    /// Recomputes it for a matrix.
    ///
    /// # Errors
    /// A matrix that is found not to be positive definite, or not finite.
    fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure>;

    /// `z = P⁻¹ r`, reduced vectors.
    fn apply(&mut self, r: &[f64], z: &mut [f64]);
}

/// An approximation of A⁻¹, symmetric and positive definite.
#[derive(Debug)]
#[non_exhaustive]
pub enum Preconditioner {
    /// The identity.
    Identity,
    /// One block a particle.
    BlockJacobi(BlockJacobi),
    /// A V-cycle.
    Multigrid(Box<LaggedMultigrid>),
    /// The caller's.
    Custom(Box<dyn CustomPreconditioner>),
}

impl Preconditioner {
    /// For a system's matrices; [`update`](Self::update) computes it for one of them.
    ///
    /// # Errors
    /// For multigrid, more matrix blocks than 32-bit indices can count.
    pub fn new(kind: PreconditionerKind, system: &System) -> error::Result<Self> {
        let diagonal = |part| Self::BlockJacobi(BlockJacobi::new(part, system.dofs()));
        Ok(match kind {
            PreconditionerKind::None => Self::Identity,
            PreconditionerKind::Jacobi => diagonal(DiagonalPart::Entries),
            PreconditionerKind::BlockJacobi => diagonal(DiagonalPart::Blocks),
            PreconditionerKind::Multigrid => Self::Multigrid(Box::new(LaggedMultigrid::new(system)?)),
        })
    }

    /// The kind; `None` for a custom one.
    pub fn kind(&self) -> Option<PreconditionerKind> {
        Some(match self {
            Self::Identity => PreconditionerKind::None,
            Self::BlockJacobi(block_jacobi) => match block_jacobi.part() {
                DiagonalPart::Entries => PreconditionerKind::Jacobi,
                DiagonalPart::Blocks => PreconditionerKind::BlockJacobi,
            },
            Self::Multigrid(_) => PreconditionerKind::Multigrid,
            Self::Custom(_) => return None,
        })
    }

    /// Its name in summaries.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Custom(custom) => custom.name(),
            _ => self.kind().map_or("", PreconditionerKind::name),
        }
    }

    /// Sets the positions of all particles, in m.
    pub fn set_positions(&mut self, positions: &[Vector3<f64>]) {
        match self {
            Self::Multigrid(multigrid) => multigrid.set_positions(positions),
            Self::Custom(custom) => custom.set_positions(positions),
            Self::Identity | Self::BlockJacobi(_) => {}
        }
    }

    /// Recomputes it for a matrix, without allocating.
    ///
    /// # Errors
    /// A matrix that is found not to be positive definite, or not finite.
    pub fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        match self {
            Self::Identity => Ok(()),
            Self::BlockJacobi(block_jacobi) => block_jacobi.update(a).map_err(|block| failure(a, block)),
            Self::Multigrid(multigrid) => multigrid.update(a, work),
            Self::Custom(custom) => custom.update(a, work),
        }
    }

    /// `z = P⁻¹ r`, reduced vectors; returns `rᵀ z`.
    pub fn apply(&mut self, r: &[f64], z: &mut [f64]) -> f64 {
        match self {
            Self::Identity => z.copy_from_slice(r),
            Self::BlockJacobi(block_jacobi) => return block_jacobi.apply(r, z),
            Self::Multigrid(multigrid) => multigrid.apply(r, z),
            Self::Custom(custom) => custom.apply(r, z),
        }
        dot(r, z)
    }
}

/// A block without an inverse means an indefinite matrix only if the matrix is finite.
fn failure(a: &SystemOperator, NotPositiveBlock(dof): NotPositiveBlock) -> SolveFailure {
    if a.is_finite() { SolveFailure::Indefinite(Evidence::DiagonalBlock(dof)) } else { SolveFailure::NonFinite }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::SpringGeometry;
    use crate::operator::Combination;
    use crate::spring::Stiffness;
    use crate::system::Dof;
    use crate::system::fixtures::row;

    /// An infinite mass or stiffness is reported as such.
    #[test]
    fn matrices_that_are_not_finite_are_not_called_indefinite() {
        let (system, state) = row(2);
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let dof = Dof { particle: 1, axis: 0 };
        for (mass, stiffness, is_finite) in
            [(1.0, -1.0, true), (f64::INFINITY, -1.0, false), (1.0, f64::INFINITY, false)]
        {
            let combination = Combination { mass, damping: 0.0, stiffness };
            let a = SystemOperator::new(&system, &extensions, Stiffness::Full, combination);
            let found = failure(&a, NotPositiveBlock(dof));
            let indefinite = matches!(found, SolveFailure::Indefinite(Evidence::DiagonalBlock(at)) if at == dof);
            assert!(indefinite == is_finite && (is_finite || matches!(found, SolveFailure::NonFinite)), "{found:?}");
        }
    }
}
