//! Block-diagonal preconditioners: Jacobi and 3×3 block Jacobi.

use super::vector::dot;
use crate::operator::BlockDiagonal;
use crate::system::{Axes, Dof, DofMap};
use nalgebra::{Matrix3, Vector3};
use std::ops::Range;

/// Particles in a piece of work: half a megabyte of vectors and inverses.
const PIECE: usize = 4096;

/// The part of the diagonal blocks that is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DiagonalPart {
    /// The diagonal: Jacobi.
    Entries,
    /// The whole 3×3 block of every particle: block Jacobi.
    Blocks,
}

/// A diagonal block that is not positive definite, which proves that the matrix is not.
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
    /// The identity; [`update`](Self::update) computes it for a matrix.
    pub fn new(part: DiagonalPart, dofs: &DofMap) -> Self {
        Self { part, dofs: dofs.clone(), inverses: vec![Matrix3::identity(); dofs.particles()] }
    }

    /// The part of the diagonal blocks that is used.
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
            if free != Axes::ALL {
                (0..3).filter(|&axis| !free.contains(axis)).for_each(|axis| block[(axis, axis)] = 1.0);
            }
            let axis = free.iter().next().unwrap_or(0);
            *block = inverse(block).ok_or(NotPositiveBlock(Dof { particle, axis }))?;
        }
        Ok(())
    }

    /// `z = P⁻¹ r`, reduced vectors; returns `rᵀ z`.
    pub fn apply(&self, r: &[f64], z: &mut [f64]) -> f64 {
        if [r.len(), z.len()] != [self.dofs.len(); 2] {
            z.fill(f64::NAN);
            return f64::NAN;
        }
        self.apply_to(0..self.inverses.len(), r, z)
    }

    /// The rows of some particles, which `r` and `z` hold. Cuts, and so the order of sums, depend on their number alone.
    fn apply_to(&self, particles: Range<usize>, r: &[f64], z: &mut [f64]) -> f64 {
        let first = self.dofs.first_row(particles.start);
        if particles.len() > PIECE {
            let middle = particles.start + particles.len() / 2;
            let at = self.dofs.first_row(middle) - first;
            let ((r0, r1), (z0, z1)) = (r.split_at(at), z.split_at_mut(at));
            let Range { start, end } = particles;
            let (first, second) =
                rayon::join(|| self.apply_to(start..middle, r0, z0), || self.apply_to(middle..end, r1, z1));
            return first + second;
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
        dot(r, z)
    }
}

/// `A⁻¹ = L⁻ᵀ D⁻¹ L⁻¹` with `A = L D Lᵀ`, without roots, from the lower triangle; `None` unless A is positive definite.
fn inverse(a: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let d0 = 1.0 / a.m11;
    let (l10, l20) = (a.m21 * d0, a.m31 * d0);
    let pivot1 = a.m22 - l10 * a.m21;
    let c21 = a.m32 - l20 * a.m21;
    let d1 = 1.0 / pivot1;
    let l21 = c21 * d1;
    let pivot2 = a.m33 - l20 * a.m31 - l21 * c21;
    let d2 = 1.0 / pivot2;
    if !(a.m11 > 0.0 && pivot1 > 0.0 && pivot2 > 0.0) {
        return None;
    }
    // The entries of L⁻¹ below its diagonal are −l₁₀, −l₂₁ and this one.
    let m20 = l10 * l21 - l20;
    let (b02, b12) = (m20 * d2, -l21 * d2);
    let b01 = -l10 * d1 - l21 * b02;
    let b11 = d1 - l21 * b12;
    let b00 = d0 + l10 * l10 * d1 + m20 * b02;
    Some(Matrix3::new(b00, b01, b02, b01, b11, b12, b02, b12, d2))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A (1, 2, 3)ᵀ = (16, 21, 35)ᵀ and two more, of a matrix whose leading minors are 4, 11 and 54.
    #[test]
    fn inverses_undo_the_block() {
        let a = Matrix3::new(4.0, 1.0, 2.0, 1.0, 3.0, 0.0, 2.0, 0.0, 6.0);
        let inverse = inverse(&a).unwrap();
        for x in [Vector3::new(1.0, 2.0, 3.0), Vector3::new(-2.0, 0.5, 0.0), Vector3::new(0.0, -1.0, 7.0)] {
            assert!((inverse * (a * x) - x).norm() < 1e-14);
        }
        assert_eq!(inverse, inverse.transpose());
    }

    /// Two stiff axes and one softer by a factor of 1e12, in a rotated frame.
    #[test]
    fn stiff_blocks_have_definite_inverses() {
        let soft = Vector3::new(2.0, -1.0, 2.0) / 3.0;
        let a = Matrix3::identity() * 1e12 - soft * soft.transpose() * (1e12 - 1.0);
        let inverse = inverse(&a).unwrap();
        assert!(inverse.cholesky().is_some());
        assert!(((soft.transpose() * inverse * soft).x - 1.0).abs() < 1e-3);
    }

    #[test]
    fn indefinite_blocks_have_none() {
        for pivots in [[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0], [1.0, 1.0, 0.0], [1.0, f64::NAN, 1.0]] {
            let l = Matrix3::new(1.0, 0.0, 0.0, 2.0, 1.0, 0.0, -1.0, 0.5, 1.0);
            assert_eq!(inverse(&(l * Matrix3::from_diagonal(&pivots.into()) * l.transpose())), None, "{pivots:?}");
        }
    }

    /// Cutting the particles for the threads changes no number.
    #[test]
    fn pieces_are_cut_where_particles_end() {
        let mut builder = crate::SystemBuilder { dimension: 2, ..crate::SystemBuilder::new() };
        let particles = 2 * PIECE + 3;
        (0..particles).for_each(|p| _ = builder.particle([p as f64, 0.0, 0.0], 1.0));
        (0..particles).step_by(7).for_each(|p| _ = builder.hold(p));
        let (system, _) = builder.build().unwrap();
        let mut blocks = BlockJacobi::new(DiagonalPart::Blocks, system.dofs());
        for (p, inverse) in blocks.inverses.iter_mut().enumerate() {
            *inverse = Matrix3::new(1.0 + p as f64, 0.5, 0.0, 0.5, 2.0, 0.0, 0.0, 0.0, 1.0);
        }
        let rows = system.dofs().len();
        let r: Vec<f64> = (0..rows).map(|row| (row as f64).sin()).collect();
        let (mut z, mut alone) = (vec![0.0; rows], vec![0.0; rows]);
        let all = blocks.apply(&r, &mut z);
        let mut sum = 0.0;
        for p in 0..particles {
            let rows = system.dofs().rows(p);
            sum += blocks.apply_to(p..p + 1, &r[rows.clone()], &mut alone[rows]);
        }
        assert_eq!(z, alone);
        assert!((all - sum).abs() <= rows as f64 * f64::EPSILON * sum, "{all} {sum}");
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert_eq!(pool.install(|| blocks.apply(&r, &mut z)), all, "{threads}");
        }
        let row = system.dofs().rows(8).start;
        assert_eq!(z[row..row + 2], [9.0 * r[row] + 0.5 * r[row + 1], 0.5 * r[row] + 2.0 * r[row + 1]]);
    }
}
