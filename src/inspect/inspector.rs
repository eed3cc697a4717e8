//! The course of an inspection, and its budget.
//!
//! The parts come in the order of their importance. Before each its cost is estimated from the work of one factorization, one solve and one step of a
//! search for eigenvalues; a part beyond the budget is skipped. These are counts, not times: on every machine the same parts are skipped.

use super::critical::{CriticalSteps, Facts, Property};
use super::inertia::{InertiaCounter, InertiaMethod, definite_by_blocks};
use super::inspection::{DIRECTIONS, Inspection, Part, SkipReason, examined_first, quick_check};
use super::oracle::Oracle;
use super::rotation_limit::RotationLimit;
use super::smallest_set::{self, Trial};
use super::spectrum::{LARGEST_DENSE, spectrum_with};
use crate::eigen::{Accuracy, Pencil, ShiftInvert};
use crate::error::{Error, Result};
use crate::force::SpringGeometry;
use crate::linear::FactorSize;
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};
use crate::work::Work;
use faer::Par;

/// Operations of an inspection by default: about a minute.
pub const AFFORDABLE: f64 = 1e12;

/// Rows from which nothing is factored by default: one factorization of a cloth of that size takes seconds, of a solid minutes, and the ordering
/// before it as long.
const LARGEST_FACTORED: usize = 500_000;

impl Inspection {
    /// Inspects A at a state for a step of length dt, in s, with the directions under an option; whole, whatever it costs.
    ///
    /// # Errors
    /// Coincident ends of a spring; a system too large for the memory.
    pub fn at(system: &System, state: &State, dt: f64, option: Stiffness, par: Par) -> Result<Self> {
        Self::within(system, state, dt, option, par, f64::INFINITY, &mut |_, _| ())
    }

    /// As [`at`](Self::at), skipping parts beyond `most` operations. A matrix whose factor does not fit the memory, or costs more than that, is
    /// inspected by products and multigrid: some figures then are estimates. After every part `observer` sees the share of the work done, from 0 to
    /// 1, and the inspection so far.
    ///
    /// # Errors
    /// Coincident ends of a spring; a system too large for the memory.
    pub fn within(
        system: &System,
        state: &State,
        dt: f64,
        option: Stiffness,
        par: Par,
        most: f64,
        observer: &mut dyn FnMut(f64, &Self),
    ) -> Result<Self> {
        if most.is_finite() && system.dofs().len() >= LARGEST_FACTORED {
            return Self::estimated(system, state, dt, option, SkipReason::TooMuchWork, observer);
        }
        let mut inspector = match Inspector::new(system, state, dt, option, par, most) {
            Ok(inspector) => inspector,
            Err(Error::TooLarge { .. }) => {
                return Self::estimated(system, state, dt, option, SkipReason::TooMuchMemory, observer);
            }
            Err(error) => return Err(error),
        };
        let order = examined_first(option);
        let mut parts = vec![Part::FirstAnswer];
        parts.extend(order.map(Part::Signs));
        parts.extend([Part::GrowingModes, Part::Spectrum(option), Part::Definite(option), Part::Stable(option)]);
        parts.push(Part::SmallestSet);
        for each in order {
            parts.extend((each != option).then_some(Part::Spectrum(each)));
            // The factorization of a spectrum is of use for the rotation limit.
            parts.extend(matches!(each, Stiffness::Tension | Stiffness::Axial).then_some(Part::Turning(each)));
        }
        parts.extend(
            [Part::Definite, Part::Stable].into_iter().flat_map(|part| order[1..].iter().map(move |&each| part(each))),
        );
        parts.push(Part::Curve);
        // Under `Full` both properties coincide, see [`CriticalSteps`].
        for part in parts.into_iter().filter(|part| *part != Part::Stable(Stiffness::Full)) {
            if inspector.inspect(part)? {
                observer(inspector.budget.share(), &inspector.found);
            }
            // The quick check is made one way or another: an estimate by products and multigrid takes so many operations a row.
            let is_cheap = 2e5 * system.dofs().len() as f64 <= most;
            if part == Part::FirstAnswer && is_cheap && inspector.found.lacks(part) {
                return Self::estimated(system, state, dt, option, SkipReason::TooMuchWork, observer);
            }
        }
        Ok(inspector.found)
    }
}

/// The tools of an inspection, on one symbolic analysis, and its results.
struct Inspector<'s> {
    system: &'s System,
    extensions: SpringGeometry,
    oracle: Oracle,
    critical: CriticalSteps<'s>,
    rotation: RotationLimit<'s>,
    counter: InertiaCounter,
    /// The option whose A is factored, and positive definite.
    factored: Option<Stiffness>,
    budget: Budget,
    /// Work besides that of the searches for steps.
    work: Work,
    found: Inspection,
}

impl<'s> Inspector<'s> {
    fn new(system: &'s System, state: &'s State, dt: f64, option: Stiffness, par: Par, most: f64) -> Result<Self> {
        let extensions = SpringGeometry::at(system, state)?;
        let mut work = Work::default();
        let oracle = Oracle::analyse(system, par, &mut work)?;
        Ok(Self {
            system,
            critical: CriticalSteps::analysed(system, extensions.clone(), oracle.sharing()?)?,
            rotation: RotationLimit::analysed(system, state, extensions.clone(), oracle.sharing()?),
            counter: InertiaCounter::sharing(&oracle.factorization)?,
            budget: Budget::new(&oracle.factorization.size(), system.dofs().len(), most),
            oracle,
            factored: None,
            work,
            found: Inspection { par, ..Inspection::unknown(system, &extensions, dt, option, SkipReason::Interrupted) },
            extensions,
        })
    }

    /// A of the step under an option, by products, and as the matrix of the oracle.
    fn assemble_step(&mut self, option: Stiffness) -> SystemOperator<'s> {
        let operator = SystemOperator::new(self.system, &self.extensions, option, Combination::step(self.found.dt));
        self.assemble(&operator);
        operator
    }

    fn assemble(&mut self, operator: &SystemOperator<'_>) {
        self.work.assemblies += 1;
        self.oracle.matrix.refill(operator);
    }

    fn facts(&self) -> Facts {
        let is_counted = !self.found.lacks(Part::GrowingModes);
        let lowest = self.found.spectrum.lowest.first().filter(|_| self.found.option == Stiffness::Full);
        let direction = lowest.map(|pair| pair.vector.clone());
        let is_definite = self.found.options[Stiffness::Full as usize].inertia.is_definite();
        let definite_from = is_definite.then_some(self.found.dt.recip());
        Facts { curves_downwards: is_counted.then_some(self.found.growing_modes > 0), direction, definite_from }
    }

    fn inspect(&mut self, part: Part) -> Result<bool> {
        let known = match part {
            Part::SmallestSet => self.found.options[0].inertia.is_definite(),
            Part::Definite(Stiffness::Tension | Stiffness::Axial | Stiffness::Absolute) => true,
            _ => false,
        };
        if !known && !self.budget.affords(part) {
            let covered = self.found.skipped.iter_mut().filter(|skipped| is_covered(skipped.part, part));
            covered.for_each(|skipped| skipped.why = SkipReason::TooMuchWork);
            return Ok(false);
        }
        match part {
            Part::FirstAnswer => {
                let option = self.found.option;
                let operator = self.assemble_step(option);
                let Self { system, extensions, oracle: Oracle { matrix, factorization, .. }, work, found, .. } = self;
                let a = matrix.matrix();
                found.first = quick_check(system, extensions, option, a, &operator, factorization, work);
                self.factored = self.found.first.as_ref().filter(|first| first.definite).map(|_| option);
            }
            Part::Signs(option) => {
                let operator = self.assemble_step(option);
                let a = self.oracle.matrix.matrix();
                let inertia = definite_by_blocks(&operator, a, operator.mass_factor());
                let inertia = inertia.unwrap_or_else(|| self.counter.count(a, &mut self.work));
                self.found.options[option as usize].inertia = inertia;
            }
            Part::GrowingModes => {
                let minus_k = Combination { mass: 0.0, damping: 0.0, stiffness: -1.0 };
                let operator = SystemOperator::new(self.system, &self.extensions, Stiffness::Full, minus_k);
                self.found.growing_modes = if operator.has_no_negative_block() {
                    0
                } else {
                    self.assemble(&operator);
                    self.counter.count(self.oracle.matrix.matrix(), &mut self.work).negative
                };
            }
            Part::Spectrum(option) => self.spectrum(option),
            Part::Definite(option) => {
                let facts = if option == Stiffness::Full { self.facts() } else { Facts::default() };
                let limit = self.critical.search(Property::Definite, option, facts);
                self.found.options[option as usize].critical = limit;
                if option == Stiffness::Full {
                    self.found.options[option as usize].stable = limit;
                }
            }
            Part::Stable(option) => {
                self.found.options[option as usize].stable = self.critical.largest_step(Property::Stable, option);
            }
            Part::Turning(option) => self.turning(option),
            Part::SmallestSet => {
                if !known {
                    let Self { system, extensions, oracle, counter, work, found, .. } = self;
                    let trial = Trial::new(system, extensions, found.dt, oracle.sharing()?);
                    let negative = found.options[0].inertia.negative;
                    found.smallest_set = Some(smallest_set::search(trial, negative, counter, work));
                }
            }
            Part::Curve => {}
        }
        self.found.skipped.retain(|skipped| !is_covered(skipped.part, part));
        self.found.work = self.work;
        self.found.work.add(&self.critical.work);
        self.found.work.add(&self.rotation.work);
        Ok(true)
    }

    /// `Tension` stands for all but `Axial`, see [`RotationLimit::worst`].
    fn turning(&mut self, option: Stiffness) {
        if self.factored == Some(option) {
            self.rotation.take_over(option, self.found.dt, &mut self.oracle.factorization);
            self.factored = None;
        }
        let (limit, worst) = self.rotation.limit_and_worst(option, self.found.dt);
        let is_alike = |other: Stiffness| (other == Stiffness::Axial) == (option == Stiffness::Axial);
        self.found.options.iter_mut().filter(|each| is_alike(each.option)).for_each(|each| each.turning = limit);
        if is_alike(self.found.option) {
            self.found.turn = worst;
        }
    }

    fn spectrum(&mut self, option: Stiffness) {
        // Without compressed springs both options coincide.
        let is_full = option == Stiffness::Tension && self.found.option == Stiffness::Full;
        if is_full && self.found.compressed_springs == 0 && !self.found.lacks(Part::Spectrum(Stiffness::Full)) {
            let [full, tension, ..] = &mut self.found.options;
            (tension.smallest, tension.largest, tension.condition) = (full.smallest, full.largest, full.condition);
            tension.within = full.within;
            return;
        }
        let operator = self.assemble_step(option);
        let a = self.oracle.matrix.matrix();
        let inertia = self.found.options[option as usize].inertia;
        let is_examined = option == self.found.option;
        // A large matrix that is definite has no directions to examine: λ_min alone.
        let (wanted, accuracy) = match a.dofs().len() >= 10_000 {
            _ if !is_examined => (1, Accuracy::CERTIFIED),
            true => (inertia.negative.clamp(1, 6), Accuracy::CERTIFIED),
            false => (inertia.negative.clamp(12, DIRECTIONS), Accuracy::FULL),
        };
        let floor = match inertia.method {
            InertiaMethod::Springs => operator.mass_factor() * self.system.free_masses()[0],
            _ => f64::NEG_INFINITY,
        };
        let pencil = Pencil { products: &operator, ..Pencil::of(a) };
        let mut search = ShiftInvert::new(pencil, &mut self.oracle.factorization, &mut self.work);
        (search.is_factored, search.within[0]) = (self.factored == Some(option), floor);
        let spectrum = spectrum_with(&mut search, &inertia, wanted, accuracy);
        self.factored = search.is_factored.then_some(option);
        self.found.options[option as usize].set_spectrum(&spectrum);
        if is_examined {
            self.found.examine(self.system, &self.extensions, spectrum);
        }
    }
}

/// Under `Full` the limits of definiteness and stability are the same.
fn is_covered(part: Part, by: Part) -> bool {
    part == by || [part, by] == [Part::Stable(Stiffness::Full), Part::Definite(Stiffness::Full)]
}

/// Operations of a factorization and of a search for eigenvalues besides its factorizations; those that may be spent, those that are, and those of
/// everything within the budget.
#[derive(Debug, Clone, PartialEq)]
struct Budget {
    factorization: f64,
    search: f64,
    rows: f64,
    most: f64,
    spent: f64,
    whole: f64,
}

impl Budget {
    /// `most` operations to spend on matrices of so many rows, with factors of a size.
    fn new(size: &FactorSize, rows: usize, most: f64) -> Self {
        // An operation that waits for the memory counts four times.
        const SLOW: f64 = 4.0;
        let (entries, rows) = (size.entries as f64, rows as f64);
        // A step of a search solves for eight columns, and makes each orthogonal to some fifty vectors, twice; there are 25 steps.
        let step = SLOW * (4.0 * 8.0 * entries + 6000.0 * rows);
        let (factorization, search) = (size.flops + SLOW * entries, 25.0 * step);
        let mut budget = Self { factorization, search, rows, most, spent: 0.0, whole: 0.0 };
        budget.whole = Part::all().map(|part| budget.cost(part)).sum::<f64>().min(most);
        budget
    }

    /// By the numbers of factorizations and searches that the parts have taken at most.
    fn cost(&self, part: Part) -> f64 {
        let Self { factorization, search, rows, .. } = *self;
        let eigenvalues = |searches: f64| match rows <= LARGEST_DENSE as f64 {
            true => 10.0 * rows.powi(3),
            false => 5.0 * factorization + searches * search,
        };
        match part {
            Part::FirstAnswer => factorization,
            Part::Signs(_) | Part::GrowingModes => 2.0 * factorization,
            Part::Turning(_) => 2.0 * factorization + search,
            Part::SmallestSet => 6.0 * factorization,
            Part::Spectrum(_) => eigenvalues(2.0),
            Part::Definite(_) | Part::Stable(_) => 6.0 * factorization + 2.0 * search,
            Part::Curve => 51.0 * eigenvalues(1.0),
        }
    }

    fn affords(&mut self, part: Part) -> bool {
        let spent = self.spent + self.cost(part);
        let is_affordable = spent <= self.most;
        if is_affordable {
            self.spent = spent;
        }
        is_affordable
    }

    fn share(&self) -> f64 {
        (self.spent / self.whole.max(1.0)).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::OrderingMethod;

    #[test]
    fn parts_are_skipped_when_they_cost_more_than_is_left() {
        let size = FactorSize { entries: 0, flops: 1.0, ordering: OrderingMethod::Natural };
        let mut budget = Budget::new(&size, 0, 11.0);
        let [first, second] = [Part::SmallestSet, Part::Definite(Stiffness::Full)];
        assert!(budget.affords(first) && !budget.affords(second) && budget.affords(Part::GrowingModes));
        assert!(Budget::new(&size, 0, f64::INFINITY).affords(Part::Curve));
        assert!(
            is_covered(Part::Stable(Stiffness::Full), second) && !is_covered(second, Part::Stable(Stiffness::Full))
        );
    }
}
