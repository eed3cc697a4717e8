//! An inspection of a matrix too large to be factored: by products, multigrid, and the blocks of springs and masses.
//!
//! Its figures are proofs or estimates:
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
//! transverse terms of compressed springs, which is positive definite.

use super::critical::{LargestStep, MatrixPencil, Property};
use super::culprits::direction;
use super::inertia::{Inertia, largest_at_particle};
use super::inspection::{FirstAnswer, Inspection, Part, SkipReason, examined_first};
use super::spectrum::{ROUNDING, Spectrum};
use crate::eigen::{BlockLanczos, Eigenpair, End, Search, Tolerance, multigrid_for, preconditioner, scaled_products};
use crate::error::Result;
use crate::force::SpringGeometry;
use crate::memory;
use crate::multigrid::Multigrid;
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::spring::{SpringBlock, Stiffness};
use crate::system::{State, System};
use crate::work::Work;

impl Inspection {
    /// By products and multigrid alone; the other parts are skipped for a reason.
    pub(super) fn estimated(
        system: &System,
        state: &State,
        dt: f64,
        option: Stiffness,
        why: SkipReason,
        observer: &mut dyn FnMut(f64, &Self),
    ) -> Result<Self> {
        memory::ensure(800 * system.dofs().len() as u64, "an estimate of eigenvalues")?;
        let extensions = SpringGeometry::at(system, state)?;
        let mut found = Self::unknown(system, &extensions, dt, option, why);
        let operator = |option| SystemOperator::new(system, &extensions, option, Combination::step(dt));
        let mut multigrid = multigrid_for(&operator(Stiffness::Tension), &state.positions);
        let mut near: Option<Eigenpair> = None;
        for (k, each) in examined_first(option).into_iter().enumerate() {
            let a = operator(each);
            found.work.assemblies += 1;
            let spectrum = spectrum(&a, multigrid.as_mut(), near.as_ref(), &mut found.work);
            let lowest = spectrum.lowest.first().cloned();
            let is_definite = proves_definite(&a);
            found.options[each as usize].set_spectrum(&spectrum);
            if is_definite {
                found.options[each as usize].inertia = Inertia::definite(a.order());
                found.set_known(Part::Signs(each));
            }
            if is_definite || each != Stiffness::Full {
                found.options[each as usize].critical = LargestStep::Every;
                found.set_known(Part::Definite(each));
            }
            found.set_estimated(Part::Spectrum(each));
            if each == option {
                if let Some(pair) = &lowest {
                    found.answer(system, &extensions, &a, pair);
                }
                found.examine(system, &extensions, spectrum);
            }
            near = lowest.or(near);
            observer(0.1 + 0.3 * (k + 1) as f64, &found);
        }
        found.settled_by_springs(system, &extensions);
        Ok(found)
    }

    fn answer(&mut self, system: &System, extensions: &SpringGeometry, a: &SystemOperator<'_>, pair: &Eigenpair) {
        let is_indefinite = pair.value < -ROUNDING * proven_ceiling(a);
        let is_proven = is_indefinite || proves_definite(a);
        let direction = direction(system, extensions, self.option, pair);
        self.first = Some(FirstAnswer { definite: !is_indefinite, is_proven, direction, residual: pair.residual });
        match is_proven {
            true => self.set_known(Part::FirstAnswer),
            false => self.set_estimated(Part::FirstAnswer),
        }
    }

    /// Without negative blocks every step is stable, and under `Full` nothing grows.
    fn settled_by_springs(&mut self, system: &System, extensions: &SpringGeometry) {
        let mut pencil = MatrixPencil::new(system, extensions.clone(), Property::Stable, Stiffness::Full);
        for option in Stiffness::ALL {
            pencil.option = option;
            pencil.set(0.0);
            if pencil.operator.has_no_negative_block() {
                self.options[option as usize].stable = LargestStep::Every;
                self.set_known(Part::Stable(option));
                if option == Stiffness::Full {
                    self.options[0].critical = LargestStep::Every;
                    [Part::GrowingModes, Part::SmallestSet].into_iter().for_each(|part| self.set_known(part));
                }
            }
        }
    }

    fn set_known(&mut self, part: Part) {
        self.skipped.retain(|skipped| skipped.part != part);
    }

    fn set_estimated(&mut self, part: Part) {
        self.set_known(part);
        if !self.estimated.contains(&part) {
            self.estimated.push(part);
        }
    }
}

/// Both ends of the spectrum, the low one from a vector near it; `condition` is NaN where A may be singular.
fn spectrum(
    a: &SystemOperator<'_>,
    multigrid: Option<&mut Multigrid>,
    start: Option<&Eigenpair>,
    work: &mut Work,
) -> Spectrum {
    let n = a.order();
    let mut apply = scaled_products(a, None);
    let search = |end, block| Search { end, wanted: 1, block, capacity: 16 };
    let tolerance = Tolerance { of_value: 1e-3, of_norm: 0.0 };
    let mut high = BlockLanczos::from(n, None, search(End::Highest, 1), 3, [], &mut apply);
    let high = high.iterate(tolerance, 160, &mut apply, None);
    let start = start.iter().map(|pair| &pair.vector[..]);
    let mut low = BlockLanczos::from(n, None, search(End::Lowest, 3), 4, start, &mut apply);
    let low = low.iterate(tolerance, 40, &mut apply, Some(&mut preconditioner(multigrid, None, work)));
    let lowest: Vec<Eigenpair> = low.into_iter().map(Eigenpair::from).collect();
    let smallest = lowest.first().map_or(f64::NAN, |pair| pair.value);
    let largest = high.first().map_or(f64::NAN, |pair| pair.value);
    let ceiling = proven_ceiling(a);
    let rounding = ROUNDING * ceiling;
    // An indefinite A may have another eigenvalue nearer to zero than λ_min.
    let condition = if smallest > 0.0 { largest.abs().max(smallest) / smallest } else { f64::NAN };
    let (smallest_within, largest_within) = ([proven_floor(a), smallest + rounding], [largest - rounding, ceiling]);
    Spectrum { lowest, largest, condition, smallest_within, largest_within }
}

/// `min mᵢ/dt²`, below every eigenvalue where no block has a negative one.
fn proven_floor(a: &SystemOperator<'_>) -> f64 {
    if a.has_no_negative_block() { a.mass_factor() * a.system().free_masses()[0] } else { f64::NEG_INFINITY }
}

fn proven_ceiling(a: &SystemOperator<'_>) -> f64 {
    let highest = |block: &SpringBlock, _| 2.0 * block.axial.max(block.transverse).max(0.0);
    largest_at_particle(a, |mass| a.mass_factor() * mass, |block| block.norm(), highest, |sum, _| sum)
}

fn proves_definite(a: &SystemOperator<'_>) -> bool {
    let floor = proven_floor(a);
    floor > ROUNDING * proven_ceiling(a) && floor.is_finite()
}
