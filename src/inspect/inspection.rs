//! Everything about the definiteness of A at one state.

use super::critical::LargestStep;
use super::culprits::{Cluster, Direction, clusters, direction};
use super::inertia::Inertia;
use super::quick_check::FirstAnswer;
use super::rotation_limit::Turn;
use super::skipped::{Part, SkipReason, Skipped};
use super::smallest_set::DropSet;
use super::spectrum::Spectrum;
use crate::assembly::SpringPattern;
use crate::force::SpringGeometry;
use crate::linear::Ldlt;
use crate::spring::Stiffness;
use crate::system::System;
use crate::work::Work;
use std::fmt::{Debug, Formatter};
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
    /// What λ_min and λ_max lie between, proven, in N/m; infinite where there is no proof.
    pub within: [[f64; 2]; 2],
    /// The largest step for which A is positive definite at this state.
    pub critical: LargestStep,
    /// The largest step for which the method adds no instability of its own at this state.
    pub stable: LargestStep,
    /// The largest step that turns no spring so far that this brakes or stretches it, see [`Turn`]: no linearisation sees this.
    pub turning: LargestStep,
}

impl OptionInspection {
    /// Takes over what a spectrum tells.
    pub(super) fn take(&mut self, spectrum: &Spectrum) {
        (self.smallest, self.largest, self.condition) = (spectrum.smallest(), spectrum.largest, spectrum.condition);
        self.within = [spectrum.smallest_within, spectrum.largest_within];
    }
}

/// The pattern of A, ordered and analysed, without memory for a factor. A system has one: it is no part of what was found.
#[derive(Clone)]
pub(super) struct Analysed {
    pub pattern: Arc<SpringPattern>,
    pub factorization: Arc<Ldlt>,
}

impl PartialEq for Analysed {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Debug for Analysed {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "Analysed")
    }
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
    /// What was skipped, with λ_min over the time step, which [`Pictures`](super::Pictures) look at.
    pub skipped: Vec<Skipped>,
    /// Of what was not skipped, what is estimated by products and multigrid, not proven by factorizations; `within` says of each figure what is
    /// proven of it all the same.
    pub estimated: Vec<Part>,
    /// What the inspection cost.
    pub work: Work,
    /// The analysis of the pattern, for [`Pictures`](super::Pictures); `None` where nothing was factored.
    pub(super) analysed: Option<Analysed>,
}

/// Eigenvalues that differ by less, relatively, are one to those who look at their eigenvectors: where A changes by that much, as it does
/// when a particle moves by a thousandth of a spring, these turn into any mixture of each other. A small imperfection, as ready
/// columns have it, leaves two-fold eigenvalues that far apart.
const SAME: f64 = 1e-3;

/// Directions of negative curvature that are taken apart at most.
pub(super) const DIRECTIONS: usize = 24;

impl Inspection {
    /// Of which nothing is known yet.
    pub(super) fn unknown(system: &System, extensions: &SpringGeometry, dt: f64, option: Stiffness) -> Self {
        let compressed = extensions.springs(system).filter(|((_, _, spring), at)| spring.is_compressed(at));
        let unknown = |option| OptionInspection {
            option,
            inertia: Inertia::undecided(system.dofs().len(), f64::INFINITY),
            smallest: f64::NAN,
            largest: f64::NAN,
            condition: f64::NAN,
            within: [[f64::NEG_INFINITY, f64::INFINITY]; 2],
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
            spectrum: Spectrum::unknown(),
            directions: Vec::new(),
            clusters: Vec::new(),
            turn: None,
            smallest_set: None,
            skipped: Vec::new(),
            estimated: Vec::new(),
            work: Work::default(),
            analysed: None,
        }
    }

    /// Takes over the spectrum under the option that is examined, and takes its negative directions apart, the lowest in any case.
    pub(super) fn examine(&mut self, system: &System, extensions: &SpringGeometry, spectrum: Spectrum) {
        let count = spectrum.negative().len().clamp(1, DIRECTIONS);
        let apart = |pair| direction(system, extensions, self.option, pair);
        self.directions = spectrum.lowest.iter().take(count).map(apart).collect();
        let bad: Vec<Direction> = self.directions.iter().filter(|d| d.eigenvalue < 0.0).cloned().collect();
        self.clusters = clusters(&bad);
        self.spectrum = spectrum;
    }

    /// What was skipped for a reason.
    pub fn skipped_for(&self, why: SkipReason) -> impl Iterator<Item = Part> + '_ {
        self.skipped.iter().filter(move |skipped| skipped.why == why).map(|skipped| skipped.part)
    }

    /// Without the picture of λ_min, which nobody waited for.
    pub fn without_curve(mut self) -> Self {
        if !self.lacks(Part::Curve) {
            self.skipped.push(Skipped { part: Part::Curve, why: SkipReason::Interrupted });
        }
        self
    }

    /// Whether a part was skipped.
    pub fn lacks(&self, part: Part) -> bool {
        self.skipped.iter().any(|skipped| skipped.part == part)
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

    /// Whether A is positive definite as far as is known: by the count of signs or, where there is none, by the first answer.
    pub fn is_definite(&self) -> bool {
        match self.lacks(Part::Signs(self.option)) {
            true => self.first.as_ref().is_some_and(|first| first.definite),
            false => self.examined().inertia.is_definite(),
        }
    }

    /// Whether [`is_definite`](Self::is_definite) says what is proven.
    pub fn is_proven(&self) -> bool {
        !self.lacks(Part::Signs(self.option)) || self.first.as_ref().is_some_and(|first| first.is_proven)
    }

    /// A under the option that was asked for.
    pub fn examined(&self) -> &OptionInspection {
        &self.options[place(self.option)]
    }
}

/// Where an option stands in [`Stiffness::ALL`].
pub(super) fn place(option: Stiffness) -> usize {
    match option {
        Stiffness::Full => 0,
        Stiffness::Tension => 1,
        Stiffness::Axial => 2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eigen::Eigenpair;
    use crate::inspect::tests::chain;
    use faer::Par;

    /// The number of equal ones among the lowest eigenvalues that were found, of so many negative, zero and positive ones; in words.
    #[test]
    fn multiplicities_are_those_of_what_was_found() {
        let (system, state) = chain(1, 1.25);
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let fold = |lowest: &[f64], [negative, zero, positive]: [usize; 3]| {
            let mut found = Inspection::unknown(&system, &extensions, 0.1, Stiffness::Tension);
            let pair = |&value: &f64| Eigenpair { value, vector: Vec::new(), residual: 0.0 };
            found.spectrum.lowest = lowest.iter().map(pair).collect();
            let inertia = &mut found.options[place(Stiffness::Tension)].inertia;
            (inertia.negative, inertia.zero, inertia.positive) = (negative, zero, positive);
            found.fold()
        };
        assert_eq!(fold(&[], [0, 0, 2]), None);
        assert_eq!(fold(&[1.0], [0, 0, 2]), None);
        assert_eq!(fold(&[1.0, 2.0], [0, 0, 2]), None);
        for signs in [[1, 1, 0], [0, 1, 1], [1, 0, 1], [2, 0, 0], [1, 0, 0]] {
            assert_eq!(fold(&[1.0, 1.0], signs).as_deref(), Some("2-fold"), "{signs:?}");
        }
        for signs in [[1, 1, 1], [3, 0, 0], [0, 3, 0], [0, 0, 3], [2, 0, 1]] {
            assert_eq!(fold(&[1.0, 1.0], signs).as_deref(), Some("at least 2-fold"), "{signs:?}");
        }
        // A thousandth of it is no difference; beyond the equal ones one was found that is not.
        assert_eq!(fold(&[-1.0, -0.9995, -0.9], [3, 0, 9]).as_deref(), Some("2-fold"));
    }

    /// The curve is skipped once, as what was interrupted; an inspection is equal to its copy, whatever analysis it keeps.
    #[test]
    fn the_curve_can_be_skipped() {
        let (system, state) = chain(2, 1.25);
        let inspected = || Inspection::at(&system, &state, 0.3, Stiffness::Full, Par::Seq).unwrap();
        let whole = inspected();
        assert!(whole.skipped.is_empty() && whole == inspected());
        let without = whole.clone().without_curve();
        assert_eq!(without.skipped, [Skipped { part: Part::Curve, why: SkipReason::Interrupted }]);
        assert!(without != whole && without.clone().without_curve() == without);
    }
}
