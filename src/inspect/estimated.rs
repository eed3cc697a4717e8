//! An inspection of a matrix that is not factored: what is proven all the same, what is estimated, and what is left out.

use super::critical::LargestStep;
use super::culprits::{Direction, clusters, direction};
use super::eigenpair::Eigenpair;
use super::estimate::{Estimator, proves_definite, proves_indefinite};
use super::family::{Family, Property};
use super::first::FirstAnswer;
use super::inertia::{Inertia, InertiaMethod};
use super::inspection::{Inspection, place};
use super::left_out::{LeftOut, Part, Why};
use crate::error::Result;
use crate::force::Extensions;
use crate::memory;
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};

/// Bytes for every row, fifty numbers: vectors of the search for eigenvalues with their products, and what else is as long.
const ROW: u64 = 400;

impl Inspection {
    /// By products and multigrid alone; what they cannot tell is left out, for a reason.
    pub(super) fn estimated(
        system: &System,
        state: &State,
        dt: f64,
        option: Stiffness,
        why: Why,
        onlooker: &mut dyn FnMut(f64, &Self),
    ) -> Result<Self> {
        memory::ensure(ROW * system.dofs().len() as u64, "an estimate of eigenvalues")?;
        let extensions = Extensions::at(system, state)?;
        let mut found = Self::unknown(system, &extensions, dt, option);
        found.left_out = Part::all().map(|part| LeftOut { part, why }).collect();
        let mut estimator = Estimator::new(system, state, extensions.clone(), dt);
        let a = estimator.operator(option);
        found.work.assemblies += 1;
        let start = estimator.first(&a);
        if let Some(pair) = start.as_ref().filter(|pair| proves_indefinite(&a, pair) || proves_definite(&a)) {
            found.answer(system, &extensions, &a, pair);
            onlooker(0.1, &found);
        }
        let mut options = Stiffness::ALL;
        options.sort_by_key(|&each| each != option);
        let mut near = start;
        for (k, each) in options.into_iter().enumerate() {
            let a = estimator.operator(each);
            found.work.assemblies += 1;
            let spectrum = estimator.spectrum(&a, near.as_ref(), &mut found.work);
            let lowest = spectrum.lowest.first().cloned();
            let told = &mut found.options[place(each)];
            (told.smallest, told.largest, told.condition) = (spectrum.smallest(), spectrum.largest, spectrum.condition);
            told.within = [spectrum.smallest_within, spectrum.largest_within];
            if proves_definite(&a) {
                let n = a.order();
                let (factorization_error, method) = (0.0, InertiaMethod::Springs);
                told.inertia = Inertia { negative: 0, zero: 0, positive: n, band: 0.0, factorization_error, method };
                found.known(Part::Signs(each));
            }
            if each != Stiffness::Full || proves_definite(&a) {
                found.options[place(each)].critical = LargestStep::Every;
                found.known(Part::Definite(each));
            }
            found.told_by_estimate(Part::Spectrum(each));
            if each == option {
                if let Some(pair) = &lowest {
                    found.answer(system, &extensions, &a, pair);
                }
                let negative = spectrum.lowest.iter().filter(|pair| pair.value < 0.0).count();
                let taken_apart = |pair| direction(system, &extensions, option, pair);
                found.directions = spectrum.lowest.iter().take(negative.max(1)).map(taken_apart).collect();
                let bad: Vec<Direction> = found.directions.iter().filter(|d| d.eigenvalue < 0.0).cloned().collect();
                found.clusters = clusters(&bad);
                found.spectrum = spectrum;
            }
            near = lowest.or(near);
            onlooker(0.1 + 0.3 * (k + 1) as f64, &found);
        }
        found.settled_by_springs(system, &extensions);
        Ok(found)
    }

    /// Takes over an answer to the first question.
    fn answer(&mut self, system: &System, extensions: &Extensions, a: &SystemOperator<'_>, pair: &Eigenpair) {
        let is_indefinite = proves_indefinite(a, pair);
        let is_proven = is_indefinite || proves_definite(a);
        let direction = direction(system, extensions, self.option, pair);
        self.first = Some(FirstAnswer { definite: !is_indefinite, is_proven, direction, residual: pair.residual });
        match is_proven {
            true => self.known(Part::FirstAnswer),
            false => self.told_by_estimate(Part::FirstAnswer),
        }
    }

    /// What no spring's block leaves open: without negative ones nothing grows and every step is definite.
    fn settled_by_springs(&mut self, system: &System, extensions: &Extensions) {
        let k = Combination { mass: 0.0, damping: 0.0, stiffness: -1.0 };
        let k = SystemOperator::new(system, extensions, Stiffness::Full, k);
        if k.has_no_negative_block() {
            self.growing_modes = 0;
            self.known(Part::GrowingModes);
            self.known(Part::SmallestSet);
            let full = &mut self.options[place(Stiffness::Full)];
            (full.critical, full.stable) = (LargestStep::Every, LargestStep::Every);
            self.known(Part::Stable(Stiffness::Full));
        }
        let mut family = Family::new(system, extensions.clone());
        for option in [Stiffness::Tension, Stiffness::Axial] {
            family.set(Property::Stable, option, 0.0);
            if family.operator().has_no_negative_block() {
                self.options[place(option)].stable = LargestStep::Every;
                self.known(Part::Stable(option));
            }
        }
    }

    fn known(&mut self, part: Part) {
        self.left_out.retain(|left_out| left_out.part != part);
    }

    fn told_by_estimate(&mut self, part: Part) {
        self.known(part);
        if !self.estimated.contains(&part) {
            self.estimated.push(part);
        }
    }
}
