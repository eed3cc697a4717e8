//! How an inspection goes about its parts, and what it knows on the way.

use super::critical::{CriticalSteps, Known as KnownOfLimit};
use super::inertia::{InertiaCounter, InertiaMethod, definite_by_blocks, lightest};
use super::inspection::{Analysed, DIRECTIONS, Inspection, place};
use super::matrix_pencil::Property;
use super::quick_check::quick_check;
use super::rotation_limit::RotationLimit;
use super::skipped::{Budget, Cost, ESTIMATE, LARGEST_FACTORED, Part, SkipReason};
use super::smallest_set::{Trial, smallest_set_with};
use super::spectrum::{Known, spectrum_with};
use crate::assembly::{SpringPattern, SymmetricMatrix, SystemMatrix};
use crate::eigen::Accuracy;
use crate::error::{Error, Result};
use crate::force::SpringGeometry;
use crate::linear::Ldlt;
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};
use crate::work::Work;
use faer::Par;
use std::sync::Arc;

/// Eigenpairs that an inspection looks for in a matrix too large to be diagonalised whole, and in one from [`LARGE`] rows on: every pair takes time.
const EIGENPAIRS: usize = 12;
const FEWER: usize = 6;
const LARGE: usize = 10_000;

/// How many of the lowest eigenpairs are looked for under the option that is examined, of so many negative ones.
fn examined_pairs(rows: usize, negative: usize) -> usize {
    if rows >= LARGE { FEWER } else { EIGENPAIRS.max(negative.min(DIRECTIONS)) }
}

impl Inspection {
    /// Inspects A at a state for a step of length dt, in s, under an option for which the directions are examined; whole, whatever
    /// it costs.
    ///
    /// # Errors
    /// Coincident ends of a spring; a system too large for the memory.
    pub fn at(system: &System, state: &State, dt: f64, option: Stiffness, par: Par) -> Result<Self> {
        Self::within(system, state, dt, option, par, f64::INFINITY, &mut |_, _| ())
    }

    /// As [`at`](Self::at), skipping what would make it cost more than `most` operations. A matrix whose factor does not fit the memory, or
    /// would cost more than that by itself, is looked at by products and multigrid: some figures then are estimates. After every part `onlooker` sees how much
    /// of the work is done, from 0 to 1, and what is known until then.
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
        onlooker: &mut dyn FnMut(f64, &Self),
    ) -> Result<Self> {
        if most.is_finite() && system.dofs().len() >= LARGEST_FACTORED {
            return Self::estimated(system, state, dt, option, SkipReason::TooMuchWork, onlooker);
        }
        let mut inspector = match Inspector::new(system, state, dt, option, par, most) {
            Ok(inspector) => inspector,
            Err(Error::TooLarge { .. }) => {
                return Self::estimated(system, state, dt, option, SkipReason::TooMuchMemory, onlooker);
            }
            Err(error) => return Err(error),
        };
        let mut order = Stiffness::ALL;
        order.sort_by_key(|&each| each != option);
        // What the search for a spectrum has factored is of use for turning.
        let of_others: Vec<Part> = order
            .iter()
            .flat_map(|&each| {
                let spectrum = (each != option).then_some(Part::Spectrum(each));
                let turning = (each != Stiffness::Full).then_some(Part::Turning(each));
                [spectrum, turning].into_iter().flatten()
            })
            .collect();
        let parts: Vec<Part> = [
            &[Part::FirstAnswer][..],
            &order.map(Part::Signs),
            &[Part::GrowingModes, Part::Spectrum(option), Part::Definite(option), Part::Stable(option)],
            &[Part::SmallestSet],
            &of_others,
            &order.map(Part::Definite)[1..],
            &order.map(Part::Stable)[1..],
            // Drawn by [`Pictures`](super::Pictures), if it is affordable.
            &[Part::Curve],
        ]
        .concat();
        for part in parts {
            if inspector.look(part)? {
                onlooker(inspector.budget.share(), &inspector.found);
            }
            // The first question is answered one way or another.
            let is_cheap = ESTIMATE * system.dofs().len() as f64 <= most;
            if part == Part::FirstAnswer && is_cheap && inspector.found.lacks(part) {
                return Self::estimated(system, state, dt, option, SkipReason::TooMuchWork, onlooker);
            }
        }
        Ok(inspector.found)
    }
}

/// What an inspection needs, analysed once, and what it has found.
struct Inspector<'s> {
    system: &'s System,
    extensions: SpringGeometry,
    pattern: Arc<SpringPattern>,
    critical: CriticalSteps<'s>,
    rotation: RotationLimit<'s>,
    counter: InertiaCounter,
    factorization: Ldlt,
    /// The option whose A is factored, and positive.
    factored: Option<Stiffness>,
    budget: Budget,
    /// Work that is not counted by the searches for steps.
    work: Work,
    found: Inspection,
}

impl<'s> Inspector<'s> {
    fn new(system: &'s System, state: &'s State, dt: f64, option: Stiffness, par: Par, most: f64) -> Result<Self> {
        let extensions = SpringGeometry::at(system, state)?;
        let pattern = Arc::new(SpringPattern::of_stiffness(system)?);
        let factorization = Ldlt::analyse(pattern.pattern(), par)?;
        let shared = || Ldlt::sharing(&factorization);
        let analysed = Analysed { pattern: pattern.clone(), factorization: Arc::new(factorization.analysis_alone()) };
        let nothing = Work::default();
        Ok(Self {
            system,
            critical: CriticalSteps::analysed(system, extensions.clone(), pattern.clone(), shared()?, nothing)?,
            rotation: RotationLimit::analysed(system, state, extensions.clone(), pattern.clone(), shared()?, nothing),
            counter: InertiaCounter::sharing(&factorization)?,
            budget: Budget::new(Cost::of(&factorization.size(), system.dofs().len()), most, Part::all()),
            factorization,
            factored: None,
            pattern,
            work: Work { symbolic_factorizations: 1, ..Work::default() },
            found: Inspection { analysed: Some(analysed), ..Inspection::unknown(system, &extensions, dt, option) },
            extensions,
        })
    }

    /// A of the step under an option, by products and by entries.
    fn matrix_of_step(&mut self, option: Stiffness) -> (SystemOperator<'s>, SymmetricMatrix) {
        let operator = SystemOperator::new(self.system, &self.extensions, option, Combination::step(self.found.dt));
        self.work.assemblies += 1;
        let a = SystemMatrix::assemble(self.pattern.clone(), &operator).into_matrix();
        (operator, a)
    }

    /// What is known of A under `Full` for the limit of its definiteness.
    fn known(&self) -> KnownOfLimit {
        let is_counted = !self.found.lacks(Part::GrowingModes);
        let lowest = self.found.spectrum.lowest.first().filter(|_| self.found.option == Stiffness::Full);
        let direction = lowest.map(|pair| pair.vector.clone());
        let is_definite = self.found.options[place(Stiffness::Full)].inertia.is_definite();
        let definite_from = is_definite.then_some(self.found.dt.recip());
        KnownOfLimit { curves_downwards: is_counted.then_some(self.found.growing_modes > 0), direction, definite_from }
    }

    /// Looks at a part, unless it costs too much; whether something new is known.
    fn look(&mut self, part: Part) -> Result<bool> {
        let known = match part {
            // What it depends on.
            Part::SmallestSet => self.found.options[0].inertia.is_definite(),
            // Under `Full` the requirements coincide, see [`CriticalSteps`].
            Part::Stable(Stiffness::Full) => true,
            // Without what makes them indefinite the springs' blocks settle it.
            Part::Definite(Stiffness::Tension | Stiffness::Axial) => true,
            _ => false,
        };
        if !known && !self.budget.affords(part) {
            self.found.skipped.clone_from(&self.budget.skipped);
            return Ok(false);
        }
        match part {
            Part::FirstAnswer => {
                let option = self.found.option;
                let (operator, a) = self.matrix_of_step(option);
                let Self { system, extensions, factorization, work, found, .. } = self;
                found.first = quick_check(system, extensions, option, &a, &operator, factorization, work);
                // What is definite is so by a factorization.
                self.factored = self.found.first.as_ref().filter(|first| first.definite).map(|_| option);
            }
            Part::Signs(option) => {
                let (operator, a) = self.matrix_of_step(option);
                let inertia = definite_by_blocks(&operator, &a, operator.mass_factor());
                let inertia = inertia.unwrap_or_else(|| self.counter.count(&a, &mut self.work));
                self.found.options[place(option)].inertia = inertia;
            }
            Part::GrowingModes => {
                let minus_k = Combination { mass: 0.0, damping: 0.0, stiffness: -1.0 };
                let operator = SystemOperator::new(self.system, &self.extensions, Stiffness::Full, minus_k);
                // A sum of what is never negative is not.
                let is_known = operator.has_no_negative_block();
                self.found.growing_modes = match is_known {
                    true => 0,
                    false => {
                        let minus_k = SystemMatrix::assemble(self.pattern.clone(), &operator).into_matrix();
                        self.work.assemblies += 1;
                        self.counter.count(&minus_k, &mut self.work).negative
                    }
                };
            }
            Part::Spectrum(option) => self.spectrum(option),
            Part::Definite(option) => {
                let limit = match option {
                    Stiffness::Full => self.critical.definite_knowing(self.known()),
                    Stiffness::Tension | Stiffness::Axial => self.critical.largest_step(Property::Definite, option),
                };
                self.found.options[place(option)].critical = limit;
                if option == Stiffness::Full {
                    self.found.options[place(option)].stable = limit;
                }
            }
            Part::Stable(Stiffness::Full) => {
                if self.budget.follows(part, Part::Definite(Stiffness::Full)) {
                    self.found.skipped.clone_from(&self.budget.skipped);
                    return Ok(false);
                }
            }
            Part::Stable(option) => {
                self.found.options[place(option)].stable = self.critical.largest_step(Property::Stable, option);
            }
            Part::Turning(option) => self.turning(option),
            Part::SmallestSet => {
                if !known {
                    let Self { system, extensions, pattern, factorization, counter, work, found, .. } = self;
                    let factorization = Ldlt::sharing(factorization)?;
                    let trial = Trial::new(system, extensions, found.dt, pattern.clone(), factorization);
                    let negative = found.options[0].inertia.negative;
                    found.smallest_set = Some(smallest_set_with(trial, negative, counter, work));
                }
            }
            Part::Curve => {}
        }
        self.budget.done(part);
        self.found.skipped.clone_from(&self.budget.skipped);
        self.found.work = self.work;
        self.found.work.add(&self.critical.work);
        self.found.work.add(&self.rotation.work);
        Ok(true)
    }

    /// A step of `Full` is estimated with `Tension`, see [`RotationLimit::worst`].
    fn turning(&mut self, option: Stiffness) {
        if self.factored == Some(option) {
            self.rotation.take_over(option, self.found.dt, &mut self.factorization);
            self.factored = None;
        }
        let (limit, worst) = self.rotation.limit_and_worst(option, self.found.dt);
        for each in &mut self.found.options {
            if (each.option == Stiffness::Axial) == (option == Stiffness::Axial) {
                each.turning = limit;
            }
        }
        if (self.found.option == Stiffness::Axial) == (option == Stiffness::Axial) {
            self.found.turn = worst;
        }
    }

    fn spectrum(&mut self, option: Stiffness) {
        // Where nothing is compressed there is nothing to drop.
        let is_full = option == Stiffness::Tension && self.found.option == Stiffness::Full;
        if is_full && self.found.compressed_springs == 0 && !self.found.lacks(Part::Spectrum(Stiffness::Full)) {
            let full = self.found.options[place(Stiffness::Full)].clone();
            let tension = &mut self.found.options[place(option)];
            (tension.smallest, tension.largest, tension.condition) = (full.smallest, full.largest, full.condition);
            tension.within = full.within;
            return;
        }
        let (operator, a) = self.matrix_of_step(option);
        let inertia = self.found.options[place(option)].inertia;
        let is_examined = option == self.found.option;
        let accuracy = if is_examined && a.dofs().len() < LARGE { Accuracy::FULL } else { Accuracy::CERTIFIED };
        let wanted = if is_examined { examined_pairs(a.dofs().len(), inertia.negative) } else { 1 };
        // Without negative blocks what the masses add is left at least, see `definite_by_blocks`.
        let floor = match inertia.method {
            InertiaMethod::Springs => operator.mass_factor() * lightest(self.system),
            _ => f64::NEG_INFINITY,
        };
        let is_factored = self.factored == Some(option);
        let mut known = Known { products: &operator, is_factored, floor, accuracy };
        let spectrum = spectrum_with(&mut self.factorization, &a, &inertia, wanted, &mut known, &mut self.work);
        self.factored = known.is_factored.then_some(option);
        self.found.options[place(option)].take(&spectrum);
        if is_examined {
            self.found.examine(self.system, &self.extensions, spectrum);
        }
    }
}
