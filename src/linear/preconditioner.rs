//! The preconditioners of conjugate gradients behind one type.

use super::block_jacobi::{BlockJacobi, DiagonalPart, NotPositiveBlock};
use super::lagged_multigrid::LaggedMultigrid;
use super::norms::dot;
use super::outcome::{Evidence, SolveFailure};
use super::preconditioner_kind::PreconditionerKind;
use crate::error;
use crate::operator::SystemOperator;
use crate::spring::SpringBlock;
use crate::system::System;
use crate::work::Work;
use nalgebra::Vector3;

/// A preconditioner of the caller's own, for [`CgSolver::with_preconditioner`](super::CgSolver::with_preconditioner).
///
/// It must be symmetric and positive definite, or conjugate gradients stagnate or report negative curvature that A does not have.
pub trait CustomPreconditioner: std::fmt::Debug + Send {
    /// Its name in summaries.
    fn name(&self) -> &'static str;

    /// Says where the particles are, one position for every particle of the system, in m.
    fn place(&mut self, _positions: &[Vector3<f64>]) {}

    /// Makes it fit a matrix.
    ///
    /// # Errors
    /// What shows that the matrix is not positive definite, or not finite.
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
    /// The caller's own.
    Own(Box<dyn CustomPreconditioner>),
}

impl Preconditioner {
    /// For a system's matrices; [`update`](Self::update) makes it fit one of them.
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

    /// Which preconditioner of this crate this is; `None` for the caller's own.
    pub fn kind(&self) -> Option<PreconditionerKind> {
        Some(match self {
            Self::Identity => PreconditionerKind::None,
            Self::BlockJacobi(block_jacobi) => match block_jacobi.part() {
                DiagonalPart::Entries => PreconditionerKind::Jacobi,
                DiagonalPart::Blocks => PreconditionerKind::BlockJacobi,
            },
            Self::Multigrid(_) => PreconditionerKind::Multigrid,
            Self::Own(_) => return None,
        })
    }

    /// Its name in summaries.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Own(own) => own.name(),
            _ => self.kind().map_or("", PreconditionerKind::name),
        }
    }

    /// Says where the particles are, one position for every particle of the system, in m.
    pub fn place(&mut self, positions: &[Vector3<f64>]) {
        match self {
            Self::Multigrid(multigrid) => multigrid.place(positions),
            Self::Own(own) => own.place(positions),
            Self::Identity | Self::BlockJacobi(_) => {}
        }
    }

    /// Makes it fit a matrix, without allocating.
    ///
    /// # Errors
    /// What shows that the matrix is not positive definite, or not finite.
    pub fn update(&mut self, a: &SystemOperator, work: &mut Work) -> Result<(), SolveFailure> {
        match self {
            Self::Identity => Ok(()),
            Self::BlockJacobi(block_jacobi) => block_jacobi.update(a).map_err(|block| refused(a, block)),
            Self::Multigrid(multigrid) => multigrid.update(a, work),
            Self::Own(own) => own.update(a, work),
        }
    }

    /// `z = P⁻¹ r`, reduced vectors; returns `rᵀ z`.
    pub fn apply(&mut self, r: &[f64], z: &mut [f64]) -> f64 {
        match self {
            Self::Identity => z.copy_from_slice(r),
            Self::BlockJacobi(block_jacobi) => return block_jacobi.apply(r, z),
            Self::Multigrid(multigrid) => multigrid.apply(r, z),
            Self::Own(own) => own.apply(r, z),
        }
        dot(r, z)
    }
}

/// A refused block means an indefinite matrix only if the matrix is finite.
pub(super) fn refused(a: &SystemOperator, NotPositiveBlock(dof): NotPositiveBlock) -> SolveFailure {
    let is_finite = |block: &SpringBlock| block.matrix().iter().all(|entry| entry.is_finite());
    let external = a.external().iter().flatten().all(|entry| entry.is_finite());
    if a.mass_factor().is_finite() && external && a.blocks().iter().all(is_finite) {
        SolveFailure::Indefinite(Evidence::DiagonalBlock(dof))
    } else {
        SolveFailure::NonFinite
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::SpringGeometry;
    use crate::operator::Combination;
    use crate::spring::Stiffness;
    use crate::system::fixtures::row;
    use crate::system::{Dof, SystemBuilder};

    /// The identity, by another name.
    #[derive(Debug)]
    struct Mine;

    impl CustomPreconditioner for Mine {
        fn name(&self) -> &'static str {
            "mine"
        }

        fn update(&mut self, _: &SystemOperator, _: &mut Work) -> Result<(), SolveFailure> {
            Ok(())
        }

        fn apply(&mut self, r: &[f64], z: &mut [f64]) {
            z.copy_from_slice(r);
        }
    }

    #[test]
    fn every_preconditioner_has_its_name() {
        let (system, _) = SystemBuilder::new().build().unwrap();
        assert_eq!(Preconditioner::Own(Box::new(Mine)).name(), "mine");
        for kind in PreconditionerKind::ALL {
            assert_eq!(Preconditioner::new(kind, &system).unwrap().name(), kind.name());
        }
    }

    /// Indefinite is what is finite alone: both the masses' part and every spring's.
    #[test]
    fn matrices_that_are_not_finite_are_not_called_indefinite() {
        let (system, state) = row(2);
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let dof = Dof { particle: 1, axis: 0 };
        let indefinite = SolveFailure::Indefinite(Evidence::DiagonalBlock(dof));
        for (mass, stiffness, expected) in [
            (1.0, -1.0, indefinite),
            (f64::INFINITY, -1.0, SolveFailure::NonFinite),
            (1.0, f64::INFINITY, SolveFailure::NonFinite),
        ] {
            let combination = Combination { mass, damping: 0.0, stiffness };
            let a = SystemOperator::new(&system, &extensions, Stiffness::Full, combination);
            assert_eq!(
                format!("{:?}", refused(&a, NotPositiveBlock(dof))),
                format!("{expected:?}"),
                "{mass} {stiffness}"
            );
        }
    }
}
