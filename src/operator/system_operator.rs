//! The system matrix without a matrix: one mass a particle and one block a spring.
//!
//! Every matrix of a mass–spring system is a combination `m·M + g·G + k·K` of the mass matrix, the damping matrix `G = ∂f_d/∂v` and the stiffness
//! matrix `K = ∂f_el/∂x`. A spring between i and j puts `−b nnᵀ` into G and `−K^s` into K on (i, i) and (j, j), and the opposite on (i, j) and (j,
//! i). So a spring's part of any combination is one [`SpringBlock`] B of the form `α(I − nnᵀ) + β nnᵀ`, and its product with w is
//! `s = B (w_i − w_j)`, added to row i and subtracted from row j: Add-Damping-Force and Add-Force-Differential of the lecture notes (see
//! [`spring`](crate::spring)) in one pass.
//!
//! Vectors are *reduced*: one number for every free degree of freedom, as in the assembled matrix. Reading the ends of a spring through the
//! [`DofMap`](crate::DofMap) puts zeros on prescribed axes, and adding to them drops these axes: the *Project* of the notes. The displacement of
//! prescribed particles goes to the right-hand side once a step, by [`subtract_coupling`](SystemOperator::subtract_coupling): their
//! *Set-Boundary-Conditions*.

use super::stream::SpringStream;
use super::{BlockDiagonal, LinearOperator};
use crate::force::SpringGeometry;
use crate::parallel;
use crate::spring::{Extension, Spring, SpringBlock, Stiffness};
use crate::system::{Axes, Derivatives, System};
use nalgebra::{Matrix3, Vector3};
use std::sync::atomic::{AtomicBool, Ordering};

/// Coefficients of `mass·M + damping·G + stiffness·K`.
///
/// # Examples
/// ```
/// use sprung::Stiffness;
/// use sprung::force::SpringGeometry;
/// use sprung::operator::{Combination, LinearOperator, SystemOperator};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// let extensions = SpringGeometry::at(&system, &state.positions)?;
/// let product = |combination| {
///     let operator = SystemOperator::new(&system, &extensions, Stiffness::Full, combination);
///     let mut y = vec![0.0; operator.order()];
///     operator.apply(&[1.0, 0.0, 0.0], &mut y);
///     y[0]
/// };
/// // A = M/dt² − G/dt − K, and K alone, which is negative along a spring.
/// assert!((product(Combination::step(0.5)) - (4.0 + 10.0)).abs() < 1e-13);
/// assert!((product(Combination { mass: 0.0, damping: 0.0, stiffness: 1.0 }) + 10.0).abs() < 1e-13);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Combination {
    /// Factor of M.
    pub mass: f64,
    /// Factor of G.
    pub damping: f64,
    /// Factor of K.
    pub stiffness: f64,
}

impl Combination {
    /// M alone, in kg.
    pub const MASS: Self = Self { mass: 1.0, damping: 0.0, stiffness: 0.0 };
    /// G alone, in N·s/m.
    pub const DAMPING: Self = Self { mass: 0.0, damping: 1.0, stiffness: 0.0 };
    /// K alone, in N/m.
    pub const STIFFNESS: Self = Self { mass: 0.0, damping: 0.0, stiffness: 1.0 };

    /// The matrix of a backward Euler step, `A = M/dt² − G/dt − K`, in N/m.
    pub fn step(dt: f64) -> Self {
        Self { mass: 1.0 / (dt * dt), damping: -1.0 / dt, stiffness: -1.0 }
    }
}

/// A combination of M, G and K at one configuration, as blocks.
#[derive(Debug, Clone)]
pub struct SystemOperator<'s> {
    system: &'s System,
    mass: f64,
    blocks: Vec<SpringBlock>,
    /// The blocks in the order and form in which a product reads them.
    stream: SpringStream,
    /// The multiple of M, one number a row.
    inertia: Vec<f64>,
    /// The derivatives of external forces, one block a particle; empty where there are none.
    external: Vec<Matrix3<f64>>,
    /// Positions in `blocks` of the springs that have a prescribed axis at one end.
    coupled: Vec<u32>,
}

impl<'s> SystemOperator<'s> {
    /// The combination at the given extensions, K under the given option.
    pub fn new(system: &'s System, extensions: &SpringGeometry, option: Stiffness, combination: Combination) -> Self {
        let modelled = Axes::first(system.dimension());
        let is_prescribed = |p: usize| system.dofs().free_axes(p) != modelled;
        let coupled = (0u32..).zip(system.active()).filter(|(_, (_, pair, _))| pair.iter().any(|&p| is_prescribed(p)));
        let coupled = coupled.map(|(position, _)| position).collect();
        let nothing = SpringBlock { direction: Vector3::zeros(), transverse: 0.0, axial: 0.0 };
        let blocks = vec![nothing; system.active_springs().len()];
        let inertia = vec![0.0; system.dofs().len()];
        let stream = SpringStream::new(system, &system.all_partitions());
        let external = Vec::new();
        let mut operator = Self { system, mass: 0.0, blocks, stream, inertia, external, coupled };
        operator.update(extensions, option, combination);
        operator
    }

    /// Recomputes the blocks, without allocating.
    pub fn update(&mut self, extensions: &SpringGeometry, option: Stiffness, combination: Combination) {
        self.set(extensions, combination, option, |_| option);
    }

    /// As [`update`](Self::update), with an option for every active spring by its position; external forces are treated as under `tension`.
    pub fn update_each(
        &mut self,
        extensions: &SpringGeometry,
        combination: Combination,
        option: impl Fn(usize) -> Stiffness + Sync,
    ) {
        self.set(extensions, combination, Stiffness::Tension, option);
    }

    fn set(
        &mut self,
        extensions: &SpringGeometry,
        combination: Combination,
        of_external: Stiffness,
        option: impl Fn(usize) -> Stiffness + Sync,
    ) {
        self.set_external_under(extensions, of_external, combination);
        self.set_blocks(extensions, combination.mass, |position, spring, at| {
            // K holds −K^s and G holds −b nnᵀ where the spring's own block stands, hence the signs.
            let block = spring.stiffness_block(at, option(position)) * -combination.stiffness;
            if spring.damping > 0.0 { block + spring.damping_block(at) * -combination.damping } else { block }
        });
    }

    /// Sets the operator to `mass·M` plus a block for every spring, by its position among the active ones: +B on both its diagonal blocks and −B
    /// between its ends.
    pub fn set_blocks(
        &mut self,
        extensions: &SpringGeometry,
        mass: f64,
        block: impl Fn(usize, &Spring, &Extension) -> SpringBlock + Sync,
    ) {
        let system = self.system;
        let some_negative = AtomicBool::new(false);
        parallel::pieces(&mut self.blocks, &|first, piece| {
            let springs = (first..).zip(extensions.from(system, first));
            let mut negative = false;
            for (target, (position, (spring, at))) in piece.iter_mut().zip(springs) {
                *target = block(position, spring, at);
                negative |= target.axial < 0.0;
            }
            if negative {
                some_negative.store(true, Ordering::Relaxed);
            }
        });
        let sign = if some_negative.into_inner() { -1.0 } else { 1.0 };
        self.stream.update(system, &self.blocks, sign);
        if std::mem::replace(&mut self.mass, mass) != mass {
            for (particle, kilograms) in system.masses().iter().enumerate() {
                self.inertia[system.dofs().rows(particle)].fill(mass * kilograms);
            }
        }
    }

    /// Sets the part of external forces, a `block` of their derivatives at every particle, in N/m, until the next call.
    pub fn set_external(&mut self, extensions: &SpringGeometry, block: impl Fn(&Derivatives) -> Matrix3<f64>) {
        self.external.resize(extensions.external().len(), Matrix3::zeros());
        for (target, derivatives) in self.external.iter_mut().zip(extensions.external()) {
            *target = block(derivatives);
        }
    }

    /// As [`set_external`](Self::set_external), for a combination under an option.
    pub fn set_external_under(&mut self, extensions: &SpringGeometry, option: Stiffness, combination: Combination) {
        self.set_external(extensions, |at| combined(at, option, combination));
    }

    /// A particle's part of its diagonal block beside its springs: its mass, and the external forces.
    #[inline]
    pub fn particle_block(&self, particle: usize) -> Matrix3<f64> {
        let mass = Matrix3::from_diagonal_element(self.mass * self.system.masses()[particle]);
        self.external.get(particle).map_or(mass, |external| mass + external)
    }

    /// The part of external forces, one block a particle; empty where there are none.
    pub fn external(&self) -> &[Matrix3<f64>] {
        &self.external
    }

    /// Whether all masses and blocks are finite.
    pub(crate) fn is_finite(&self) -> bool {
        let is_finite = |block: &Matrix3<f64>| block.iter().all(|entry| entry.is_finite());
        let springs = self.blocks.iter().all(|block| is_finite(&block.matrix()));
        self.mass.is_finite() && springs && self.external.iter().all(is_finite)
    }

    /// Whether no block of a spring or an external force has a negative eigenvalue, which makes their sum positive semidefinite.
    pub fn has_no_negative_block(&self) -> bool {
        let is_positive = |block: &Matrix3<f64>| lowest(block) >= 0.0;
        self.blocks.iter().all(|block| block.lowest() >= 0.0) && self.external.iter().all(is_positive)
    }

    /// The system.
    pub fn system(&self) -> &'s System {
        self.system
    }

    /// The factor of M.
    pub fn mass_factor(&self) -> f64 {
        self.mass
    }

    /// The block of every active spring.
    pub fn blocks(&self) -> &[SpringBlock] {
        &self.blocks
    }

    /// `b_f −= A_fc δx_c`: moves the displacement of prescribed coordinates, full-length, in m, zero on free axes, to the reduced right-hand side.
    pub fn subtract_coupling(&self, displacement: &[Vector3<f64>], rhs: &mut [f64]) {
        let dofs = self.system.dofs();
        for &position in &self.coupled {
            let position = position as usize;
            let [i, j] = self.system.pair(self.system.active_springs()[position] as usize);
            let s = self.blocks[position].apply(&(displacement[i] - displacement[j]));
            dofs.add(rhs, i, &-s);
            dofs.add(rhs, j, &s);
        }
        for (particle, (block, d)) in self.external.iter().zip(displacement).enumerate() {
            dofs.add(rhs, particle, &-(block * d));
        }
    }
}

/// The least eigenvalue of a symmetric block.
pub(super) fn lowest(block: &Matrix3<f64>) -> f64 {
    let [xy, xz, yz] = [block[(1, 0)], block[(2, 0)], block[(2, 1)]];
    if xy == 0.0 && xz == 0.0 && yz == 0.0 { block.diagonal().min() } else { block.symmetric_eigenvalues().min() }
}

/// `damping·D + stiffness·S` at a particle, or of their negative semidefinite parts under options that keep matrices definite.
fn combined(at: &Derivatives, option: Stiffness, combination: Combination) -> Matrix3<f64> {
    let part = |matrix: &Matrix3<f64>| if option == Stiffness::Full { *matrix } else { negative_part(matrix) };
    part(&at.damping) * combination.damping + part(&at.stiffness) * combination.stiffness
}

pub(crate) fn negative_part(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    if lowest(&-matrix) >= 0.0 {
        return *matrix;
    }
    let mut eigen = matrix.symmetric_eigen();
    eigen.eigenvalues.apply(|value| *value = value.min(0.0));
    let part = eigen.recompose();
    (part + part.transpose()) * 0.5
}

impl LinearOperator for SystemOperator<'_> {
    fn order(&self) -> usize {
        self.system.dofs().len()
    }

    fn apply(&self, w: &[f64], y: &mut [f64]) {
        if w.len() != self.order() || y.len() != self.order() {
            return y.fill(f64::NAN);
        }
        self.stream.multiply(self.system, &self.blocks, &self.inertia, w, y);
        let dofs = self.system.dofs();
        for (particle, block) in self.external.iter().enumerate() {
            dofs.add(y, particle, &(block * dofs.get(w, particle)));
        }
    }
}

impl BlockDiagonal for SystemOperator<'_> {
    fn diagonal_blocks(&self, blocks: &mut [Matrix3<f64>]) {
        for (block, mass) in blocks.iter_mut().zip(self.system.masses()) {
            *block = Matrix3::from_diagonal_element(self.mass * mass);
        }
        for ((_, pair, _), block) in self.system.active().zip(&self.blocks) {
            let matrix = block.matrix();
            pair.into_iter().for_each(|end| blocks[end] += matrix);
        }
        for (particle, block) in blocks.iter_mut().enumerate() {
            let free = self.system.dofs().free_axes(particle);
            for axis in (0..3).filter(|&axis| !free.contains(axis)) {
                block.row_mut(axis).fill(0.0);
                block.column_mut(axis).fill(0.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;

    /// An updated operator equals a new one, and products with K are those with −K but for the sign, to the bit.
    #[test]
    fn an_operator_becomes_another() {
        let mut builder = SystemBuilder::new();
        (0..9).for_each(|p| _ = builder.particle([1.3 * f64::from(p), f64::from(p * p % 5), 0.1 * f64::from(p)], 1.5));
        for i in 0..8 {
            builder.spring(i, i + 1, Spring { stiffness: 50.0 + i as f64, rest_length: 1.1, damping: 0.0 });
        }
        let (system, state) = builder.build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let w: Vec<f64> = (0..system.dofs().len()).map(|row| (1.0 + row as f64 * 12.9898).sin()).collect();
        let product = |operator: &SystemOperator| {
            let mut y = vec![f64::NAN; w.len()];
            operator.apply(&w, &mut y);
            y
        };
        let minus_k = Combination { stiffness: -1.0, ..Combination::STIFFNESS };
        let mut operator = SystemOperator::new(&system, &extensions, Stiffness::Full, minus_k);
        let opposite: Vec<f64> = product(&operator).iter().map(|y| -y).collect();
        let others =
            [Combination::STIFFNESS, Combination::MASS, minus_k, Combination::step(0.1), Combination::STIFFNESS];
        for combination in others {
            operator.update(&extensions, Stiffness::Full, combination);
            assert_eq!(
                product(&operator),
                product(&SystemOperator::new(&system, &extensions, Stiffness::Full, combination))
            );
        }
        assert_eq!(product(&operator), opposite);
    }
}
