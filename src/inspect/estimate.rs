//! An inspection of a matrix that is not factored: by products, multigrid, and what springs and masses prove.
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
//! The last is `wᵀBw ≤ c‖uᵢ − uⱼ‖² ≤ 2c (‖uᵢ‖² + ‖uⱼ‖²)`, summed. u comes from the solver of `eigen`, preconditioned with multigrid for A without the
//! transverse terms of compressed springs, which is always positive definite: where nothing is compressed that is A itself.

use super::critical::LargestStep;
use super::culprits::direction;
use super::inertia::{Inertia, lightest};
use super::inspection::{Inspection, place};
use super::matrix_pencil::{MatrixPencil, Property};
use super::quick_check::FirstAnswer;
use super::skipped::{Part, SkipReason, Skipped};
use super::spectrum::Spectrum;
use crate::eigen::{BlockLanczos, Eigenpair, End, Search, Tolerance};
use crate::error::Result;
use crate::force::SpringGeometry;
use crate::memory;
use crate::multigrid::Multigrid;
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::spring::{SpringBlock, Stiffness};
use crate::system::{State, System};
use crate::work::Work;

/// Bytes for every row: two bases of 26 vectors, multigrid beside them, and what else is as long.
const ROW: u64 = 800;

/// Vectors that are improved together, and vectors in the basis.
const BLOCK: usize = 3;
const CAPACITY: usize = 16;

/// Blocks of the search for λ_min at most, and of that for λ_max, which has blocks of one.
const STEPS: usize = 40;
const LARGEST: usize = 160;

/// An eigenvalue is good enough when A has one within this part of it.
const ENOUGH: f64 = 1e-3;

/// Curvature below which a sign is one, as a part of ‖A‖: products of rows of some hundred entries have errors of 1e-15 of it.
const SIGN: f64 = 1e-13;

impl Inspection {
    /// By products and multigrid alone; what they cannot tell is skipped, for a reason.
    pub(super) fn estimated(
        system: &System,
        state: &State,
        dt: f64,
        option: Stiffness,
        why: SkipReason,
        onlooker: &mut dyn FnMut(f64, &Self),
    ) -> Result<Self> {
        memory::ensure(ROW * system.dofs().len() as u64, "an estimate of eigenvalues")?;
        let extensions = SpringGeometry::at(system, state)?;
        let mut found = Self::unknown(system, &extensions, dt, option);
        found.skipped = Part::all().map(|part| Skipped { part, why }).collect();
        let operator = |option| SystemOperator::new(system, &extensions, option, Combination::step(dt));
        let mut multigrid = multigrid(system, state, &operator(Stiffness::Tension));
        let mut options = Stiffness::ALL;
        options.sort_by_key(|&each| each != option);
        let mut near: Option<Eigenpair> = None;
        for (k, each) in options.into_iter().enumerate() {
            let a = operator(each);
            found.work.assemblies += 1;
            let spectrum = spectrum(&a, multigrid.as_mut(), near.as_ref(), &mut found.work);
            let lowest = spectrum.lowest.first().cloned();
            let is_definite = proves_definite(&a);
            let told = &mut found.options[place(each)];
            told.take(&spectrum);
            if is_definite {
                told.inertia = Inertia::definite(a.order());
                told.critical = LargestStep::Every;
                found.known(Part::Signs(each));
                found.known(Part::Definite(each));
            } else if each != Stiffness::Full {
                told.critical = LargestStep::Every;
                found.known(Part::Definite(each));
            }
            found.told_by_estimate(Part::Spectrum(each));
            if each == option {
                if let Some(pair) = &lowest {
                    found.answer(system, &extensions, &a, pair);
                }
                found.examine(system, &extensions, spectrum);
            }
            near = lowest.or(near);
            onlooker(0.1 + 0.3 * (k + 1) as f64, &found);
        }
        found.settled_by_springs(system, &extensions);
        Ok(found)
    }

    /// Takes over an answer to the first question.
    fn answer(&mut self, system: &System, extensions: &SpringGeometry, a: &SystemOperator<'_>, pair: &Eigenpair) {
        let is_indefinite = pair.value < -SIGN * proven_ceiling(a);
        let is_proven = is_indefinite || proves_definite(a);
        let direction = direction(system, extensions, self.option, pair);
        self.first = Some(FirstAnswer { definite: !is_indefinite, is_proven, direction, residual: pair.residual });
        match is_proven {
            true => self.known(Part::FirstAnswer),
            false => self.told_by_estimate(Part::FirstAnswer),
        }
    }

    /// What no spring's block leaves open: without negative ones nothing grows and every step is definite.
    fn settled_by_springs(&mut self, system: &System, extensions: &SpringGeometry) {
        let k = Combination { mass: 0.0, damping: 0.0, stiffness: -1.0 };
        if SystemOperator::new(system, extensions, Stiffness::Full, k).has_no_negative_block() {
            self.growing_modes = 0;
            let full = &mut self.options[place(Stiffness::Full)];
            (full.critical, full.stable) = (LargestStep::Every, LargestStep::Every);
            for part in [Part::GrowingModes, Part::SmallestSet, Part::Stable(Stiffness::Full)] {
                self.known(part);
            }
        }
        let mut pencil = MatrixPencil::new(system, extensions.clone());
        for option in [Stiffness::Tension, Stiffness::Axial] {
            pencil.set(Property::Stable, option, 0.0);
            if pencil.operator().has_no_negative_block() {
                self.options[place(option)].stable = LargestStep::Every;
                self.known(Part::Stable(option));
            }
        }
    }

    fn known(&mut self, part: Part) {
        self.skipped.retain(|skipped| skipped.part != part);
    }

    fn told_by_estimate(&mut self, part: Part) {
        self.known(part);
        if !self.estimated.contains(&part) {
            self.estimated.push(part);
        }
    }
}

/// Multigrid for a positive definite A, where there is the memory for it.
fn multigrid(system: &System, state: &State, positive: &SystemOperator<'_>) -> Option<Multigrid> {
    let mut multigrid = Multigrid::new(system).ok()?;
    multigrid.set_positions(&state.positions);
    multigrid.refill(positive).ok()?;
    multigrid.rebuild(positive).ok()?;
    Some(multigrid)
}

/// Both ends of the spectrum, the low one from a vector near it; `condition` is NaN where A may be singular.
fn spectrum(
    a: &SystemOperator<'_>,
    mut multigrid: Option<&mut Multigrid>,
    start: Option<&Eigenpair>,
    work: &mut Work,
) -> Spectrum {
    let n = a.order();
    let mut apply = |x: &[f64], y: &mut [f64]| x.chunks(n).zip(y.chunks_mut(n)).for_each(|(x, y)| a.apply(x, y));
    let search = |end, block| Search { end, wanted: 1, block, capacity: CAPACITY };
    let tolerance = Tolerance { of_value: ENOUGH, of_norm: 0.0 };
    let mut high = BlockLanczos::new(n, None, search(End::Highest, 1), 3);
    high.refresh(&mut apply);
    let high = high.iterate(tolerance, LARGEST, &mut apply, None);
    let mut low = BlockLanczos::new(n, None, search(End::Lowest, BLOCK), 4);
    low.start(start.iter().map(|pair| &pair.vector[..]), &mut apply);
    low.refresh(&mut apply);
    let mut precondition = |r: &[f64], z: &mut [f64]| match &mut multigrid {
        Some(multigrid) => {
            work.multigrid_iterations += 1;
            multigrid.apply(r, z);
        }
        None => z.copy_from_slice(r),
    };
    let low = low.iterate(tolerance, STEPS, &mut apply, Some(&mut precondition));
    let pair = |pair: crate::eigen::Ritz| Eigenpair { value: pair.value, vector: pair.vector, residual: pair.residual };
    let lowest: Vec<Eigenpair> = low.into_iter().map(pair).collect();
    let smallest = lowest.first().map_or(f64::NAN, |pair| pair.value);
    let largest = high.first().map_or(f64::NAN, |pair| pair.value);
    let ceiling = proven_ceiling(a);
    let rounding = SIGN * ceiling;
    // Of an indefinite A another eigenvalue may be nearer to zero than λ_min, and nothing is known of it.
    let condition = if smallest > 0.0 { largest.abs().max(smallest) / smallest } else { f64::NAN };
    let (smallest_within, largest_within) = ([proven_floor(a), smallest + rounding], [largest - rounding, ceiling]);
    Spectrum { lowest, largest, condition, smallest_within, largest_within }
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
    let free = sums.iter().enumerate().filter(|(p, _)| !system.dofs().rows(*p).is_empty());
    free.map(|(_, sum)| *sum).fold(0.0, f64::max)
}

/// Whether the blocks prove that A is positive definite.
fn proves_definite(a: &SystemOperator<'_>) -> bool {
    let floor = proven_floor(a);
    floor > SIGN * proven_ceiling(a) && floor.is_finite()
}
