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
//! `uᵀP(s)u` grows with s for every u, so the s for which P is positive definite are an interval `(s*, ∞)`, and the largest step is `dt* = 1/s*`;
//! where C itself is positive semidefinite every step will do.
//!
//! **The matrix S.** Linearised at an equilibrium, a step of linearised backward Euler obeys
//! `M(x₊ − 2x + x₋)/dt² − G(x₊ − x)/dt − K_opt(x₊ − x) − K x = 0`. With `x₊ = z x`, `x₋ = x/z` and the scalars `a = uᵀMu/dt²`,
//! `c = −uᵀGu/dt − uᵀK_opt u`, `κ = −uᵀKu` of a mode u this is `(a + c) z² + (κ − c − 2a) z + a = 0`. Both roots lie in the unit disc (Jury) iff
//! `a + c > 0`, `c ≥ 0`, `κ ≥ 0`, and the polynomial at z = −1 is not negative: `4a + 2c − κ ≥ 0`, which is `uᵀSu ≥ 0`. Under `Full` c ≥ κ, and under
//! `Tension` the same holds for stretched springs: S adds nothing. Under `Axial` the stretched springs' transverse modes are left to the old
//! positions, as in symplectic Euler, and S demands `dt ≤ 2/ω`.
//!
//! **An unstable equilibrium** (κ < 0 for some u) has a motion that grows, whatever the method: one root is real and above 1, and S says that the
//! others stay in the disc. At other states both properties hold for the motion relative to the trajectory, as long as springs change little.
//!
//! **The search.** A factorization `P = L D Lᵀ` with D > 0 proves P definite, to rounding. Along any u the scalar quadratic `uᵀP(s)u` has a root that
//! is a lower bound for s*, short of it by the square of the error of u: the lowest Ritz vector of `M⁻¹C`, then the lowest eigenvector of the pencil
//! (P(s₀), M) of an accepted s₀, by Lanczos with the factor at hand (with damping this is Newton's iteration for a hyperbolic quadratic pencil), or
//! the `u = L⁻ᵀe_j` of a refused factorization. The next trial lies above the bound by its estimated error, and no farther than halfway to the
//! accepted s. The interval ends at the oracle's own rounding, a relative width of `4u + 4u‖P‖/(s d(uᵀPu)/ds)` for `‖u‖ = 1`.

use super::inertia::{InertiaCounter, largest_at_particle};
use super::oracle::Oracle;
use crate::eigen::{BlockLanczos, End, Search, Tolerance, probe, product, scaled_products};
use crate::error::Result;
use crate::force::{DegenerateSpring, SpringGeometry};
use crate::linear::{SOLVE_COLUMNS, dot};
use crate::operator::{Combination, SystemOperator, negative_part};
use crate::spring::{SpringBlock, Stiffness};
use crate::system::{State, System};
use crate::work::Work;
use faer::Par;

/// A property that a step keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Property {
    /// A is positive definite.
    Definite,
    /// A is positive definite and linearised backward Euler adds no instability of its own: S is positive semidefinite.
    Stable,
}

impl Property {
    /// μ and γ, the factors of `s² M` and of `−s G`.
    fn factors(self) -> [f64; 2] {
        match self {
            Self::Definite => [1.0, 1.0],
            Self::Stable => [4.0, 2.0],
        }
    }
}

/// P(s) of a system at one state, as an operator.
pub(super) struct MatrixPencil<'s> {
    pub property: Property,
    pub option: Stiffness,
    pub system: &'s System,
    pub extensions: SpringGeometry,
    pub operator: SystemOperator<'s>,
    /// G, for the curvature along a vector.
    damping: SystemOperator<'s>,
    /// m of every degree of freedom, in kg.
    masses: Vec<f64>,
}

impl<'s> MatrixPencil<'s> {
    pub fn new(system: &'s System, extensions: SpringGeometry, property: Property, option: Stiffness) -> Self {
        let operator = |combination| SystemOperator::new(system, &extensions, Stiffness::Full, combination);
        let (damping, operator) = (operator(Combination::DAMPING), operator(Combination::STIFFNESS));
        let masses = system.dofs().iter().map(|dof| system.masses()[dof.particle]).collect();
        Self { property, option, system, damping, operator, extensions, masses }
    }

    /// Moves to another state of the same system.
    ///
    /// # Errors
    /// Coincident ends of a spring.
    pub fn update(&mut self, state: &State) -> Result<(), DegenerateSpring> {
        self.extensions.update(self.system, state)?;
        self.damping.update(&self.extensions, Stiffness::Full, Combination::DAMPING);
        Ok(())
    }

    pub fn set(&mut self, s: f64) {
        let Self { property, option, .. } = *self;
        let [mu, gamma] = property.factors();
        let (mass, damping) = (mu * s * s, gamma * s);
        self.operator.set_external(&self.extensions, |at| {
            let dropped = -if option == Stiffness::Full { at.stiffness } else { negative_part(&at.stiffness) };
            let stiffness = match property {
                Property::Definite => dropped,
                Property::Stable => dropped * 2.0 + at.stiffness,
            };
            stiffness - at.damping * damping
        });
        self.operator.set_blocks(&self.extensions, mass, |_, spring, at| {
            let dropped = spring.stiffness_block(at, option);
            let stiffness = match property {
                Property::Definite => dropped,
                Property::Stable => dropped * 2.0 + spring.stiffness_block(at, Stiffness::Full) * -1.0,
            };
            stiffness + spring.damping_block(at) * damping
        });
    }

    /// The coefficients of s², s and 1 in `uᵀP(s)u`. Leaves the operator at s = 0.
    fn curvature(&mut self, u: &[f64]) -> [f64; 3] {
        let damping = -dot(u, &product(&self.damping, u));
        self.set(0.0);
        let constant = dot(u, &product(&self.operator, u));
        let [mu, gamma] = self.property.factors();
        [mu * self.kinetic(u), gamma * damping, constant]
    }

    /// `uᵀMu`.
    fn kinetic(&self, u: &[f64]) -> f64 {
        u.iter().zip(&self.masses).map(|(u, mass)| mass * u * u).sum()
    }

    /// The lowest Ritz vector of `M⁻¹C` from sixty products; expects the operator at s = 0.
    fn lowest_direction(&self) -> Option<Vec<f64>> {
        let masses = Some(&self.masses[..]);
        let ends = probe(self.masses.len(), masses, 60, &mut scaled_products(&self.operator, masses));
        ends.map(|[low, _]| low.vector)
    }

    /// `‖M^{-1/2} P(s) u‖/(2 s² ‖M^{1/2} u‖)`, at the s of the operator: about the relative distance of the root along u from the s at which P is
    /// singular, without damping.
    fn residual(&self, u: &[f64]) -> f64 {
        let left: f64 = product(&self.operator, u).iter().zip(&self.masses).map(|(p, mass)| p * p / mass).sum();
        0.5 * left.sqrt() / (self.operator.mass_factor() * self.kinetic(u).sqrt())
    }

    /// A bound for ‖P(s)‖: the largest sum of `μ s² m_i` and twice the norms of the blocks at a free particle. Expects the operator at s = 0, so that
    /// damping is left out.
    fn norm_bound(&self, s: f64) -> f64 {
        let norm = |block: &SpringBlock, _| 2.0 * block.transverse.abs().max(block.axial.abs());
        let [mu, _] = self.property.factors();
        let inertia = |mass: f64| mu * s * s * mass;
        largest_at_particle(&self.operator, inertia, |block| block.norm(), norm, |sum, _| sum)
    }

    /// An s at which P is positive definite for certain; expects the operator at s = 0.
    ///
    /// A spring with the lowest eigenvalue −c takes at most `c‖u_i − u_j‖² ≤ 2c(‖u_i‖² + ‖u_j‖²)` from uᵀPu, and only `c‖u_i‖²` where j is held. So
    /// `μ s² m_i > Σ 2c` over the springs at every particle i is enough.
    fn surely_definite(&self) -> f64 {
        let taken = |block: &SpringBlock, is_free: bool| (-block.lowest()).max(0.0) * if is_free { 2.0 } else { 1.0 };
        let external = |block: &nalgebra::Matrix3<f64>| block.symmetric_eigenvalues().min().min(0.0).abs();
        let largest = largest_at_particle(&self.operator, |_| 0.0, external, taken, |sum, mass| sum / mass);
        // A little above, so that rounding does not make the factorization fail there.
        (largest / self.property.factors()[0]).sqrt() * (1.0 + 1e-6)
    }
}

/// The largest step that keeps a property.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LargestStep {
    /// Every step keeps it.
    Every,
    /// Steps up to a limit keep it.
    UpTo {
        /// The longest step at which a factorization proved it, in s.
        dt: f64,
        /// A longer step at which it is lost, by a factorization that refused or a direction of negative curvature, in s; as near to `dt` as rounding
        /// allows.
        refused: f64,
    },
    /// Not computed.
    Unknown,
}

impl LargestStep {
    /// The step, in s; `None` without a limit, or where it is unknown.
    pub fn dt(&self) -> Option<f64> {
        if let Self::UpTo { dt, .. } = *self { Some(dt) } else { None }
    }
}

/// Finds critical steps of a system, on one symbolic analysis.
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
    pub(super) pencil: MatrixPencil<'s>,
    oracle: Oracle,
    inertia: InertiaCounter,
    /// The work of the searches.
    pub work: Work,
}

#[derive(Debug, Clone, Default)]
pub(super) struct Facts {
    /// C has negative eigenvalues; `None` where not counted.
    pub curves_downwards: Option<bool>,
    /// A direction, not necessarily a good one.
    pub direction: Option<Vec<f64>>,
    /// An s at which P is positive definite, proven.
    pub definite_from: Option<f64>,
}

impl<'s> CriticalSteps<'s> {
    /// At a state.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large.
    pub fn new(system: &'s System, state: &State, par: Par) -> Result<Self> {
        let mut work = Work::default();
        let oracle = Oracle::analyse(system, par, &mut work)?;
        Ok(Self { work, ..Self::analysed(system, SpringGeometry::at(system, state)?, oracle)? })
    }

    /// As [`new`](Self::new), with an analysed pattern.
    pub(super) fn analysed(system: &'s System, extensions: SpringGeometry, oracle: Oracle) -> Result<Self> {
        let pencil = MatrixPencil::new(system, extensions, Property::Definite, Stiffness::Full);
        let inertia = InertiaCounter::sharing(&oracle.factorization)?;
        Ok(Self { pencil, oracle, inertia, work: Work::default() })
    }

    /// The largest step that keeps a property under an option, certified by factorizations on both sides.
    pub fn largest_step(&mut self, property: Property, option: Stiffness) -> LargestStep {
        // Under `Full` S(s) is A(2s): semidefinite as far as A is, and beyond. Else A is positive definite for every s.
        let property = if option == Stiffness::Full { Property::Definite } else { property };
        self.search(property, option, Facts::default())
    }

    pub(super) fn search(&mut self, property: Property, option: Stiffness, known: Facts) -> LargestStep {
        if known.curves_downwards == Some(false) {
            return LargestStep::Every;
        }
        (self.pencil.property, self.pencil.option) = (property, option);
        self.pencil.set(0.0);
        // Blocks that are all positive semidefinite, to the rounding of lengths, decide it without a factorization.
        let rounding = 16.0 * f64::EPSILON;
        let is_none = |block: &SpringBlock| block.lowest() >= -rounding * block.transverse.abs().max(block.axial.abs());
        if self.pencil.operator.blocks().iter().all(is_none) {
            return LargestStep::Every;
        }
        let mut accepted = self.pencil.surely_definite().min(known.definite_from.unwrap_or(f64::INFINITY));
        let mut bound = Bound { s: 0.0, rounding: 4.0 * f64::EPSILON };
        let mut u = known.direction.unwrap_or_default();
        let is_near = !u.is_empty() && self.raise(&mut bound, &u) && self.shortfall(bound, &u) <= 1e-2;
        if !is_near {
            self.pencil.set(0.0);
            let lowest = self.pencil.lowest_direction().unwrap_or_else(|| vec![0.0; self.pencil.masses.len()]);
            if self.raise(&mut bound, &lowest) || u.is_empty() {
                u = lowest;
            }
        }
        if bound.s == 0.0 && known.curves_downwards != Some(true) && !self.curves_downwards() {
            return LargestStep::Every;
        }
        let mut margin = self.shortfall(bound, &u);
        for _ in 0..100 {
            // Rounding may lift a root above an accepted s.
            bound.s = bound.s.min(accepted);
            if accepted / bound.s - 1.0 <= bound.rounding {
                break;
            }
            let trial = match bound.s > 0.0 {
                true => (bound.s * (1.0 + margin.max(bound.rounding / 2.0))).min((bound.s * accepted).sqrt()),
                false => accepted / 16.0,
            };
            if trial == 0.0 {
                return LargestStep::Every;
            }
            if trial <= bound.s || trial >= accepted {
                break;
            }
            if self.is_definite(trial) {
                accepted = trial;
                if accepted / bound.s - 1.0 <= bound.rounding {
                    break;
                }
                u = self.improved(&u);
                self.raise(&mut bound, &u);
                let width = (accepted / bound.s - 1.0).max(0.0);
                margin = self.shortfall(bound, &u).min(1e-3 * width);
            } else {
                bound.s = trial;
                let mut worst = vec![0.0; u.len()];
                if self.oracle.factorization.negative_direction(&mut worst) && self.raise(&mut bound, &worst) {
                    u = worst;
                    margin = self.shortfall(bound, &u);
                } else {
                    margin = 8.0 * margin.max(bound.rounding / 2.0);
                }
            }
        }
        LargestStep::UpTo { dt: 1.0 / accepted, refused: 1.0 / bound.s }
    }

    /// About the lowest eigenvector of the pencil (P(s), M), with the P(s) that is factored, from a direction near it.
    fn improved(&mut self, u: &[f64]) -> Vec<f64> {
        let Self { pencil, oracle, work, .. } = self;
        let (n, masses) = (u.len(), &pencil.masses[..]);
        let mut solve = |x: &[f64], y: &mut [f64]| {
            work.solves += (x.len() / n) as u64;
            for (x, y) in x.chunks(n).zip(y.chunks_mut(n)) {
                y.iter_mut().zip(x).zip(masses).for_each(|((y, x), mass)| *y = mass * x);
            }
            oracle.factorization.substitute_columns(n, y);
        };
        let search = Search::new(End::Highest, 1, SOLVE_COLUMNS);
        let mut space = BlockLanczos::from(n, Some(masses), search, 1, [u], &mut solve);
        let tolerance = Tolerance { of_value: 0.0, of_norm: 1e-10 };
        let found = space.iterate(tolerance, 12, &mut solve, None);
        found.into_iter().next().map_or_else(|| u.to_vec(), |pair| pair.image)
    }

    /// The estimated relative distance of the bound along u from s*.
    fn shortfall(&mut self, bound: Bound, u: &[f64]) -> f64 {
        self.pencil.set(bound.s);
        self.pencil.residual(u)
    }

    fn is_definite(&mut self, s: f64) -> bool {
        self.pencil.set(s);
        self.oracle.is_definite(&self.pencil.operator, &mut self.work)
    }

    pub(super) fn curves_downwards(&mut self) -> bool {
        self.pencil.set(0.0);
        self.oracle.matrix.refill(&self.pencil.operator);
        self.work.assemblies += 1;
        self.inertia.count(self.oracle.matrix.matrix(), &mut self.work).negative > 0
    }

    /// Raises the bound to the root along u; returns `false` where that is not higher.
    pub(super) fn raise(&mut self, bound: &mut Bound, u: &[f64]) -> bool {
        let [mass, damping, constant] = self.pencil.curvature(u);
        let discriminant = damping * damping - 4.0 * mass * constant;
        // The form without cancellation, as damping ≥ 0; without a negative constant there is no root.
        let root = -2.0 * constant / (damping + discriminant.sqrt());
        let is_higher = constant < 0.0 && root.is_finite() && root > bound.s;
        if is_higher {
            let slope = (2.0 * mass * root + damping) * root;
            let norm = self.pencil.norm_bound(root) * dot(u, u);
            *bound = Bound { s: root, rounding: 2.0 * f64::EPSILON * (2.0 + norm / slope) };
        }
        is_higher
    }
}

/// A lower bound for s*, and the relative resolution of the oracle near it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bound {
    pub s: f64,
    pub rounding: f64,
}
