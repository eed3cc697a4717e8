//! The inspection of A at one state: its parts and their results, and a quick check before all else.

use super::critical::LargestStep;
use super::culprits::{Cluster, Culprit, Direction, clusters, direction};
use super::inertia::Inertia;
use super::rotation_limit::Turn;
use super::smallest_set::DropSet;
use super::spectrum::{ROUNDING, Spectrum};
use crate::assembly::SymmetricMatrix;
use crate::eigen::{Eigenpair, Pencil, eigenpair, probe, scaled_products, unit};
use crate::force::SpringGeometry;
use crate::linear::Ldlt;
use crate::operator::LinearOperator;
use crate::spring::Stiffness;
use crate::system::System;
use crate::work::Work;
use faer::Par;

/// A part of an inspection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// A quick check: is A positive definite under the examined option, and which spring spoils it most?
    FirstAnswer,
    /// The signs of the eigenvalues of A.
    Signs(Stiffness),
    /// The modes of the exact motion that grow.
    GrowingModes,
    /// The longest step that rotates no spring too far.
    Turning(Stiffness),
    /// λ_min, λ_max and the condition number; under the examined option also the springs behind them.
    Spectrum(Stiffness),
    /// The longest step for which A is positive definite.
    Definite(Stiffness),
    /// The longest step that adds no instability.
    Stable(Stiffness),
    /// The transverse terms that must go.
    SmallestSet,
    /// λ_min over the time step, in a picture.
    Curve,
}

impl Part {
    pub(super) fn all() -> impl Iterator<Item = Self> {
        let of_each = [Self::Signs, Self::Spectrum, Self::Definite, Self::Stable];
        [Self::FirstAnswer, Self::GrowingModes, Self::SmallestSet, Self::Curve]
            .into_iter()
            .chain([Self::Turning(Stiffness::Tension), Self::Turning(Stiffness::Axial)])
            .chain(of_each.into_iter().flat_map(|of| Stiffness::ALL.map(of)))
    }
}

/// The reason why a part was skipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SkipReason {
    /// Not reached yet.
    Interrupted,
    /// Beyond the budget of the inspection.
    TooMuchWork,
    /// A factor of A does not fit the memory.
    TooMuchMemory,
}

/// A part that was skipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Skipped {
    /// The part.
    pub part: Part,
    /// The reason.
    pub why: SkipReason,
}

/// The properties of A under one option.
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
    /// Proven bounds of λ_min and of λ_max, in N/m; infinite where there is none.
    pub within: [[f64; 2]; 2],
    /// The largest step for which A is positive definite at this state.
    pub critical: LargestStep,
    /// The largest step for which the method adds no instability of its own at this state.
    pub stable: LargestStep,
    /// The largest step that rotates no spring too far, see [`Turn`].
    pub turning: LargestStep,
}

impl OptionInspection {
    pub(super) fn set_spectrum(&mut self, spectrum: &Spectrum) {
        (self.smallest, self.largest, self.condition) = (spectrum.smallest(), spectrum.largest, spectrum.condition);
        self.within = [spectrum.smallest_within, spectrum.largest_within];
    }
}

/// The definiteness of `A = M/dt² − G/dt − K` at one state.
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
    /// The examined option: that of the directions.
    pub option: Stiffness,
    /// A under each option, in the order of [`Stiffness::ALL`].
    pub options: [OptionInspection; 4],
    /// The quick check under the examined option.
    pub first: Option<FirstAnswer>,
    /// Modes of the exact motion that grow: negative eigenvalues of −K. No step can make these stable.
    pub growing_modes: usize,
    /// Springs shorter than at rest, of those that have a free end.
    pub compressed_springs: usize,
    /// The low end of the spectrum of A under the option.
    pub spectrum: Spectrum,
    /// The direction of the lowest eigenvalue, and of the others that are negative.
    pub directions: Vec<Direction>,
    /// The main culprits of directions of negative curvature, grouped by shared particles.
    pub clusters: Vec<Cluster>,
    /// The spring that a step of this length rotates worst, under the option; `None` where it rotates none.
    pub turn: Option<Turn>,
    /// The transverse terms that must go, if A under `Full` is not positive definite.
    pub smallest_set: Option<DropSet>,
    /// The parts that were skipped.
    pub skipped: Vec<Skipped>,
    /// The parts that are estimated by products and multigrid, not proven by factorizations; see `within` for what is proven.
    pub estimated: Vec<Part>,
    /// The work of the inspection.
    pub work: Work,
    pub(super) par: Par,
}

pub(super) const DIRECTIONS: usize = 24;

impl Inspection {
    pub(super) fn unknown(
        system: &System,
        extensions: &SpringGeometry,
        dt: f64,
        option: Stiffness,
        why: SkipReason,
    ) -> Self {
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
            compressed_springs: extensions.compressed(system),
            spectrum: Spectrum::unknown(),
            directions: Vec::new(),
            clusters: Vec::new(),
            turn: None,
            smallest_set: None,
            skipped: Part::all().map(|part| Skipped { part, why }).collect(),
            estimated: Vec::new(),
            work: Work::default(),
            par: Par::Seq,
        }
    }

    /// Sets the spectrum under the examined option, and analyses its negative directions, the lowest in any case.
    pub(super) fn examine(&mut self, system: &System, extensions: &SpringGeometry, spectrum: Spectrum) {
        let count = spectrum.negative().len().clamp(1, DIRECTIONS);
        let analysed = |pair| direction(system, extensions, self.option, pair);
        self.directions = spectrum.lowest.iter().take(count).map(analysed).collect();
        let bad: Vec<Direction> = self.directions.iter().filter(|d| d.eigenvalue < 0.0).cloned().collect();
        self.clusters = clusters(&bad);
        self.spectrum = spectrum;
    }

    /// The parts skipped for a reason.
    pub fn skipped_for(&self, why: SkipReason) -> impl Iterator<Item = Part> + '_ {
        self.skipped.iter().filter(move |skipped| skipped.why == why).map(|skipped| skipped.part)
    }

    /// The same without λ_min over the time step.
    pub fn without_curve(mut self) -> Self {
        if !self.lacks(Part::Curve) {
            self.skipped.push(Skipped { part: Part::Curve, why: SkipReason::Interrupted });
        }
        self
    }

    /// A part was skipped.
    pub fn lacks(&self, part: Part) -> bool {
        self.skipped.iter().any(|skipped| skipped.part == part)
    }

    /// The number of eigenvalues found that equal the lowest, to a thousandth of it: where A changes by as much, as when a particle moves by a
    /// thousandth of a spring, their eigenvectors mix.
    pub fn multiplicity(&self) -> usize {
        let Some(lowest) = self.spectrum.lowest.first().map(|pair| pair.value) else { return 0 };
        let same = |value: f64| (value - lowest).abs() <= 1e-3 * lowest.abs();
        self.spectrum.lowest.iter().take_while(|pair| same(pair.value)).count()
    }

    /// The [multiplicity](Self::multiplicity) for people, `2-fold` or `at least 12-fold`; `None` for a simple eigenvalue.
    pub fn fold(&self) -> Option<String> {
        let (fold, found) = (self.multiplicity(), self.spectrum.lowest.len());
        let Inertia { negative, zero, positive, .. } = self.examined().inertia;
        let more = fold == found && found < negative + zero + positive;
        (fold > 1).then(|| format!("{}{fold}-fold", if more { "at least " } else { "" }))
    }

    /// A is positive definite, by the count of signs or, where there is none, by the quick check.
    pub fn is_definite(&self) -> bool {
        match self.lacks(Part::Signs(self.option)) {
            true => self.first.as_ref().is_some_and(|first| first.definite),
            false => self.examined().inertia.is_definite(),
        }
    }

    /// [`is_definite`](Self::is_definite) is proven.
    pub fn is_proven(&self) -> bool {
        !self.lacks(Part::Signs(self.option)) || self.first.as_ref().is_some_and(|first| first.is_proven)
    }

    /// A under the examined option.
    pub fn examined(&self) -> &OptionInspection {
        &self.options[self.option as usize]
    }
}

pub(super) fn examined_first(option: Stiffness) -> [Stiffness; 4] {
    let mut options = Stiffness::ALL;
    options.sort_by_key(|&each| each != option);
    options
}

/// The answer of a quick check: whether A is positive definite, with a direction of low curvature.
#[derive(Debug, Clone, PartialEq)]
pub struct FirstAnswer {
    /// A is positive definite, by a factorization; not so by the direction.
    pub definite: bool,
    /// That is proven. Where A is not factored it may only be that no direction of negative curvature was found.
    pub is_proven: bool,
    /// u, with `uᵀAu` for its eigenvalue: an upper bound for λ_min, negative where A is indefinite.
    pub direction: Direction,
    /// `‖Au − (uᵀAu) u‖`, in N/m: A has an eigenvalue within this distance of `uᵀAu`.
    pub residual: f64,
}

impl FirstAnswer {
    /// The spring with the largest share of the negative curvature, if any.
    pub fn worst(&self) -> Option<&Culprit> {
        self.direction.culprits.first()
    }
}

/// A quick check before all else. `uᵀAu < 0` proves that A is indefinite: u is the lowest Ritz vector of a short Lanczos run. Where that is none, A
/// is factored: `A = L D Lᵀ` with D > 0 proves that A is positive definite, to rounding; a pivot `d_j < 0` gives `u = L⁻ᵀ e_j/d_j` with
/// `uᵀAu = 1/d_j`, and a few steps of inverse iteration lead to the eigenvector nearest to zero.
///
/// `products` is A by its fastest products; `None` where A is empty, not finite, or singular to working precision.
pub(super) fn quick_check(
    system: &System,
    extensions: &SpringGeometry,
    option: Stiffness,
    a: &SymmetricMatrix,
    products: &dyn LinearOperator,
    factorization: &mut Ldlt,
    work: &mut Work,
) -> Option<FirstAnswer> {
    let n = a.order();
    let size = Pencil::of(a).norm();
    if n == 0 || !size.is_finite() {
        return None;
    }
    let answer = |definite: bool, pair: Eigenpair| {
        let direction = direction(system, extensions, option, &pair);
        FirstAnswer { definite, is_proven: true, direction, residual: pair.residual }
    };
    let is_negative = |pair: &Eigenpair| pair.value < -ROUNDING * size;
    let eigenpair = |u| eigenpair(&Pencil::of(a), u);
    let ends = probe(n, None, 60, &mut scaled_products(products, None));
    let lowest = ends.map(|[low, _]| eigenpair(low.vector));
    if let Some(pair) = lowest.as_ref().filter(|pair| is_negative(pair)) {
        return Some(answer(false, pair.clone()));
    }
    work.factorizations += 1;
    factorization.factor(a).ok()?;
    let mut u = match lowest {
        Some(pair) => pair.vector,
        None => vec![1.0; n],
    };
    let definite = factorization.is_positive();
    if !definite && !factorization.negative_direction(&mut u) {
        return None;
    }
    let mut best = eigenpair(unit(u)?);
    for _ in 0..3 {
        let mut u = best.vector.clone();
        factorization.substitute(&mut u);
        work.solves += 1;
        let next = unit(u).map(eigenpair);
        // Of an indefinite A inverse iteration may go on to an eigenvalue above zero.
        let Some(next) = next.filter(|next| definite && next.value < best.value || !definite && is_negative(next))
        else {
            break;
        };
        best = next;
    }
    (definite == (best.value > 0.0)).then(|| answer(definite, best))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspect::tests::chain;
    use crate::linear::fixtures::banded;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;

    /// The number of equal ones among the lowest eigenvalues that were found, of so many negative, zero and positive ones; in words.
    #[test]
    fn multiplicities_are_those_of_what_was_found() {
        let (system, state) = chain(1, 1.25);
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let fold = |lowest: &[f64], [negative, zero, positive]: [usize; 3]| {
            let mut found = Inspection::unknown(&system, &extensions, 0.1, Stiffness::Tension, SkipReason::Interrupted);
            let pair = |&value: &f64| Eigenpair { value, vector: Vec::new(), residual: 0.0 };
            found.spectrum.lowest = lowest.iter().map(pair).collect();
            let inertia = &mut found.options[Stiffness::Tension as usize].inertia;
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

    /// The curve is skipped once, as what was interrupted; an inspection is equal to its copy.
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

    /// The answer for a diagonal matrix of three rows, its factorizations and solves.
    fn answered(diagonal: [f64; 3]) -> (Option<FirstAnswer>, [u64; 2]) {
        let mut builder = SystemBuilder::new();
        let ends = [0.0, 1.0].map(|x| builder.particle([x, 0.0, 0.0], 1.0));
        builder.spring(ends[0], ends[1], Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        builder.hold(ends[1]);
        let (system, state) = builder.build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let a = banded(1, 0, |row, column| if row == column { diagonal[row] } else { 0.0 });
        let mut factorization = Ldlt::analyse(a.pattern(), Par::Seq).unwrap();
        let mut work = Work::default();
        let full = Stiffness::Full;
        let first = quick_check(&system, &extensions, full, &a, &a, &mut factorization, &mut work);
        (first, [work.factorizations, work.solves])
    }

    /// From 10⁻¹³ of ‖A‖ below zero on products are believed, whatever the size of A; what is nearer to zero a factorization decides, and one solve
    /// says that its direction is the eigenvector.
    #[test]
    fn products_are_believed_beyond_their_rounding() {
        for size in [2f64.powi(-20), 1.0, 2f64.powi(20)] {
            let answer = |lowest: f64| {
                let (first, work) = answered([size * lowest, 0.25 * size, size]);
                let first = first.unwrap();
                assert!(first.is_proven && (first.direction.eigenvalue / (size * lowest) - 1.0).abs() < 1e-2);
                (first.definite, work)
            };
            assert_eq!(answer(-2e-13), (false, [0, 0]), "{size}");
            assert_eq!(answer(-0.5e-13), (false, [1, 1]), "{size}");
            // Of a definite one a second may lower the quotient by its rounding.
            assert!(matches!(answer(0.5e-13), (true, [1, 1 | 2])), "{size}");
        }
        for diagonal in [[f64::INFINITY, 1.0, 1.0], [f64::NEG_INFINITY, 1.0, 1.0]] {
            assert_eq!(answered(diagonal), (None, [0, 0]));
        }
    }
}
