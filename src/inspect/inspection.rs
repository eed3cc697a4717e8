//! Everything about the definiteness of A at one state.

use super::critical::{CriticalSteps, LargestStep};
use super::culprits::{Cluster, Direction, clusters, direction};
use super::family::Property;
use super::first::{FirstAnswer, first_answer};
use super::inertia::{Inertia, InertiaCounter, definite_by_blocks};
use super::left_out::{Cost, Ledger, LeftOut, Part, Why};
use super::smallest_set::{DropSet, Trial, smallest_set_with};
use super::spectrum::{Digits, Spectrum, spectrum_with};
use super::turning::{Turn, Turning};
use crate::assembly::{SpringPattern, SymmetricMatrix, SystemMatrix};
use crate::error::Result;
use crate::force::Extensions;
use crate::linear::Ldlt;
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};
use crate::work::Work;
use faer::Par;
use std::sync::Arc;

/// What A is like under one option.
#[derive(Debug, Clone, PartialEq)]
pub struct OptionInspection {
    /// The option.
    pub option: Stiffness,
    /// Signs of the eigenvalues of A.
    pub inertia: Inertia,
    /// λ_min of A, in N/m.
    pub smallest: f64,
    /// λ_max of A, in N/m.
    pub largest: f64,
    /// `max|λ|/min|λ|`; infinite where A is singular to working precision.
    pub condition: f64,
    /// The largest step for which A is positive definite at this state.
    pub critical: LargestStep,
    /// The largest step for which the method adds no instability of its own at this state.
    pub stable: LargestStep,
    /// The largest step that turns no spring so far that this brakes or stretches it, see [`Turn`]: no linearisation sees this.
    pub turning: LargestStep,
}

/// The definiteness of `A = M/dt² − G/dt − K` at one state, and what it depends on.
///
/// # Examples
/// ```
/// use sprung::Stiffness;
/// use sprung::faer::Par;
/// use sprung::inspect::Inspection;
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// let inspection = Inspection::at(&system, &state, 1.0, Stiffness::Full, Par::Seq)?;
/// assert_eq!(inspection.examined().inertia.negative, 2);
/// assert!(inspection.smallest_set.is_some()); // one transverse term must go
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Inspection {
    /// The time step, in s.
    pub dt: f64,
    /// The option under which the directions were examined.
    pub option: Stiffness,
    /// A under each option, in the order of [`Stiffness::ALL`].
    pub options: [OptionInspection; 3],
    /// What was known first: whether A is positive definite under the option, and the spring that spoils it most.
    pub first: Option<FirstAnswer>,
    /// How many modes of the exact motion grow: negative eigenvalues of −K. No step can make these stable.
    pub growing_modes: usize,
    /// How many springs are shorter than at rest, of those that have a free end.
    pub compressed_springs: usize,
    /// The low end of the spectrum of A under the option.
    pub spectrum: Spectrum,
    /// The direction of the lowest eigenvalue, and of the others that are negative.
    pub directions: Vec<Direction>,
    /// The main culprits of directions of negative curvature, by where they hang together.
    pub clusters: Vec<Cluster>,
    /// The spring that a step of this length turns worst, under the option; `None` where it turns none.
    pub turn: Option<Turn>,
    /// Where A under `Full` is not positive definite: which transverse terms must go.
    pub smallest_set: Option<DropSet>,
    /// What was left out, with λ_min over the time step, which [`Pictures`](super::Pictures) look at.
    pub left_out: Vec<LeftOut>,
    /// What the inspection cost.
    pub work: Work,
}

/// Eigenpairs that an inspection looks for, in a matrix too large to be diagonalised whole, and directions of negative
/// curvature that it takes apart at most.
const EIGENPAIRS: usize = 12;
const DIRECTIONS: usize = 24;

/// From so many degrees of freedom on both are fewer: every pair takes time.
const LARGE: usize = 10_000;
const FEWER: usize = 6;

/// Eigenvalues that differ by less, relatively, are one to those who look at their eigenvectors: where A changes by that much, as it does
/// when a particle moves by a thousandth of a spring, these turn into any mixture of each other. A small imperfection, as ready
/// columns have it, leaves two-fold eigenvalues that far apart.
const SAME: f64 = 1e-3;

impl Inspection {
    /// Inspects A at a state for a step of length dt, in s, under an option for which the directions are examined; whole, whatever
    /// it costs.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large to factor.
    pub fn at(system: &System, state: &State, dt: f64, option: Stiffness, par: Par) -> Result<Self> {
        Self::within(system, state, dt, option, par, f64::INFINITY, &mut |_, _| ())
    }

    /// As [`at`](Self::at), leaving out what would make it cost more than `most` operations. After every part `onlooker` sees how much
    /// of the work is done, from 0 to 1, and what is known until then.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large to factor.
    pub fn within(
        system: &System,
        state: &State,
        dt: f64,
        option: Stiffness,
        par: Par,
        most: f64,
        onlooker: &mut dyn FnMut(f64, &Self),
    ) -> Result<Self> {
        let mut inspector = Inspector::new(system, state, dt, option, par, most)?;
        let mut first = Stiffness::ALL;
        first.sort_by_key(|&each| each != option);
        let parts: Vec<Part> = [
            &[Part::FirstAnswer][..],
            &first.map(Part::Signs),
            &[Part::GrowingModes, Part::Spectrum(option), Part::Definite(option), Part::Stable(option)],
            &[Part::Turning(Stiffness::Tension), Part::Turning(Stiffness::Axial), Part::SmallestSet],
            &first.map(Part::Spectrum)[1..],
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
        }
        Ok(inspector.found)
    }

    /// Of which nothing is known yet.
    fn unknown(system: &System, extensions: &Extensions, dt: f64, option: Stiffness) -> Self {
        let compressed = extensions.springs(system).filter(|((_, _, spring), at)| spring.is_compressed(at));
        let unknown = |option| OptionInspection {
            option,
            inertia: Inertia::undecided(system.dofs().len(), f64::INFINITY),
            smallest: f64::NAN,
            largest: f64::NAN,
            condition: f64::NAN,
            critical: LargestStep::Unknown,
            stable: LargestStep::Unknown,
            turning: LargestStep::Unknown,
        };
        Self {
            dt,
            option,
            options: Stiffness::ALL.map(unknown),
            first: None,
            growing_modes: 0,
            compressed_springs: compressed.count(),
            spectrum: Spectrum { lowest: Vec::new(), largest: f64::NAN, condition: f64::NAN },
            directions: Vec::new(),
            clusters: Vec::new(),
            turn: None,
            smallest_set: None,
            left_out: Vec::new(),
            work: Work::default(),
        }
    }

    /// What was left out for a reason.
    pub fn left_out_for(&self, why: Why) -> impl Iterator<Item = Part> + '_ {
        self.left_out.iter().filter(move |left_out| left_out.why == why).map(|left_out| left_out.part)
    }

    /// Without the picture of λ_min, which nobody waited for.
    pub fn without_curve(mut self) -> Self {
        if !self.lacks(Part::Curve) {
            self.left_out.push(LeftOut { part: Part::Curve, why: Why::Interrupted });
        }
        self
    }

    /// Whether a part was left out.
    pub fn lacks(&self, part: Part) -> bool {
        self.left_out.iter().any(|left_out| left_out.part == part)
    }

    /// How many of the eigenvalues that were found equal the lowest, to a thousandth of it: where there are several, any mixture of
    /// their eigenvectors is as good as one, and the one that was found is no better than others.
    pub fn multiplicity(&self) -> usize {
        let Some(lowest) = self.spectrum.lowest.first().map(|pair| pair.value) else { return 0 };
        let same = |value: f64| (value - lowest).abs() <= SAME * lowest.abs();
        self.spectrum.lowest.iter().take_while(|pair| same(pair.value)).count()
    }

    /// The [multiplicity](Self::multiplicity) in words, `2-fold` or `at least 12-fold`; `None` of a simple eigenvalue. Not all
    /// eigenvalues of a large matrix are looked for.
    pub fn fold(&self) -> Option<String> {
        let (fold, found) = (self.multiplicity(), self.spectrum.lowest.len());
        let Inertia { negative, zero, positive, .. } = self.examined().inertia;
        let more = fold == found && found < negative + zero + positive;
        (fold > 1).then(|| format!("{}{fold}-fold", if more { "at least " } else { "" }))
    }

    /// A under the option that was asked for.
    pub fn examined(&self) -> &OptionInspection {
        &self.options[place(self.option)]
    }
}

/// Where an option stands in [`Stiffness::ALL`].
fn place(option: Stiffness) -> usize {
    match option {
        Stiffness::Full => 0,
        Stiffness::Tension => 1,
        Stiffness::Axial => 2,
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
    ledger: Ledger,
    /// Work that is not counted by the searches for steps.
    work: Work,
    found: Inspection,
}

impl<'s> Inspector<'s> {
    fn new(system: &'s System, state: &'s State, dt: f64, option: Stiffness, par: Par, most: f64) -> Result<Self> {
        let extensions = Extensions::at(system, &state.positions)?;
        let pattern = Arc::new(SpringPattern::of_stiffness(system)?);
        let factorization = Ldlt::analyse(pattern.pattern(), par)?;
        let all = Stiffness::ALL;
        let parts = [Part::FirstAnswer, Part::GrowingModes, Part::SmallestSet, Part::Curve]
            .into_iter()
            .chain([Part::Turning(Stiffness::Tension), Part::Turning(Stiffness::Axial)])
            .chain([Part::Signs, Part::Spectrum, Part::Definite, Part::Stable].into_iter().flat_map(|of| all.map(of)));
        let shared = || Ldlt::sharing(&factorization);
        let nothing = Work::default();
        Ok(Self {
            system,
            critical: CriticalSteps::analysed(system, extensions.clone(), pattern.clone(), shared()?, nothing)?,
            turning: Turning::analysed(system, state, extensions.clone(), pattern.clone(), shared()?, nothing),
            counter: InertiaCounter::sharing(&factorization)?,
            ledger: Ledger::new(Cost::of(&factorization.size(), system.dofs().len()), most, parts),
            factorization,
            pattern,
            work: Work { symbolic_factorizations: 1, ..Work::default() },
            found: Inspection::unknown(system, &extensions, dt, option),
            extensions,
        })
    }

    fn assemble(&self, option: Stiffness, combination: Combination) -> SymmetricMatrix {
        let operator = SystemOperator::new(self.system, &self.extensions, option, combination);
        SystemMatrix::assemble(self.pattern.clone(), &operator).into_matrix()
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
                let a = self.assemble(option, Combination::step(self.found.dt));
                self.work.assemblies += 1;
                let Self { system, extensions, factorization, work, found, .. } = self;
                found.first = first_answer(system, extensions, option, &a, factorization, work);
            }
            Part::Signs(option) => {
                let combination = Combination::step(self.found.dt);
                let operator = SystemOperator::new(self.system, &self.extensions, option, combination);
                let a = SystemMatrix::assemble(self.pattern.clone(), &operator).into_matrix();
                self.work.assemblies += 1;
                let inertia = definite_by_blocks(&operator, &a, combination.mass);
                let inertia = inertia.unwrap_or_else(|| self.counter.count(&a, &mut self.work));
                self.found.options[place(option)].inertia = inertia;
            }
            Part::GrowingModes => {
                let minus_k = self.assemble(Stiffness::Full, Combination { mass: 0.0, damping: 0.0, stiffness: -1.0 });
                self.found.growing_modes = self.counter.count(&minus_k, &mut self.work).negative;
            }
            Part::Spectrum(option) => self.spectrum(option),
            Part::Definite(option) => {
                let limit = self.critical.largest_step(Property::Definite, option);
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
                    let Self { system, extensions, pattern, factorization, work, found, .. } = self;
                    let factorization = Ldlt::sharing(factorization)?;
                    let trial = Trial::new(system, extensions, found.dt, pattern.clone(), factorization);
                    let is_indefinite = found.options[0].inertia.negative > 0;
                    found.smallest_set = Some(smallest_set_with(trial, is_indefinite, work));
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
        let a = self.assemble(option, Combination::step(self.found.dt));
        self.work.assemblies += 1;
        let inertia = self.found.options[place(option)].inertia;
        let (wanted, digits) = match option == self.found.option {
            true if a.dofs().len() >= LARGE => (FEWER, Digits::All),
            true => (EIGENPAIRS.max(inertia.negative.min(DIRECTIONS)), Digits::All),
            false => (1, Digits::Certified),
        };
        let spectrum = spectrum_with(&mut self.factorization, &a, &inertia, wanted, digits, &mut self.work);
        let found = &mut self.found.options[place(option)];
        (found.smallest, found.largest, found.condition) = (spectrum.smallest(), spectrum.largest, spectrum.condition);
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
