//! The matrices whose definiteness decides about a step, as functions of `s = 1/dt`.
//!
//! ```text
//! P(s) = μ s² M − γ s G + C
//! definite:  μ = 1, γ = 1, C = −K_opt              P = A = M/dt² − G/dt − K_opt
//! stable:    μ = 4, γ = 2, C = −2 K_opt + K        P = S = 4M/dt² − 2G/dt − 2K_opt + K
//! ```

use crate::eigen::probe;
use crate::force::{DegenerateSpring, SpringGeometry};
use crate::linear::dot;
use crate::operator::{Combination, LinearOperator, SystemOperator, negative_part};
use crate::spring::{SpringBlock, Stiffness};
use crate::system::{State, System};
use nalgebra::Matrix3;

/// What a step is to keep.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Property {
    /// A is positive definite.
    Definite,
    /// A is positive definite and linearised backward Euler adds no instability of its own: S is positive semidefinite.
    Stable,
}

impl Property {
    /// μ, the factor of `s² M`.
    fn mass(self) -> f64 {
        match self {
            Self::Definite => 1.0,
            Self::Stable => 4.0,
        }
    }

    /// γ, the factor of `−s G`.
    fn damping(self) -> f64 {
        match self {
            Self::Definite => 1.0,
            Self::Stable => 2.0,
        }
    }
}

/// `uᵀP(s)u = mass s² + damping s + constant`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Curvature {
    pub mass: f64,
    pub damping: f64,
    pub constant: f64,
}

impl Curvature {
    /// The positive s at which the curvature vanishes; `None` when it is positive for every s > 0.
    pub fn root(&self) -> Option<f64> {
        let Self { mass, damping, constant } = *self;
        let discriminant = damping * damping - 4.0 * mass * constant;
        // The form without cancellation: damping ≥ 0 and constant < 0.
        (constant < 0.0).then(|| -2.0 * constant / (damping + discriminant.sqrt()))
    }
}

/// Products that look for the lowest eigenvector of the pencil (C, M).
const PROBES: usize = 60;

/// P(s) of a system at one state, as an operator.
pub(super) struct MatrixPencil<'s> {
    system: &'s System,
    extensions: SpringGeometry,
    operator: SystemOperator<'s>,
    /// G, for the curvature along a vector.
    damping: SystemOperator<'s>,
    product: Vec<f64>,
    /// m of every degree of freedom.
    masses: Vec<f64>,
}

impl<'s> MatrixPencil<'s> {
    pub fn new(system: &'s System, extensions: SpringGeometry) -> Self {
        let operator = |combination| SystemOperator::new(system, &extensions, Stiffness::Full, combination);
        let (damping, operator) = (operator(Combination::DAMPING), operator(Combination::STIFFNESS));
        let mut masses = vec![0.0; system.dofs().len()];
        for (particle, mass) in system.masses().iter().enumerate() {
            masses[system.dofs().rows(particle)].fill(*mass);
        }
        Self { system, damping, operator, extensions, product: vec![0.0; masses.len()], masses }
    }

    /// Moves to another state of the same system.
    ///
    /// # Errors
    /// Coincident ends of a spring.
    pub fn update(&mut self, state: &State) -> Result<(), DegenerateSpring> {
        self.extensions.update(self.system, state)?;
        self.damping.update(&self.extensions, Stiffness::Full, Combination::DAMPING);
        Ok(())
    }

    /// Makes the operator P(s).
    pub fn set(&mut self, requirement: Property, option: Stiffness, s: f64) {
        let (mass, damping) = (requirement.mass() * s * s, requirement.damping() * s);
        self.operator.set_external(&self.extensions, |at| {
            let dropped = -if option == Stiffness::Full { at.stiffness } else { negative_part(&at.stiffness) };
            let stiffness = match requirement {
                Property::Definite => dropped,
                Property::Stable => dropped * 2.0 + at.stiffness,
            };
            stiffness - at.damping * damping
        });
        self.operator.set_blocks(&self.extensions, mass, |_, spring, at| {
            let dropped = spring.stiffness_block(at, option);
            let stiffness = match requirement {
                Property::Definite => dropped,
                Property::Stable => dropped * 2.0 + spring.stiffness_block(at, Stiffness::Full) * -1.0,
            };
            stiffness + spring.damping_block(at) * damping
        });
    }

    pub fn operator(&self) -> &SystemOperator<'s> {
        &self.operator
    }

    pub fn extensions(&self) -> &SpringGeometry {
        &self.extensions
    }

    pub fn blocks(&self) -> &[SpringBlock] {
        self.operator.blocks()
    }

    /// The coefficients of `uᵀP(s)u`. Leaves the operator at s = 0.
    pub fn curvature(&mut self, requirement: Property, option: Stiffness, u: &[f64]) -> Curvature {
        let kinetic: f64 = u.iter().zip(&self.masses).map(|(u, mass)| mass * u * u).sum();
        self.damping.apply(u, &mut self.product);
        let damping = -dot(u, &self.product);
        self.set(requirement, option, 0.0);
        self.operator.apply(u, &mut self.product);
        let constant = dot(u, &self.product);
        Curvature { mass: requirement.mass() * kinetic, damping: requirement.damping() * damping, constant }
    }

    /// A vector along which `uᵀCu/uᵀMu` is nearly lowest, by products with `M⁻¹C`; expects the operator at s = 0.
    pub fn lowest_direction(&self) -> Option<Vec<f64>> {
        let apply = |x: &[f64], y: &mut [f64]| {
            self.operator.apply(x, y);
            y.iter_mut().zip(&self.masses).for_each(|(y, mass)| *y /= mass);
        };
        probe(self.masses.len(), Some(&self.masses), PROBES, &mut { apply }).map(|[low, _]| low.vector)
    }

    /// m of every degree of freedom, in kg.
    pub fn masses(&self) -> &[f64] {
        &self.masses
    }

    /// `‖M^{-1/2} P(s) u‖/(2 s² ‖M^{1/2} u‖)`, at the s of the operator: nearly how far the root along u is from the s at which P is singular,
    /// relatively, where there is no damping.
    pub fn residual(&mut self, u: &[f64]) -> f64 {
        let Self { operator, product, masses, .. } = self;
        operator.apply(u, product);
        let left: f64 = product.iter().zip(&*masses).map(|(p, mass)| p * p / mass).sum();
        let kinetic: f64 = u.iter().zip(&*masses).map(|(u, mass)| mass * u * u).sum();
        0.5 * left.sqrt() / (operator.mass_factor() * kinetic.sqrt())
    }

    /// A bound for ‖P(s)‖: the largest sum of `μ s² m_i` and twice the norms of the blocks at a particle that can move, whose rows P has.
    /// Expects the operator at s = 0, so that damping is left out.
    pub fn norm_bound(&self, s: f64, requirement: Property) -> f64 {
        let mut sums: Vec<f64> = self.system.masses().iter().map(|m| requirement.mass() * s * s * m).collect();
        sums.iter_mut().zip(self.operator.external()).for_each(|(sum, block)| *sum += block.norm());
        for ((_, [i, j], _), block) in self.system.active().zip(self.blocks()) {
            let norm = 2.0 * block.transverse.abs().max(block.axial.abs());
            sums[i] += norm;
            sums[j] += norm;
        }
        let dofs = self.system.dofs();
        let free = sums.into_iter().enumerate().filter(|(p, _)| !dofs.rows(*p).is_empty());
        free.map(|(_, sum)| sum).fold(0.0, f64::max)
    }

    /// An s at which P is positive definite for certain; expects the operator at s = 0.
    ///
    /// A spring with the lowest eigenvalue −c takes at most `c‖u_i − u_j‖² ≤ 2c(‖u_i‖² + ‖u_j‖²)` from uᵀPu, and only
    /// `c‖u_i‖²` where j is held. So `μ s² m_i > Σ 2c` over the springs at every particle i is enough.
    pub fn surely_definite(&self, requirement: Property) -> f64 {
        let of_external = |block: &Matrix3<f64>| block.symmetric_eigenvalues().min().min(0.0).abs();
        let largest = self.largest_per_mass(|block| (-block.lowest()).max(0.0), of_external);
        // A little above, so that rounding does not make the factorization fail there.
        (largest / requirement.mass()).sqrt() * (1.0 + 1e-6)
    }

    /// The largest `Σ 2c/m_i` of all particles i, c what `coefficient` says of the block of each spring at i (`c/m_i` instead where
    /// the spring's other end is held). For c ≥ ‖block‖ it bounds `‖M^{-1/2} C M^{-1/2}‖`.
    fn largest_per_mass(
        &self,
        coefficient: impl Fn(&SpringBlock) -> f64,
        of_external: impl Fn(&Matrix3<f64>) -> f64,
    ) -> f64 {
        let dofs = self.system.dofs();
        let mut taken = vec![0.0; self.system.particles()];
        taken.iter_mut().zip(self.operator.external()).for_each(|(taken, block)| *taken = of_external(block));
        for ((_, [i, j], _), block) in self.system.active().zip(self.blocks()) {
            let both_free = [i, j].iter().all(|&p| !dofs.rows(p).is_empty());
            let share = coefficient(block) * if both_free { 2.0 } else { 1.0 };
            taken[i] += share;
            taken[j] += share;
        }
        let free = taken.iter().zip(self.system.masses()).enumerate().filter(|(p, _)| !dofs.rows(*p).is_empty());
        free.map(|(_, (taken, mass))| taken / mass).fold(0.0, f64::max)
    }
}
