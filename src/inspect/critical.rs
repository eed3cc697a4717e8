//! The largest step that keeps A positive definite, and the largest that keeps the method stable.
//!
//! Both are questions about one pencil of symmetric matrices in `s = 1/dt`,
//!
//! ```text
//! P(s) = μ s² M − γ s G + C,          M > 0,  −G ≥ 0,
//! definite:  μ = 1, γ = 1, C = −K_opt              so that P = A = M/dt² − G/dt − K_opt
//! stable:    μ = 4, γ = 2, C = −2 K_opt + K        so that P = S = 4M/dt² − 2G/dt − 2K_opt + K
//! ```
//!
//! `uᵀP(s)u` grows with s for every u, so the s for which P is positive definite are an interval `(s*, ∞)`, and the
//! largest step is `dt* = 1/s*`; where C itself is positive semidefinite every step will do.
//!
//! **Why S.** Linearised at an equilibrium, a step of linearised backward Euler obeys
//! `M(x₊ − 2x + x₋)/dt² − G(x₊ − x)/dt − K_opt(x₊ − x) − K x = 0`. With `x₊ = z x`, `x₋ = x/z` and the scalars
//! `a = uᵀMu/dt²`, `c = −uᵀGu/dt − uᵀK_opt u`, `κ = −uᵀKu` of a mode u this is `(a + c) z² + (κ − c − 2a) z + a = 0`. Both
//! roots lie in the unit disc (Jury) iff `a + c > 0`, `c ≥ 0`, `κ ≥ 0`, and the polynomial at z = −1 is not negative:
//! `4a + 2c − κ ≥ 0`, which is `uᵀSu ≥ 0`. Under `Full` c ≥ κ, and under `Tension` the same holds for what is stretched: S adds
//! nothing. Under `Axial` the stretched springs' transverse modes are left to the old positions, as in symplectic
//! Euler, and S demands `dt ≤ 2/ω`.
//!
//! **Where the state is not a stable equilibrium** (κ < 0 for some u) the motion itself grows, whatever the method. For
//! such a u one root is real and above 1, as it must be, and S then says that the *other* roots stay in the disc:
//! the method adds no oscillating instability of its own. This needs A positive definite, so the stable step is never
//! larger than the definite one. At a state that is no equilibrium at all both hold for the motion relative to the
//! trajectory, as long as the springs' directions and lengths change little.
//!
//! **The search.** A factorization `P = L D Lᵀ` with D > 0 is Cholesky's and proves P definite, to rounding: the oracle. Where it
//! refuses, or where a vector u with `uᵀP(s)u ≤ 0` is known, P is not definite. Along any u the scalar quadratic `uᵀP(s)u` has a
//! root that is a lower bound for s*, short of it by the square of the error of u. The first u is the lowest Ritz vector of `M⁻¹C`, by products. From an
//! accepted s₀ on the next is the lowest eigenvector of the pencil (P(s₀), M), by Lanczos with the factor that accepted it: without damping that is the null
//! vector of P(s*) for every s₀, with damping it goes there as s₀ does, which is Newton's iteration for the lowest eigenvalue of a hyperbolic quadratic
//! pencil. A refused factorization gives `u = L⁻ᵀe_j`, for which `uᵀPu = d_j < 0`. The next trial lies above the bound by what u is thought to be
//! short of s*, and no farther than halfway to what was accepted. The interval ends at the oracle's own rounding: a relative width of
//! `4u + 4u‖P‖/(s d(uᵀPu)/ds)` for `‖u‖ = 1`.

use super::inertia::InertiaCounter;
use super::matrix_pencil::{MatrixPencil, Property};
use crate::assembly::{SpringPattern, SystemMatrix};
use crate::eigen::{BlockLanczos, End, Search, Tolerance};
use crate::error::Result;
use crate::force::SpringGeometry;
use crate::linear::{Ldlt, SOLVE_COLUMNS, dot};
use crate::spring::{SpringBlock, Stiffness};
use crate::system::{State, System};
use crate::work::Work;
use faer::Par;
use std::sync::Arc;

/// The largest step that keeps a requirement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LargestStep {
    /// Every step keeps it.
    Every,
    /// Steps up to a limit keep it.
    UpTo {
        /// The longest step at which a factorization proved it, in s.
        dt: f64,
        /// A longer step for which it is known to be lost, by a factorization that refused or by a direction of negative
        /// curvature, in s; as near to `dt` as rounding allows.
        refused: f64,
    },
    /// Not looked for.
    Unknown,
}

impl LargestStep {
    /// The step, in s; `None` when there is no limit, or none is known.
    pub fn dt(&self) -> Option<f64> {
        match *self {
            Self::Every | Self::Unknown => None,
            Self::UpTo { dt, .. } => Some(dt),
        }
    }
}

/// Finds critical steps of a system: pattern, ordering and symbolic analysis made once.
///
/// # Examples
/// ```
/// use sprung::Stiffness;
/// use sprung::faer::Par;
/// use sprung::inspect::{CriticalSteps, Property};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// let mut steps = CriticalSteps::new(&system, &state, Par::Seq)?;
/// let full = steps.largest_step(Property::Definite, Stiffness::Full).dt().ok_or("no limit")?;
/// assert!((full - 0.1_f64.sqrt()).abs() < 1e-6); // 1/dt² = 10 N/m
/// assert_eq!(steps.largest_step(Property::Definite, Stiffness::Tension).dt(), None);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct CriticalSteps<'s> {
    pencil: MatrixPencil<'s>,
    matrix: SystemMatrix,
    factorization: Ldlt,
    inertia: InertiaCounter,
    known: Known,
    /// What the searches cost.
    pub work: Work,
}

/// What is known of A under `Full` before a search for its limit.
#[derive(Debug, Clone, Default)]
pub(super) struct Known {
    /// Whether −K has negative eigenvalues.
    pub curves_downwards: Option<bool>,
    /// A direction, not necessarily a good one.
    pub direction: Option<Vec<f64>>,
    /// An s at which A is positive definite, proven.
    pub definite_from: Option<f64>,
}

/// Bisection alone ends in 64 halvings: a search that takes longer has a defect.
const LONGEST_SEARCH: usize = 100;

/// By how much a margin that was too small grows, and by how much one that was large enough shrinks at least.
const BOLDER: f64 = 8.0;
const CLOSER: f64 = 1e-3;

/// Rounding error of what a length contributes to the block of a spring, relative to the block: of a spring at rest that is all there is.
const LENGTH: f64 = 16.0 * f64::EPSILON;

/// How far from s* a known direction may be, relatively, for which no better one is looked for by products.
const NEAR: f64 = 1e-2;

/// By how much s falls from one trial to the next while nothing has been refused.
const LEAP: f64 = 16.0;

/// The relative residual at which a direction is good enough, and blocks of vectors that it may take.
const RESIDUAL: Tolerance = Tolerance { of_value: 0.0, of_norm: 1e-10 };
const BLOCKS: usize = 12;

impl<'s> CriticalSteps<'s> {
    /// At a state.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large.
    pub fn new(system: &'s System, state: &State, par: Par) -> Result<Self> {
        let pattern = Arc::new(SpringPattern::of_stiffness(system)?);
        let factorization = Ldlt::analyse(pattern.pattern(), par)?;
        let work = Work { symbolic_factorizations: 1, ..Work::default() };
        Self::analysed(system, SpringGeometry::at(system, state)?, pattern, factorization, work)
    }

    /// On a pattern that has been analysed.
    ///
    /// # Errors
    /// A factor that does not fit the memory.
    pub(super) fn analysed(
        system: &'s System,
        extensions: SpringGeometry,
        pattern: Arc<SpringPattern>,
        factorization: Ldlt,
        work: Work,
    ) -> Result<Self> {
        let (pencil, matrix) = (MatrixPencil::new(system, extensions), SystemMatrix::zeros(pattern));
        let inertia = InertiaCounter::sharing(&factorization)?;
        Ok(Self { pencil, matrix, factorization, inertia, known: Known::default(), work })
    }

    /// The limit of definiteness under `Full`, from what is known of A.
    pub(super) fn definite_knowing(&mut self, known: Known) -> LargestStep {
        if known.curves_downwards == Some(false) {
            return LargestStep::Every;
        }
        self.known = known;
        let limit = self.largest_step(Property::Definite, Stiffness::Full);
        self.known = Known::default();
        limit
    }

    /// The largest step that keeps the requirement under an option, certified by factorizations on both sides.
    pub fn largest_step(&mut self, requirement: Property, option: Stiffness) -> LargestStep {
        match (requirement, option) {
            // S(s) is A(2s): semidefinite as far as A is, and beyond.
            (Property::Definite, _) | (Property::Stable, Stiffness::Full) => self.search(Property::Definite, option),
            // A is positive definite for every s.
            (Property::Stable, Stiffness::Tension | Stiffness::Axial) => self.search(Property::Stable, option),
        }
    }

    fn search(&mut self, requirement: Property, option: Stiffness) -> LargestStep {
        self.pencil.set(requirement, option, 0.0);
        // Blocks that are all positive semidefinite decide it without a factorization: as far as the lengths of springs tell.
        let is_none = |block: &SpringBlock| block.lowest() >= -LENGTH * block.transverse.abs().max(block.axial.abs());
        if self.pencil.blocks().iter().all(is_none) {
            return LargestStep::Every;
        }
        let known = std::mem::take(&mut self.known);
        // Above this P(s) is definite for certain.
        let mut accepted = self.pencil.surely_definite(requirement).min(known.definite_from.unwrap_or(f64::INFINITY));
        let mut bound = Bound::nothing();
        let mut u = known.direction.unwrap_or_default();
        let is_near = !u.is_empty()
            && self.raise(requirement, option, &mut bound, &u)
            && self.shortfall(requirement, option, bound, &u) <= NEAR;
        if !is_near {
            self.pencil.set(requirement, option, 0.0);
            let lowest = self.pencil.lowest_direction().unwrap_or_else(|| vec![0.0; self.pencil.masses().len()]);
            if self.raise(requirement, option, &mut bound, &lowest) || u.is_empty() {
                u = lowest;
            }
        }
        if bound.s == 0.0 && known.curves_downwards != Some(true) && !self.curves_downwards(requirement, option) {
            return LargestStep::Every;
        }
        let mut margin = self.shortfall(requirement, option, bound, &u);
        for _ in 0..LONGEST_SEARCH {
            // Rounding may lift a root above what a factorization has accepted; the bracket must stay one.
            bound.s = bound.s.min(accepted);
            if accepted / bound.s - 1.0 <= bound.rounding {
                break;
            }
            let halfway = if bound.s > 0.0 { (bound.s * accepted).sqrt() } else { accepted / LEAP };
            let trial = (bound.s * (1.0 + margin.max(bound.rounding / 2.0))).min(halfway);
            let trial = if bound.s > 0.0 { trial } else { halfway };
            if trial == 0.0 {
                return LargestStep::Every;
            }
            if trial <= bound.s || trial >= accepted {
                break;
            }
            if self.is_definite(requirement, option, trial) {
                accepted = trial;
                if accepted / bound.s - 1.0 <= bound.rounding {
                    break;
                }
                u = self.improved(&u);
                self.raise(requirement, option, &mut bound, &u);
                let width = (accepted / bound.s - 1.0).max(0.0);
                margin = self.shortfall(requirement, option, bound, &u).min(CLOSER * width);
            } else {
                bound.s = trial;
                let mut worst = vec![0.0; u.len()];
                if self.factorization.negative_direction(&mut worst)
                    && self.raise(requirement, option, &mut bound, &worst)
                {
                    u = worst;
                    margin = self.shortfall(requirement, option, bound, &u);
                } else {
                    margin = BOLDER * margin.max(bound.rounding / 2.0);
                }
            }
        }
        LargestStep::UpTo { dt: 1.0 / accepted, refused: 1.0 / bound.s }
    }

    /// The lowest eigenvector of the pencil (P(s), M), nearly, with the P(s) that is factored and from a direction near it.
    fn improved(&mut self, u: &[f64]) -> Vec<f64> {
        let Self { pencil, factorization, work, .. } = self;
        let (n, masses) = (u.len(), pencil.masses());
        let mut solve = |x: &[f64], y: &mut [f64]| {
            work.solves += (x.len() / n) as u64;
            for (x, y) in x.chunks(n).zip(y.chunks_mut(n)) {
                y.iter_mut().zip(x).zip(masses).for_each(|((y, x), mass)| *y = mass * x);
            }
            factorization.substitute_columns(n, y);
        };
        let mut space = BlockLanczos::new(n, Some(masses), Search::new(End::Highest, 1, SOLVE_COLUMNS), 1);
        space.start([u], &mut solve);
        space.refresh(&mut solve);
        let found = space.iterate(RESIDUAL, BLOCKS, &mut solve, None);
        found.into_iter().next().map_or_else(|| u.to_vec(), |pair| pair.image)
    }

    /// Nearly how far the bound along u may be from s*, relatively.
    fn shortfall(&mut self, requirement: Property, option: Stiffness, bound: Bound, u: &[f64]) -> f64 {
        self.pencil.set(requirement, option, bound.s);
        self.pencil.residual(u)
    }

    /// The oracle: whether P(s) has a Cholesky factorization.
    fn is_definite(&mut self, requirement: Property, option: Stiffness, s: f64) -> bool {
        self.pencil.set(requirement, option, s);
        self.matrix.refill(self.pencil.operator());
        self.work.assemblies += 1;
        self.work.factorizations += 1;
        self.factorization.factor(self.matrix.matrix()).is_ok() && self.factorization.is_positive()
    }

    /// Whether C has negative eigenvalues, where no direction is known.
    fn curves_downwards(&mut self, requirement: Property, option: Stiffness) -> bool {
        self.pencil.set(requirement, option, 0.0);
        self.matrix.refill(self.pencil.operator());
        self.work.assemblies += 1;
        self.inertia.count(self.matrix.matrix(), &mut self.work).negative > 0
    }

    /// Raises the bound to the root along u where that is higher; says whether it is.
    fn raise(&mut self, requirement: Property, option: Stiffness, bound: &mut Bound, u: &[f64]) -> bool {
        let curvature = self.pencil.curvature(requirement, option, u);
        match curvature.root().filter(|&root| root.is_finite() && root > bound.s) {
            Some(root) => {
                let slope = (2.0 * curvature.mass * root + curvature.damping) * root;
                let norm = self.pencil.norm_bound(root, requirement) * dot(u, u);
                *bound = Bound { s: root, rounding: 2.0 * f64::EPSILON * (2.0 + norm / slope) };
                true
            }
            None => false,
        }
    }
}

/// A lower bound for s*, and how finely the oracle can tell near it, relatively.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Bound {
    s: f64,
    rounding: f64,
}

impl Bound {
    /// Nothing is known, and the oracle has the rounding of four operations at least.
    fn nothing() -> Self {
        Self { s: 0.0, rounding: 4.0 * f64::EPSILON }
    }
}

#[cfg(test)]
mod tests;
