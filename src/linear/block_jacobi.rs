//! Block-diagonal preconditioners: Jacobi and 3×3 block Jacobi.

use crate::operator::BlockDiagonal;
use crate::system::{Dof, DofMap};
use nalgebra::{Matrix3, Vector3};
use std::ops::Range;

/// Particles that one thread treats at a stretch.
const STRETCH: usize = 4096;

/// Which part of the diagonal blocks is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DiagonalPart {
    /// The diagonal: Jacobi.
    Entries,
    /// The whole 3×3 block of every particle: block Jacobi.
    Blocks,
}

/// A diagonal block that is not positive definite: proof that the whole matrix is not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotPositiveBlock(pub Dof);

/// An approximation of A⁻¹ as a block-diagonal matrix, one 3×3 block a particle.
#[derive(Debug, Clone)]
pub struct BlockJacobi {
    part: DiagonalPart,
    dofs: DofMap,
    inverses: Vec<Matrix3<f64>>,
}

impl BlockJacobi {
    /// The identity; [`update`](Self::update) makes it fit a matrix.
    pub fn new(part: DiagonalPart, dofs: &DofMap) -> Self {
        Self { part, dofs: dofs.clone(), inverses: vec![Matrix3::identity(); dofs.particles()] }
    }

    /// Which part of the diagonal blocks is used.
    pub fn part(&self) -> DiagonalPart {
        self.part
    }

    /// Recomputes from a matrix, without allocating.
    ///
    /// # Errors
    /// The first coordinate whose diagonal block (or entry) is not positive definite.
    pub fn update(&mut self, a: &impl BlockDiagonal) -> Result<(), NotPositiveBlock> {
        a.diagonal_blocks(&mut self.inverses);
        for (particle, block) in self.inverses.iter_mut().enumerate() {
            let free = self.dofs.free_axes(particle);
            if self.part == DiagonalPart::Entries {
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
        self.apply_to(0..self.inverses.len(), r, z);
    }

    /// The rows of some particles, which are what `r` and `z` hold.
    fn apply_to(&self, particles: Range<usize>, r: &[f64], z: &mut [f64]) {
        let first = self.dofs.first_row(particles.start);
        if particles.len() > STRETCH {
            let middle = particles.start + particles.len() / 2;
            let at = self.dofs.first_row(middle) - first;
            let ((r0, r1), (z0, z1)) = (r.split_at(at), z.split_at_mut(at));
            let Range { start, end } = particles;
            rayon::join(|| self.apply_to(start..middle, r0, z0), || self.apply_to(middle..end, r1, z1));
            return;
        }
        for (inverse, particle) in self.inverses[particles.clone()].iter().zip(particles) {
            let rows = self.dofs.rows(particle);
            let rows = rows.start - first..rows.end - first;
            let (r, z) = (&r[rows.clone()], &mut z[rows]);
            if let (&[rx, ry, rz], [x, y, z]) = (r, &mut *z) {
                [*x, *y, *z] = (inverse * Vector3::new(rx, ry, rz)).into();
            } else {
                let free = self.dofs.free_axes(particle);
                for (z, row) in z.iter_mut().zip(free.iter()) {
                    *z = r.iter().zip(free.iter()).map(|(r, column)| inverse[(row, column)] * r).sum();
                }
            }
        }
    }
}
