//! Preconditioners for conjugate gradients: none, Jacobi and 3×3 block Jacobi.

use crate::operator::BlockDiagonal;
use crate::system::{Dof, DofMap};
use nalgebra::Matrix3;

/// Which preconditioner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PreconditionerKind {
    /// The identity.
    None,
    /// The diagonal of A.
    Jacobi,
    /// The 3×3 diagonal block of every particle.
    BlockJacobi,
}

impl PreconditionerKind {
    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Jacobi => "jacobi",
            Self::BlockJacobi => "block-jacobi",
        }
    }
}

/// A diagonal block that is not positive definite: proof that the whole matrix is not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotPositiveBlock(pub Dof);

/// An approximation of A⁻¹ as a block-diagonal matrix, one 3×3 block a particle.
#[derive(Debug, Clone)]
pub struct Preconditioner {
    kind: PreconditionerKind,
    dofs: DofMap,
    inverses: Vec<Matrix3<f64>>,
}

impl Preconditioner {
    /// The identity; [`update`](Self::update) makes it fit a matrix.
    pub fn new(kind: PreconditionerKind, dofs: &DofMap) -> Self {
        let blocks = if kind == PreconditionerKind::None { 0 } else { dofs.particles() };
        Self { kind, dofs: dofs.clone(), inverses: vec![Matrix3::identity(); blocks] }
    }

    /// Which preconditioner this is.
    pub fn kind(&self) -> PreconditionerKind {
        self.kind
    }

    /// Recomputes from a matrix, without allocating.
    ///
    /// # Errors
    /// The first coordinate whose diagonal block (or entry) is not positive definite.
    pub fn update(&mut self, a: &impl BlockDiagonal) -> Result<(), NotPositiveBlock> {
        if self.kind == PreconditionerKind::None {
            return Ok(());
        }
        a.diagonal_blocks(&mut self.inverses);
        for (particle, block) in self.inverses.iter_mut().enumerate() {
            let free = self.dofs.free_axes(particle);
            if self.kind == PreconditionerKind::Jacobi {
                *block = Matrix3::from_diagonal(&block.diagonal());
            }
            for axis in (0..3).filter(|&axis| !free.contains(axis)) {
                block[(axis, axis)] = 1.0;
            }
            let axis = free.iter().next().unwrap_or(0);
            *block = block.cholesky().ok_or(NotPositiveBlock(Dof { particle, axis }))?.inverse();
        }
        Ok(())
    }

    /// `z = P⁻¹ r`, reduced vectors.
    pub fn apply(&self, r: &[f64], z: &mut [f64]) {
        if self.kind == PreconditionerKind::None {
            return z.copy_from_slice(r);
        }
        z.fill(0.0);
        for (particle, inverse) in self.inverses.iter().enumerate() {
            let v = inverse * self.dofs.get(r, particle);
            self.dofs.add(z, particle, &v);
        }
    }
}
