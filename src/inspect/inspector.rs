//! How an inspection goes about its parts, and what it knows on the way.

use super::analysed::Analysed;
use super::critical::{CriticalSteps, Known as KnownOfLimit};
use super::culprits::{Direction, clusters, direction};
use super::family::Property;
use super::first::first_answer;
use super::inertia::{InertiaCounter, InertiaMethod, definite_by_blocks, lightest};
use super::inspection::{Inspection, place};
use super::lanczos::End;
use super::left_out::{Cost, ESTIMATE, LARGEST_FACTORED, Ledger, Part, Why};
use super::search::{Digits, Known, LARGE, upper_end};
use super::smallest_set::{Trial, smallest_set_with};
use super::spectrum::{LARGEST_DENSE, spectrum_with};
use super::turning::Turning;
use crate::assembly::{SpringPattern, SymmetricMatrix, SystemMatrix};
use crate::error::{Error, Result};
use crate::force::Extensions;
use crate::linear::Ldlt;
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};
use crate::work::Work;
use faer::Par;
use std::sync::Arc;

/// Eigenpairs that an inspection looks for, in a matrix too large to be diagonalised whole, and directions of negative
/// curvature that it takes apart at most.
const EIGENPAIRS: usize = 12;
const DIRECTIONS: usize = 24;

/// Of a [`LARGE`] matrix both are fewer: every pair takes time.
const FEWER: usize = 6;

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

    /// As [`at`](Self::at), leaving out what would make it cost more than `most` operations. A matrix whose factor does not fit the memory, or
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
            return Self::estimated(system, state, dt, option, Why::TooMuchWork, onlooker);
        }
        let mut inspector = match Inspector::new(system, state, dt, option, par, most) {
            Ok(inspector) => inspector,
            Err(Error::TooLarge { .. }) => {
                return Self::estimated(system, state, dt, option, Why::TooMuchMemory, onlooker);
            }
            Err(error) => return Err(error),
        };
        let mut first = Stiffness::ALL;
        first.sort_by_key(|&each| each != option);
        // What the search for a spectrum has factored is of use for turning.
        let of_others: Vec<Part> = first
            .iter()
            .flat_map(|&each| {
                let spectrum = (each != option).then_some(Part::Spectrum(each));
                let turning = (each != Stiffness::Full).then_some(Part::Turning(each));
                [spectrum, turning].into_iter().flatten()
            })
            .collect();
        let parts: Vec<Part> = [
            &[Part::FirstAnswer][..],
            &first.map(Part::Signs),
            &[Part::GrowingModes, Part::Spectrum(option), Part::Definite(option), Part::Stable(option)],
            &[Part::SmallestSet],
            &of_others,
            &first.map(Part::Definite)[1..],
            &first.map(Part::Stable)[1..],
            // Drawn by [`Pictures`](super::Pictures), if it is affordable.
            &[Part::Curve],
        ]
        .concat();
        for part in parts {
            if inspector.look(part)? {
                onlooker(inspector.ledger.share(), &inspector.found);
            }
            // The first question is answered one way or another.
            let is_cheap = ESTIMATE * system.dofs().len() as f64 <= most;
            if part == Part::FirstAnswer && is_cheap && inspector.found.lacks(part) {
                return Self::estimated(system, state, dt, option, Why::TooMuchWork, onlooker);
            }
        }
        Ok(inspector.found)
    }
}

/// What an inspection needs, analysed once, and what it has found.
struct Inspector<'s> {
    system: &'s System,
    extensions: Extensions,
    pattern: Arc<SpringPattern>,
    critical: CriticalSteps<'s>,
    turning: Turning<'s>,
    counter: InertiaCounter,
    factorization: Ldlt,
    /// The option whose A is factored, and positive.
    factored: Option<Stiffness>,
    /// An upper end of the spectra under all options, proven, and that of A under `Tension` by products.
    ceiling: f64,
    tension_end: Option<End>,
    ledger: Ledger,
    /// Work that is not counted by the searches for steps.
    work: Work,
    found: Inspection,
}

impl<'s> Inspector<'s> {
    fn new(system: &'s System, state: &'s State, dt: f64, option: Stiffness, par: Par, most: f64) -> Result<Self> {
        let extensions = Extensions::at(system, state)?;
        let pattern = Arc::new(SpringPattern::of_stiffness(system)?);
        let factorization = Ldlt::analyse(pattern.pattern(), par)?;
        let shared = || Ldlt::sharing(&factorization);
        let analysed = Analysed { pattern: pattern.clone(), factorization: Arc::new(factorization.analysis_alone()) };
        let nothing = Work::default();
        Ok(Self {
            system,
            critical: CriticalSteps::analysed(system, extensions.clone(), pattern.clone(), shared()?, nothing)?,
            turning: Turning::analysed(system, state, extensions.clone(), pattern.clone(), shared()?, nothing),
            counter: InertiaCounter::sharing(&factorization)?,
            ledger: Ledger::new(Cost::of(&factorization.size(), system.dofs().len()), most, Part::all()),
            factorization,
            factored: None,
            ceiling: f64::INFINITY,
            tension_end: None,
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
        if !known && !self.ledger.affords(part) {
            self.found.left_out.clone_from(&self.ledger.out);
            return Ok(false);
        }
        match part {
            Part::FirstAnswer => {
                let option = self.found.option;
                let (operator, a) = self.matrix_of_step(option);
                let Self { system, extensions, factorization, work, found, .. } = self;
                found.first = first_answer(system, extensions, option, &a, &operator, factorization, work);
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
                        self.counter.count_negative(&minus_k, &mut self.work)
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
                if self.ledger.follows(part, Part::Definite(Stiffness::Full)) {
                    self.found.left_out.clone_from(&self.ledger.out);
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
        self.ledger.done(part);
        self.found.left_out.clone_from(&self.ledger.out);
        self.found.work = self.work;
        self.found.work.add(&self.critical.work);
        self.found.work.add(&self.turning.work);
        Ok(true)
    }

    /// A step of `Full` is estimated with `Tension`, see [`Turning::worst`].
    fn turning(&mut self, option: Stiffness) {
        if self.factored == Some(option) {
            self.turning.take_over(option, self.found.dt, &mut self.factorization);
            self.factored = None;
        }
        let (limit, worst) = self.turning.limit_and_worst(option, self.found.dt);
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
        let (wanted, digits) = match is_examined {
            true => (examined_pairs(a.dofs().len(), inertia.negative), Digits::All),
            false => (1, Digits::Certified),
        };
        // Dropping terms that are negative only adds: A under `Tension` is the largest of the three.
        let is_largest =
            option == Stiffness::Tension || option == Stiffness::Full && self.found.compressed_springs == 0;
        let above = (is_examined && !is_largest && a.dofs().len() > LARGEST_DENSE).then(|| {
            let (operator, a) = self.matrix_of_step(Stiffness::Tension);
            (a, *self.tension_end.insert(upper_end(&operator)))
        });
        // Without negative blocks what the masses add is left at least, see `definite_by_blocks`.
        let floor = match inertia.method {
            InertiaMethod::Springs => operator.mass_factor() * lightest(self.system),
            _ => f64::NEG_INFINITY,
        };
        let mut known = Known {
            products: &operator,
            is_factored: self.factored == Some(option),
            within: [floor, self.ceiling],
            above: above.as_ref().map(|(a, end)| (a, end.value)),
            above_within: f64::INFINITY,
            upper_end: self.tension_end.filter(|_| option == Stiffness::Tension),
            digits,
        };
        let spectrum = spectrum_with(&mut self.factorization, &a, &inertia, wanted, &mut known, &mut self.work);
        self.factored = known.is_factored.then_some(option);
        let of_all = if is_largest { spectrum.largest_within[1] } else { known.above_within };
        self.ceiling = self.ceiling.min(of_all);
        let found = &mut self.found.options[place(option)];
        (found.smallest, found.largest, found.condition) = (spectrum.smallest(), spectrum.largest, spectrum.condition);
        found.within = [spectrum.smallest_within, spectrum.largest_within];
        if option == self.found.option {
            let negative = spectrum.negative().len().clamp(1, DIRECTIONS);
            let taken_apart = |pair| direction(self.system, &self.extensions, option, pair);
            self.found.directions = spectrum.lowest.iter().take(negative).map(taken_apart).collect();
            let bad: Vec<Direction> = self.found.directions.iter().filter(|d| d.eigenvalue < 0.0).cloned().collect();
            self.found.clusters = clusters(&bad);
            self.found.spectrum = spectrum;
        }
    }
}
