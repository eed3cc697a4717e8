//! The exact Jacobian of a core step, and solves with it.

use super::parameters::{Point, turning_adjoint};
use crate::assembly::SymmetricMatrix;
use crate::eigen::{Pencil, product};
use crate::error::{Error, Result};
use crate::force::{SpringGeometry, add_damping_differential, add_damping_product, add_elastic_differential};
use crate::integrate::Matrices;
use crate::linear::{FactorSize, Ldlt, SOLVE_COLUMNS, norm};
use crate::operator::LinearOperator;
use crate::spring::Stiffness;
use crate::system::{State, System};
use faer::linalg::solvers::Solve;
use faer::sparse::{SparseColMat, Triplet};
use faer::{MatMut, Par};
use nalgebra::Vector3;
use rayon::prelude::*;

/// `J = A − D` of a core step, or its transpose.
pub(super) struct Jacobian<'s> {
    pub(super) system: &'s System,
    matrices: Matrices<'s>,
    ldlt: Ldlt,
    a: SymmetricMatrix,
    geometry: SpringGeometry,
    velocities: Vec<Vector3<f64>>,
    /// ‖A‖∞.
    pub(super) size: f64,
    is_factored: bool,
}

impl<'s> Jacobian<'s> {
    pub(super) fn new(system: &'s System, state: &State) -> Result<Self> {
        let matrices = Matrices::new(system)?;
        let a = matrices.k().scaled(1.0);
        let ldlt = Ldlt::analyse(a.pattern(), Par::Seq)?;
        let geometry = SpringGeometry::at(system, state)?;
        Ok(Self { system, matrices, ldlt, a, geometry, velocities: Vec::new(), size: 0.0, is_factored: false })
    }

    pub(super) fn linearise(&mut self, at: &State) -> Result<()> {
        self.geometry.update(self.system, at)?;
        self.velocities.clone_from(&at.velocities);
        Ok(())
    }

    pub(super) fn point<'a>(&'a self, at: &State) -> Point<'a> {
        Point { geometry: &self.geometry, velocities: &self.velocities, time: at.time }
    }

    /// Linearises at a solved configuration, and factors A.
    pub(super) fn set(&mut self, solved: &State, tau: f64) -> Result<()> {
        self.linearise(solved)?;
        self.matrices.update(solved, Stiffness::Full)?;
        self.a = self.matrices.a(tau)?;
        self.size = Pencil::of(&self.a).norm();
        self.is_factored = self.ldlt.factor(&self.a).is_ok();
        Ok(())
    }

    /// `D u`, or `Dᵀ u`, on all particles.
    pub(super) fn turned(&self, u: &[Vector3<f64>], is_transposed: bool) -> Vec<Vector3<f64>> {
        let mut result = vec![Vector3::zeros(); u.len()];
        let Self { system, geometry, velocities: v, .. } = self;
        if !is_transposed {
            add_damping_differential(system, geometry, v, u, &mut result);
            return result;
        }
        for ((_, [i, j], spring), at) in geometry.springs(system).filter(|((.., spring), _)| spring.damping > 0.0) {
            let change = turning_adjoint(spring, at, &(v[i] - v[j]), &(u[i] - u[j]));
            result[i] += change;
            result[j] -= change;
        }
        result
    }

    /// `(K + D) u` on all particles.
    pub(super) fn stiffness_change(&self, u: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut result = self.turned(u, false);
        add_elastic_differential(self.system, &self.geometry, u, &mut result);
        result
    }

    /// `G u` on all particles; G is symmetric.
    pub(super) fn damping(&self, u: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut result = vec![Vector3::zeros(); u.len()];
        add_damping_product(self.system, &self.geometry, u, &mut result);
        result
    }

    /// Solves with J or its transpose, for right-hand sides stored by columns: by corrections with the factor of A, or by a factorization of J itself
    /// where the substitutions for all columns exceed the operations of a factorization anyway.
    pub(super) fn solve(&mut self, b: &[f64], is_transposed: bool) -> Result<Vec<f64>> {
        let order = self.a.order().max(1);
        let FactorSize { entries, flops, .. } = self.ldlt.size();
        if (b.len() / order * entries) as f64 > flops {
            return self.solve_unsymmetric(b, is_transposed);
        }
        let mut x = Vec::with_capacity(b.len());
        for b in b.chunks_exact(order) {
            match self.solve_by_corrections(b, is_transposed) {
                Some(column) => x.extend(column),
                None => return self.solve_unsymmetric(b, is_transposed),
            }
        }
        Ok(x)
    }

    /// `x ← x + A⁻¹ (b − J x)` until it no longer gets better; nothing where that is not to rounding.
    fn solve_by_corrections(&mut self, b: &[f64], is_transposed: bool) -> Option<Vec<f64>> {
        let (mut x, mut rest) = (vec![0.0; b.len()], b.to_vec());
        let (size, mut before) = (norm(b), f64::INFINITY);
        if size == 0.0 {
            return Some(x);
        }
        for _ in 0..if self.is_factored { 40 } else { 0 } {
            let mut correction = rest;
            self.ldlt.substitute_columns(b.len(), &mut correction);
            x.iter_mut().zip(&correction).for_each(|(x, d)| *x += d);
            rest = self.defect(b, &x, is_transposed);
            // The defect of a solve as good as rounding lets it be is that of its products.
            let (left, floor) = (norm(&rest), 1e-15 * (size + self.size * norm(&x)));
            if left <= floor || left <= 1e3 * floor && left > 0.5 * before {
                return Some(x);
            }
            let is_better = left <= 0.5 * before.min(1e6 * size);
            if !is_better {
                return None;
            }
            before = left;
        }
        None
    }

    pub(super) fn defect(&self, b: &[f64], x: &[f64], is_transposed: bool) -> Vec<f64> {
        let product = product(&self.a, x);
        let dofs = self.system.dofs();
        let turned = match self.system.is_damped() {
            true => dofs.reduced(&self.turned(&dofs.full(x), is_transposed)),
            false => vec![0.0; b.len()],
        };
        b.iter().zip(&product).zip(&turned).map(|((b, ax), dx)| b - (ax - dx)).collect()
    }

    pub(super) fn solve_unsymmetric(&self, b: &[f64], is_transposed: bool) -> Result<Vec<f64>> {
        let dofs = self.system.dofs();
        let symmetric = self.a.to_coo();
        let mut entries: Vec<_> =
            symmetric.triplet_iter().map(|(row, column, a)| Triplet::new(row, column, *a)).collect();
        for ((_, [i, j], spring), at) in
            self.geometry.springs(self.system).filter(|((_, _, spring), _)| spring.damping > 0.0)
        {
            let v = self.velocities[i] - self.velocities[j];
            for (other, sign) in [(i, 1.0), (j, -1.0)] {
                for (column, axis) in dofs.rows(other).zip(dofs.free_axes(other).iter()) {
                    let change = spring.damping_differential(at, &v, &Vector3::ith(axis, sign));
                    for (end, sign) in [(i, -1.0), (j, 1.0)] {
                        for (row, axis) in dofs.rows(end).zip(dofs.free_axes(end).iter()) {
                            entries.push(Triplet::new(row, column, sign * change[axis]));
                        }
                    }
                }
            }
        }
        let singular = || Error::Unsupported("the Jacobian of a step is singular".into());
        let order = dofs.len();
        let jacobian = SparseColMat::try_new_from_triplets(order, order, &entries).map_err(|_| singular())?;
        let factored = jacobian.sp_lu().map_err(|_| singular())?;
        let mut x = b.to_vec();
        x.par_chunks_mut((SOLVE_COLUMNS * order).max(1)).for_each(|x| {
            let columns = x.len() / order;
            let x = MatMut::from_column_major_slice_mut(x, order, columns);
            match is_transposed {
                true => factored.solve_transpose_in_place(x),
                false => factored.solve_in_place(x),
            }
        });
        if x.iter().all(|x| x.is_finite()) { Ok(x) } else { Err(singular()) }
    }
}
