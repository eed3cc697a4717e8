//! What can be told of A without factoring it: by products, multigrid, and what springs and masses prove.
//!
//! A factor of a large matrix may not fit the memory, or take too long. What is left is told apart into proofs and estimates:
//!
//! | figure | proven | estimated |
//! |---|---|---|
//! | A is indefinite | a direction u with `uᵀAu < 0` | |
//! | A is positive definite | no spring's block has a negative eigenvalue, and every particle has a mass | where no such direction is found |
//! | λ_min from above | `uᵀAu`, a Rayleigh quotient | λ_min itself |
//! | λ_min from below | `min mᵢ/dt²`, without negative blocks | |
//! | λ_max from below | a Rayleigh quotient | λ_max itself |
//! | λ_max from above | `maxᵢ (mᵢ/dt² + Σ 2c)` over the springs at i, c the largest eigenvalue of each's block | |
//!
//! The last is `wᵀBw ≤ c‖uᵢ − uⱼ‖² ≤ 2c (‖uᵢ‖² + ‖uⱼ‖²)`, summed. u is the first of a few vectors of `lobpcg`, preconditioned with multigrid for A without
//! the transverse terms of compressed springs, which is always positive definite: where nothing is compressed that is A itself.

use super::eigenpair::{Eigenpair, eigenpair};
use super::inertia::lightest;
use super::lanczos::{self, lowest_vector};
use super::lobpcg::{Pairs, lowest};
use super::random::gaussian;
use super::spectrum::Spectrum;
use crate::force::Extensions;
use crate::multigrid::Multigrid;
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::spring::{SpringBlock, Stiffness};
use crate::system::{State, System};
use crate::work::Work;
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;

/// Vectors that are improved together.
const BLOCK: usize = 3;

/// Steps of the search for λ_min at most, and products of the recurrences that begin it and that find λ_max.
const STEPS: usize = 40;
const START: usize = 40;
const LARGEST: usize = 160;

/// An eigenvalue is good enough when A has one within this part of it, or within this part of a bound from below.
const ENOUGH: f64 = 1e-3;

/// Curvature below which a sign is one, as a part of ‖A‖: products of rows of some hundred entries have errors of 1e-15 of it.
const SIGN: f64 = 1e-13;

/// Estimates of A at one state, for one step length, under any option.
pub(super) struct Estimator<'s> {
    system: &'s System,
    extensions: Extensions,
    dt: f64,
    multigrid: Option<Multigrid>,
}

impl<'s> Estimator<'s> {
    /// With multigrid, where there is the memory for it.
    pub fn new(system: &'s System, state: &State, extensions: Extensions, dt: f64) -> Self {
        let positive = SystemOperator::new(system, &extensions, Stiffness::Tension, Combination::step(dt));
        let multigrid = Multigrid::new(system).ok().and_then(|mut multigrid| {
            multigrid.place(&state.positions);
            multigrid.refill(&positive).ok()?;
            multigrid.rebuild(&positive).ok()?;
            Some(multigrid)
        });
        Self { system, extensions, dt, multigrid }
    }

    /// A under an option.
    pub fn operator(&self, option: Stiffness) -> SystemOperator<'s> {
        SystemOperator::new(self.system, &self.extensions, option, Combination::step(self.dt))
    }

    /// A vector along which A curves downwards, or little upwards, from products alone.
    pub fn first(&self, a: &SystemOperator<'_>) -> Option<Eigenpair> {
        let u = lowest_vector(a.order(), START, &mut |x: &[f64], y: &mut [f64]| a.apply(x, y))?;
        Some(eigenpair(a, u))
    }

    /// Both ends of the spectrum, the low one from a vector near it, `condition` infinite where A may be singular.
    pub fn spectrum(&mut self, a: &SystemOperator<'_>, start: Option<&Eigenpair>, work: &mut Work) -> Spectrum {
        let n = a.order();
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(4);
        let mut vectors: Vec<Vec<f64>> = start.map(|pair| pair.vector.clone()).into_iter().collect();
        while vectors.len() < BLOCK.min(n) {
            let mut vector = vec![0.0; n];
            gaussian(&mut rng, &mut vector);
            vectors.push(vector);
        }
        let floor = proven_floor(a);
        let high = lanczos::upper_end(n, LARGEST, &mut |x: &[f64], y: &mut [f64]| a.apply(x, y));
        let ceiling = proven_ceiling(a);
        let mut iterations = 0;
        let mut enough = |pairs: &Pairs| {
            iterations += 1;
            let (Some(value), Some(residual)) = (pairs.values.first(), pairs.residuals.first()) else { return true };
            *residual <= ENOUGH * value.abs() && *value != 0.0 || floor > 0.0 && *value <= (1.0 + ENOUGH) * floor
        };
        let multigrid = &mut self.multigrid;
        let mut precondition = |r: &[f64], z: &mut [f64]| match multigrid {
            Some(multigrid) => multigrid.apply(r, z),
            None => z.copy_from_slice(r),
        };
        let found = lowest(vectors, &mut |x, y| a.apply(x, y), &mut precondition, STEPS, &mut enough);
        work.multigrid_iterations += (iterations * BLOCK) as u64;
        let pairs = found.values.iter().zip(found.vectors).zip(found.residuals);
        let lowest: Vec<Eigenpair> =
            pairs.map(|((&value, vector), residual)| Eigenpair { value, vector, residual }).collect();
        let smallest = lowest.first().map_or(f64::NAN, |pair| pair.value);
        let (largest, rounding) = (high.value, SIGN * ceiling);
        // Of an indefinite A another eigenvalue may be nearer to zero than λ_min, and nothing is known of it.
        let condition = if smallest > 0.0 { largest.abs().max(smallest) / smallest } else { f64::NAN };
        let (smallest_within, largest_within) = ([floor, smallest + rounding], [largest - rounding, ceiling]);
        Spectrum { lowest, largest, condition, smallest_within, largest_within }
    }
}

/// `min mᵢ/dt²`, below every eigenvalue where no block has a negative one.
fn proven_floor(a: &SystemOperator<'_>) -> f64 {
    if a.has_no_negative_block() { a.mass_factor() * lightest(a.system()) } else { f64::NEG_INFINITY }
}

/// A bound for λ_max.
fn proven_ceiling(a: &SystemOperator<'_>) -> f64 {
    let system = a.system();
    let highest = |block: &SpringBlock| block.axial.max(block.transverse).max(0.0);
    let mut sums: Vec<f64> = system.masses().iter().map(|mass| a.mass_factor() * mass).collect();
    sums.iter_mut().zip(a.external()).for_each(|(sum, block)| *sum += block.norm());
    for ((_, [i, j], _), block) in system.active().zip(a.blocks()) {
        sums[i] += 2.0 * highest(block);
        sums[j] += 2.0 * highest(block);
    }
    let dofs = system.dofs();
    let free = sums.iter().enumerate().filter(|(p, _)| !dofs.rows(*p).is_empty());
    free.map(|(_, sum)| *sum).fold(0.0, f64::max)
}

/// Whether an eigenpair proves that A is indefinite.
pub(super) fn proves_indefinite(a: &SystemOperator<'_>, pair: &Eigenpair) -> bool {
    pair.value < -SIGN * proven_ceiling(a)
}

/// Whether the blocks prove that A is positive definite.
pub(super) fn proves_definite(a: &SystemOperator<'_>) -> bool {
    let floor = proven_floor(a);
    floor > SIGN * proven_ceiling(a) && floor.is_finite()
}
