//! The exact Jacobian of a core step, and solves with it.

use super::parameters::turning_adjoint;
use crate::assembly::SymmetricMatrix;
use crate::error::{Error, Result};
use crate::force::{SpringGeometry, add_damping_differential, add_damping_product, add_elastic_differential};
use crate::integrate::Matrices;
use crate::linear::{Ldlt, norm};
use crate::operator::LinearOperator;
use crate::spring::Stiffness;
use crate::system::{State, System};
use faer::Par;
use faer::linalg::solvers::Solve;
use faer::sparse::{SparseColMat, Triplet};
use nalgebra::Vector3;

/// `J = A − D` of a core step, or its transpose.
pub(super) struct Jacobian<'s> {
    pub(super) system: &'s System,
    pub(super) matrices: Matrices<'s>,
    pub(super) ldlt: Ldlt,
    pub(super) a: SymmetricMatrix,
    pub(super) geometry: SpringGeometry,
    pub(super) velocities: Vec<Vector3<f64>>,
    pub(super) is_factored: bool,
}

/// Corrections at most, the error that counts as rounding, and the contraction below which another correction pays.
const CORRECTIONS: usize = 40;
const SOLVED: f64 = 1e-15;
const CONTRACTS: f64 = 0.5;

impl<'s> Jacobian<'s> {
    pub(super) fn new(system: &'s System, state: &State) -> Result<Self> {
        let matrices = Matrices::new(system)?;
        let a = matrices.k().scaled(1.0);
        let ldlt = Ldlt::analyse(a.pattern(), Par::Seq)?;
        let geometry = SpringGeometry::at(system, state)?;
        Ok(Self { system, matrices, ldlt, a, geometry, velocities: Vec::new(), is_factored: false })
    }

    /// Linearises at a solved configuration.
    pub(super) fn set(&mut self, solved: &State, tau: f64) -> Result<()> {
        self.geometry.update(self.system, solved)?;
        self.velocities.clone_from(&solved.velocities);
        self.matrices.update(solved, Stiffness::Full)?;
        self.a = self.matrices.a(tau)?;
        self.is_factored = self.ldlt.factor(&self.a).is_ok();
        Ok(())
    }

    pub(super) fn full(&self, reduced: &[f64]) -> Vec<Vector3<f64>> {
        let mut full = vec![Vector3::zeros(); self.system.particles()];
        self.system.dofs().scatter(reduced, &mut full);
        full
    }

    /// `D u`, or `Dᵀ u`, on all particles.
    pub(super) fn turned(&self, u: &[Vector3<f64>], is_transposed: bool) -> Vec<Vector3<f64>> {
        let mut result = vec![Vector3::zeros(); u.len()];
        if !is_transposed {
            add_damping_differential(self.system, &self.geometry, &self.velocities, u, &mut result);
            return result;
        }
        for ((_, [i, j], spring), at) in self.geometry.springs(self.system) {
            if spring.damping > 0.0 {
                let change = turning_adjoint(spring, at, &(self.velocities[i] - self.velocities[j]), &(u[i] - u[j]));
                result[i] += change;
                result[j] -= change;
            }
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

    /// Solves with J or its transpose: `x ← x + A⁻¹ (b − J x)` until it no longer gets better.
    pub(super) fn solve(&mut self, b: &[f64], is_transposed: bool) -> Result<Vec<f64>> {
        let (mut x, mut rest) = (vec![0.0; b.len()], b.to_vec());
        let (size, mut before) = (norm(b), f64::INFINITY);
        if size == 0.0 {
            return Ok(x);
        }
        for _ in 0..CORRECTIONS {
            if !self.is_factored {
                break;
            }
            let mut correction = rest;
            self.ldlt.substitute_columns(b.len(), &mut correction);
            x.iter_mut().zip(&correction).for_each(|(x, d)| *x += d);
            rest = self.defect(b, &x, is_transposed);
            // The defect of a solve as good as rounding lets it be is that of its products.
            let (left, floor) = (norm(&rest), SOLVED * (size + self.size() * norm(&x)));
            if left <= floor || left <= 1e3 * floor && left > CONTRACTS * before {
                return Ok(x);
            }
            let is_better = left <= CONTRACTS * before.min(1e6 * size);
            if !is_better {
                break;
            }
            before = left;
        }
        self.solve_unsymmetric(b, is_transposed)
    }

    pub(super) fn size(&self) -> f64 {
        self.a.norm_inf(&mut vec![0.0; self.a.order()])
    }

    pub(super) fn defect(&self, b: &[f64], x: &[f64], is_transposed: bool) -> Vec<f64> {
        let mut product = vec![0.0; b.len()];
        self.a.apply(x, &mut product);
        let mut turned = vec![0.0; b.len()];
        if self.system.is_damped() {
            self.system.dofs().gather(&self.turned(&self.full(x), is_transposed), &mut turned);
        }
        b.iter().zip(&product).zip(&turned).map(|((b, ax), dx)| b - (ax - dx)).collect()
    }

    /// By a sparse factorization L U of J.
    pub(super) fn solve_unsymmetric(&self, b: &[f64], is_transposed: bool) -> Result<Vec<f64>> {
        let dofs = self.system.dofs();
        let mut entries: Vec<Triplet<usize, usize, f64>> = Vec::new();
        for (row, column, value) in self.a.iter() {
            entries.push(Triplet::new(row, column, value));
            if row != column {
                entries.push(Triplet::new(column, row, value));
            }
        }
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
        let jacobian = SparseColMat::try_new_from_triplets(b.len(), b.len(), &entries).map_err(|_| singular())?;
        let factored = jacobian.sp_lu().map_err(|_| singular())?;
        let mut x = faer::Col::from_fn(b.len(), |row| b[row]);
        match is_transposed {
            true => factored.solve_transpose_in_place(x.as_mat_mut()),
            false => factored.solve_in_place(x.as_mat_mut()),
        }
        let x: Vec<f64> = x.iter().copied().collect();
        if x.iter().all(|x| x.is_finite()) { Ok(x) } else { Err(singular()) }
    }
}
