//! Everything about the definiteness of A at one state.

use super::critical::{CriticalSteps, LargestStep};
use super::culprits::{Cluster, Direction, clusters, direction};
use super::family::Property;
use super::inertia::{Inertia, InertiaCounter};
use super::smallest_set::{DropSet, smallest_set};
use super::spectrum::{Spectrum, spectrum_with};
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
    /// What the inspection cost.
    pub work: Work,
}

/// Eigenpairs that an inspection looks for, in a matrix too large to be diagonalised whole, and directions of negative
/// curvature that it takes apart at most.
const EIGENPAIRS: usize = 12;
const DIRECTIONS: usize = 24;

/// From so many degrees of freedom on both are fewer: every pair takes time.
const LARGE: usize = 30_000;
const FEWER: usize = 6;

/// Eigenvalues that differ by less, relatively, are one to those who look at it; they are known to far more digits.
const SAME: f64 = 1e-6;

impl Inspection {
    /// Inspects A at a state for a step of length dt, under an option for which the directions are examined.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large to factor.
    pub fn at(system: &System, state: &State, dt: f64, option: Stiffness, par: Par) -> Result<Self> {
        let extensions = Extensions::at(system, &state.positions)?;
        let pattern = Arc::new(SpringPattern::of_stiffness(system)?);
        let assemble = |option, combination| {
            let operator = SystemOperator::new(system, &extensions, option, combination);
            SystemMatrix::assemble(pattern.clone(), &operator).into_matrix()
        };
        let mut critical = CriticalSteps::new(system, state, par)?;
        let mut turning = Turning::new(system, state, par)?;
        let mut work = Work { symbolic_factorizations: 2, ..Work::default() };
        let minus_k = assemble(Stiffness::Full, Combination { mass: 0.0, damping: 0.0, stiffness: -1.0 });
        let mut counter = InertiaCounter::new(minus_k.pattern(), par)?;
        let growing_modes = counter.count(&minus_k, &mut work).negative;

        let mut factorization = Ldlt::analyse(minus_k.pattern(), par)?;
        let mut examined = None;
        let mut inspect = |each: Stiffness| -> Result<OptionInspection> {
            let a: SymmetricMatrix = assemble(each, Combination::step(dt));
            work.assemblies += 1;
            let inertia = counter.count(&a, &mut work);
            let wanted = match each == option {
                true if a.dofs().len() >= LARGE => FEWER,
                true => EIGENPAIRS.max(inertia.negative.min(DIRECTIONS)),
                false => 1,
            };
            let spectrum = spectrum_with(&mut factorization, &a, &inertia, wanted, &mut work);
            let definite = critical.largest_step(Property::Definite, each);
            let report = OptionInspection {
                option: each,
                inertia,
                smallest: spectrum.smallest(),
                largest: spectrum.largest,
                condition: spectrum.condition,
                critical: definite,
                // Under `Full` the requirements coincide, see [`CriticalSteps`].
                stable: match each {
                    Stiffness::Full => definite,
                    Stiffness::Tension | Stiffness::Axial => critical.largest_step(Property::Stable, each),
                },
                turning: turning.largest_step(each, dt),
            };
            if each == option {
                examined = Some(spectrum);
            }
            Ok(report)
        };
        let [full, tension, axial] = Stiffness::ALL;
        let options = [inspect(full)?, inspect(tension)?, inspect(axial)?];

        let spectrum = examined.unwrap_or(Spectrum { lowest: Vec::new(), largest: f64::NAN, condition: f64::NAN });
        let negative = spectrum.negative().len().clamp(1, DIRECTIONS);
        let directions: Vec<Direction> =
            spectrum.lowest.iter().take(negative).map(|pair| direction(system, &extensions, option, pair)).collect();
        let bad: Vec<Direction> = directions.iter().filter(|d| d.eigenvalue < 0.0).cloned().collect();
        let smallest_set = if options[0].inertia.is_definite() {
            None
        } else {
            Some(smallest_set(system, &extensions, dt, par, &mut work)?)
        };
        let compressed = extensions.springs(system).filter(|((_, _, spring), at)| spring.is_compressed(at));
        let compressed_springs = compressed.count();
        let turn = turning.worst(option, dt);
        work.add(&critical.work);
        work.add(&turning.work);
        Ok(Self {
            dt,
            option,
            options,
            growing_modes,
            compressed_springs,
            clusters: clusters(&bad),
            spectrum,
            directions,
            turn,
            smallest_set,
            work,
        })
    }

    /// How many of the eigenvalues that were found equal the lowest, to a millionth of it: where there are several, any mixture of
    /// their eigenvectors is one, and the one that was found is no better than others.
    pub fn multiplicity(&self) -> usize {
        let Some(lowest) = self.spectrum.lowest.first().map(|pair| pair.value) else { return 0 };
        let same = |value: f64| (value - lowest).abs() <= SAME * lowest.abs();
        self.spectrum.lowest.iter().take_while(|pair| same(pair.value)).count()
    }

    /// A under the option that was asked for.
    pub fn examined(&self) -> &OptionInspection {
        let [full, tension, axial] = &self.options;
        match self.option {
            Stiffness::Full => full,
            Stiffness::Tension => tension,
            Stiffness::Axial => axial,
        }
    }
}
