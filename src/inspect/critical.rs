//! The largest step that keeps A positive definite, and the largest that keeps the method stable.
//!
//! Both are questions about one family of symmetric matrices in `s = 1/dt`,
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
//! **Why S.** Linearised at an equilibrium, a step of the notes' method obeys
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
//! **The search.** A factorization `P = L D Lᵀ` with D > 0 is Cholesky's and proves P definite, to rounding: the oracle. Where a
//! pivot `d_j` is negative, `u = L⁻ᵀe_j` has `uᵀPu = d_j < 0`, and the root of the scalar quadratic `uᵀP(s)u` in s is a
//! better lower bound for s*; near s* it converges quadratically, because then u nears the null vector. Bisection between
//! what was refused and what was accepted takes over where this does not at least halve the interval. The interval ends at
//! the oracle's own rounding: a relative width of `4u + 4u‖P‖/(s d(uᵀPu)/ds)`, for `‖u‖ = 1`.

use super::family::{Family, Requirement};
use super::inertia::InertiaCounter;
use crate::assembly::{SpringPattern, SystemMatrix};
use crate::error::Result;
use crate::force::Extensions;
use crate::linear::{Ldlt, dot};
use crate::spring::Stiffness;
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
        /// The shortest step at which a factorization refused it, in s; as near to `dt` as rounding allows.
        refused: f64,
    },
}

impl LargestStep {
    /// The step, in s; `None` when there is no limit.
    pub fn dt(&self) -> Option<f64> {
        match *self {
            Self::Every => None,
            Self::UpTo { dt, .. } => Some(dt),
        }
    }

    /// The more demanding of two limits.
    pub fn min(self, other: Self) -> Self {
        match (self, other) {
            (Self::UpTo { dt: a, .. }, Self::UpTo { dt: b, .. }) if a <= b => self,
            (Self::UpTo { .. }, Self::UpTo { .. }) => other,
            (Self::Every, limit) | (limit, Self::Every) => limit,
        }
    }
}

/// Finds critical steps of a system: pattern, ordering and symbolic analysis made once.
pub struct CriticalSteps<'s> {
    family: Family<'s>,
    matrix: SystemMatrix,
    factorization: Ldlt,
    inertia: InertiaCounter,
    /// What the searches cost.
    pub work: Work,
}

/// Bisection alone ends in 64 halvings after at most ten to find both ends: a search that takes longer has a defect.
const LONGEST_SEARCH: usize = 100;

/// Inverse iterations that bring a direction of negative curvature nearer to the null vector.
const INVERSE_ITERATIONS: usize = 2;

impl<'s> CriticalSteps<'s> {
    /// At a state.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large.
    pub fn new(system: &'s System, state: &State, par: Par) -> Result<Self> {
        let family = Family::new(system, Extensions::at(system, &state.positions)?);
        let matrix = SystemMatrix::zeros(Arc::new(SpringPattern::of_stiffness(system)?));
        let factorization = Ldlt::analyse(matrix.matrix().pattern(), par)?;
        let inertia = InertiaCounter::new(matrix.matrix().pattern(), par)?;
        let work = Work { symbolic_factorizations: 2, ..Work::default() };
        Ok(Self { family, matrix, factorization, inertia, work })
    }

    /// The largest step that keeps the requirement under an option, certified by factorizations on both sides.
    pub fn largest_step(&mut self, requirement: Requirement, option: Stiffness) -> LargestStep {
        let definite = self.search(Requirement::Definite, option);
        match requirement {
            Requirement::Definite => definite,
            Requirement::Stable => definite.min(self.search(Requirement::Stable, option)),
        }
    }

    fn search(&mut self, requirement: Requirement, option: Stiffness) -> LargestStep {
        self.family.set(requirement, option, 0.0);
        // Blocks that are all positive semidefinite settle it without a factorization.
        if self.family.blocks().iter().all(|block| block.lowest() >= 0.0) {
            return LargestStep::Every;
        }
        let mut accepted = self.family.surely_definite(requirement);
        self.matrix.refill(self.family.operator());
        self.work.assemblies += 1;
        if self.inertia.count(self.matrix.matrix(), &mut self.work).negative == 0 {
            return LargestStep::Every;
        }
        // From the sure bound down by ever larger factors until one is refused.
        let mut factor = 2.0;
        let mut refused = accepted / factor;
        while self.is_definite(requirement, option, refused) {
            accepted = refused;
            factor *= factor;
            refused /= factor;
            if refused == 0.0 {
                return LargestStep::Every;
            }
        }
        let mut worst = vec![0.0; self.matrix.matrix().dofs().len()];
        let first = self.bound_along_worst(requirement, option, refused, &mut worst);
        let mut margin = first.s / refused - 1.0;
        let mut rounding = first.rounding;
        refused = first.s.min(accepted);
        for _ in 0..LONGEST_SEARCH {
            if accepted / refused - 1.0 <= rounding {
                break;
            }
            // As far above the last bound as that was above the one before, if this at least halves the interval.
            let trial = (refused * (1.0 + margin.max(rounding / 2.0))).min((refused * accepted).sqrt());
            if trial <= refused || trial >= accepted {
                break;
            }
            if self.is_definite(requirement, option, trial) {
                accepted = trial;
                margin /= 16.0;
            } else {
                let bound = self.bound_along_worst(requirement, option, trial, &mut worst);
                let reached = if bound.s < accepted { bound.s } else { trial };
                margin = reached / refused - 1.0;
                rounding = bound.rounding;
                refused = reached;
            }
        }
        LargestStep::UpTo { dt: 1.0 / accepted, refused: 1.0 / refused }
    }

    /// The oracle: whether P(s) has a Cholesky factorization.
    fn is_definite(&mut self, requirement: Requirement, option: Stiffness, s: f64) -> bool {
        self.family.set(requirement, option, s);
        self.matrix.refill(self.family.operator());
        self.work.assemblies += 1;
        self.work.factorizations += 1;
        self.factorization.factor(self.matrix.matrix()).is_ok() && self.factorization.is_positive()
    }

    /// After a refusal at s: a better lower bound for s*, from directions in which P(s) curves downwards.
    fn bound_along_worst(&mut self, requirement: Requirement, option: Stiffness, s: f64, u: &mut [f64]) -> Bound {
        let norm = self.matrix.matrix().norm_inf(u);
        let mut best = Bound { s, rounding: 4.0 * f64::EPSILON };
        if !self.factorization.negative_direction(u) {
            return best;
        }
        for iteration in 0..=INVERSE_ITERATIONS {
            if iteration > 0 {
                self.factorization.solve_in_place(u);
                self.work.solves += 1;
            }
            let length = dot(u, u).sqrt();
            u.iter_mut().for_each(|u| *u /= length);
            let curvature = self.family.curvature(requirement, option, u);
            if let Some(root) = curvature.root().filter(|&root| root >= best.s) {
                let slope = 2.0 * curvature.mass * root * root + curvature.damping * root;
                best = Bound { s: root, rounding: 2.0 * f64::EPSILON * (2.0 + norm / slope) };
            }
        }
        best
    }
}

/// A lower bound for s*, and how finely the oracle can tell near it, relatively.
struct Bound {
    s: f64,
    rounding: f64,
}
