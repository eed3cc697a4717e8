//! The matrices whose definiteness decides about a step, as functions of `s = 1/dt`.
//!
//! ```text
//! P(s) = μ s² M − γ s G + C
//! definite:  μ = 1, γ = 1, C = −K_opt              P = A = M/dt² − G/dt − K_opt
//! stable:    μ = 4, γ = 2, C = −2 K_opt + K        P = S = 4M/dt² − 2G/dt − 2K_opt + K
//! ```

use super::krylov::Krylov;
use super::random::gaussian;
use super::space::{Curvature, Space, Term};
use crate::force::{DegenerateSpring, Extensions};
use crate::linear::{Ldlt, SOLVE_COLUMNS, dot, norm};
use crate::operator::{Combination, LinearOperator, SystemOperator, negative_part};
use crate::spring::{SpringBlock, Stiffness};
use crate::system::{State, System};
use crate::work::Work;
use nalgebra::Matrix3;
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;

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

/// Relative residual at which a direction is good enough, and the most steps for it: as many as fill the space once.
const RESIDUAL: f64 = 1e-9;
const STEPS: usize = 12;

/// P(s) of a system at one state, as an operator.
pub(super) struct Family<'s> {
    system: &'s System,
    extensions: Extensions,
    operator: SystemOperator<'s>,
    /// G, for the curvature along a vector.
    damping: SystemOperator<'s>,
    product: Vec<f64>,
    /// √m of every degree of freedom.
    roots: Vec<f64>,
}

impl<'s> Family<'s> {
    pub fn new(system: &'s System, extensions: Extensions) -> Self {
        let operator = |combination| SystemOperator::new(system, &extensions, Stiffness::Full, combination);
        let (damping, operator) = (operator(Combination::DAMPING), operator(Combination::STIFFNESS));
        let mut roots = vec![0.0; system.dofs().len()];
        for (particle, mass) in system.masses().iter().enumerate() {
            roots[system.dofs().rows(particle)].fill(mass.sqrt());
        }
        Self { system, damping, operator, extensions, product: vec![0.0; roots.len()], roots }
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

    pub fn blocks(&self) -> &[SpringBlock] {
        self.operator.blocks()
    }

    /// The coefficients of `uᵀP(s)u`. Leaves the operator at s = 0.
    pub fn curvature(&mut self, requirement: Property, option: Stiffness, u: &[f64]) -> Curvature {
        let dofs = self.system.dofs();
        let square = |p: usize| u[dofs.rows(p)].iter().map(|u| u * u).sum::<f64>();
        let kinetic: f64 = self.system.masses().iter().enumerate().map(|(p, mass)| mass * square(p)).sum();
        self.damping.apply(u, &mut self.product);
        let damping = -dot(u, &self.product);
        self.set(requirement, option, 0.0);
        self.operator.apply(u, &mut self.product);
        let constant = dot(u, &self.product);
        Curvature { mass: requirement.mass() * kinetic, damping: requirement.damping() * damping, constant }
    }

    /// A vector along which `uᵀCu/uᵀMu` is nearly lowest, from a Krylov space of `τ − M^{-1/2} C M^{-1/2}`, τ a bound for the norm
    /// of the latter; expects the operator at s = 0. `start` may be empty, or something near it.
    pub fn softest_direction(&mut self, start: &[f64]) -> Vec<f64> {
        let n = self.system.dofs().len();
        let size = |block: &SpringBlock| block.transverse.abs().max(block.axial.abs());
        let bound = self.largest_per_mass(size, Matrix3::norm);
        let Self { operator, product, roots, .. } = self;
        let mut apply = |x: &[f64], y: &mut [f64]| {
            for (x, y) in x.chunks(n).zip(y.chunks_mut(n)) {
                product.iter_mut().zip(x).zip(&*roots).for_each(|((p, x), root)| *p = x / root);
                operator.apply(product, y);
                y.iter_mut().zip(x).zip(&*roots).for_each(|((y, x), root)| *y = bound * x - *y / root);
            }
        };
        let start: Vec<f64> = start.iter().zip(&*roots).map(|(u, root)| u * root).collect();
        let start = if start.is_empty() { Vec::new() } else { vec![start] };
        let found = Krylov::from_vectors(n, 1, &start, &mut apply).iterate(RESIDUAL, STEPS, &mut apply);
        let mut u = found.into_iter().next().map_or_else(|| vec![0.0; n], |pair| pair.vector);
        u.iter_mut().zip(&self.roots).for_each(|(u, root)| *u /= root);
        u
    }

    /// Where some `P(s₀)` has been factored and found definite: turns u to the null vector of P(s*), nearly, by solves. `M^{1/2}P(s₀)⁻¹M^{1/2}r`
    /// extends a [`Space`] for the residuals r of its lowest eigenvectors at its root, until that is no farther than `enough` from s*,
    /// relatively, as is thought. Says how far that is, by Kato's and Temple's bound: the square of the residual over the distance to the next
    /// eigenvalue that can be told from zero.
    pub fn soften(
        &mut self,
        requirement: Property,
        option: Stiffness,
        factorization: &mut Ldlt,
        u: &mut [f64],
        enough: f64,
        work: &mut Work,
    ) -> f64 {
        let n = u.len();
        let mut space = Space::default();
        u.iter_mut().zip(&self.roots).for_each(|(u, root)| *u *= root);
        self.join(&mut space, requirement, option, u);
        let mut fresh = vec![0.0; n];
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        for _ in 1..SOLVE_COLUMNS {
            gaussian(&mut rng, &mut fresh);
            self.join(&mut space, requirement, option, &fresh);
        }
        let (mut margin, mut before) = (f64::INFINITY, 0.0);
        let (mut columns, mut residual) = (Vec::new(), vec![0.0; n]);
        for step in 0..=STEPS {
            let Some((s, eigen)) = space.root() else { break };
            self.set(requirement, option, s);
            let values = &eigen.eigenvalues;
            let mut order: Vec<usize> = (0..values.len()).collect();
            order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
            let steepness = 2.0 * requirement.mass() * s * s;
            columns.clear();
            for (k, &column) in order.iter().take(SOLVE_COLUMNS).enumerate() {
                space.combine(eigen.eigenvectors.column(column).iter(), &mut fresh);
                self.scaled_product(&fresh, &mut residual);
                residual.iter_mut().zip(&fresh).for_each(|(r, x)| *r -= values[column] * x);
                if k == 0 {
                    u.copy_from_slice(&fresh);
                    let length = norm(&residual);
                    let beyond = order.iter().map(|&other| values[other]).find(|&value| value > 2.0 * length);
                    margin = length * length / (beyond.unwrap_or(length) * steepness);
                }
                columns.extend(residual.iter().zip(&self.roots).map(|(r, root)| r * root));
            }
            // A root that rises no more is there, even where eigenvalues lie so close that the bound does not tell.
            if s - before <= enough * s {
                margin = margin.min(enough);
            }
            if margin <= enough || step == STEPS {
                break;
            }
            before = s;
            work.solves += (columns.len() / n) as u64;
            factorization.substitute_columns(n, &mut columns);
            let size = space.len();
            for column in columns.chunks_mut(n) {
                column.iter_mut().zip(&self.roots).for_each(|(x, root)| *x *= root);
                self.join(&mut space, requirement, option, column);
            }
            if space.len() == size {
                break;
            }
        }
        u.iter_mut().zip(&self.roots).for_each(|(u, root)| *u /= root);
        margin
    }

    /// Adds `M^{1/2}u` to a space for `M^{-1/2}P(s)M^{-1/2}`.
    fn join(&mut self, space: &mut Space, requirement: Property, option: Stiffness, vector: &[f64]) {
        self.set(requirement, option, 0.0);
        let Self { damping, operator, product, roots, .. } = self;
        space.add(vector, |term, v, image| {
            product.iter_mut().zip(v).zip(&*roots).for_each(|((p, v), root)| *p = v / root);
            match term {
                Term::Mass => image.iter_mut().zip(v).for_each(|(image, v)| *image = requirement.mass() * v),
                Term::Damping => damping.apply(product, image),
                Term::Constant => operator.apply(product, image),
            }
            match term {
                Term::Mass => {}
                Term::Damping => {
                    image.iter_mut().zip(&*roots).for_each(|(y, root)| *y *= -requirement.damping() / root);
                }
                Term::Constant => image.iter_mut().zip(&*roots).for_each(|(y, root)| *y /= root),
            }
        });
    }

    /// `M^{-1/2} P M^{-1/2} x` with the P of the operator.
    fn scaled_product(&mut self, x: &[f64], y: &mut [f64]) {
        let Self { operator, product, roots, .. } = self;
        product.iter_mut().zip(x).zip(&*roots).for_each(|((p, x), root)| *p = x / root);
        operator.apply(product, y);
        y.iter_mut().zip(&*roots).for_each(|(y, root)| *y /= root);
    }

    /// `‖M^{-1/2} P(s) u‖/(2 s² ‖M^{1/2} u‖)`, at the s of the operator: nearly how far the root along u is from the s at which P is singular,
    /// relatively, where there is no damping.
    pub fn residual(&mut self, u: &[f64]) -> f64 {
        let Self { operator, product, roots, .. } = self;
        operator.apply(u, product);
        let left: f64 = product.iter().zip(&*roots).map(|(p, root)| (p / root).powi(2)).sum();
        let kinetic: f64 = u.iter().zip(&*roots).map(|(u, root)| (u * root).powi(2)).sum();
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
