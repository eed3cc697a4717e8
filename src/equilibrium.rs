//! Static equilibria, found as minima of the potential energy, and load paths through them.
//!
//! [`equilibrium`] searches downhill from a state; [`load_path`] follows the equilibrium as gravity and loads grow from zero. Both solve, on
//! the free coordinates and for a load factor λ (1 by default),
//!
//! ```text
//! f_el(x) + λ (M g + f_ext) = 0,      E(x) = Σ ½ k (l − l0)²/l0 − λ Σ (m g + f)·x.
//! ```
//!
//! The result is classified by the signs of the eigenvalues of −K: stable, a saddle, free to move, or no equilibrium.
//!
//! **Newton's method** with `−K(x) p = f` and a non-monotone line search on E. Where −K is not positive definite, that step alone is solved with option
//! *tension*, without the transverse terms of compressed springs, or near an equilibrium with −K shifted.
//!
//! **Differences of E** are sums of rounding errors near the minimum. There the trapezoidal rule `−½ (f(x) + f(x + p))·p`, exact to third order in p,
//! has no cancellation and takes over.
//!
//! **Large scenes**, whose factor would take too long or too much memory, are searched by conjugate gradients with multigrid (`iterative`).
//!
//! **The verdict** is the inertia of −K at the end: negative eigenvalues make a saddle, from which the search goes on along the lowest mode; eigenvalues of
//! zero leave the scene free to move. A body that no support holds against a load has no equilibrium; it is found before the search.
//!
//! **Gradient.** For a cost J with `∂J/∂x = x̄` at the equilibrium, `−K λ = x̄` and `dJ/dp = λᵀ ∂f/∂p` for a parameter p (implicit function theorem).

mod factored;
mod iterative;
mod load_path;

pub use load_path::{CriticalKind, CriticalLoad, LoadPath, load_path};

use crate::assembly::SymmetricMatrix;
use crate::eigen::{Accuracy, Pencil, ShiftInvert};
use crate::error::{Error, Invalid, Result, check_length};
use crate::force::{Energy, SpringGeometry, add_elastic_force};
use crate::gradient::{Parameters, Point};
use crate::integrate::{Matrices, Projection, StiffnessPolicy};
use crate::linear::{Cholesky, Ldlt, dot};
use crate::modes::loads_at_rest;
use crate::operator::LinearOperator;
use crate::rigid::bodies;
use crate::spring::{Spring, Stiffness};
use crate::system::{Axes, State, System};
use crate::work::Work;
use iterative::Iterative;
use nalgebra::Vector3;
use std::collections::VecDeque;

/// How an equilibrium is searched for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EquilibriumOptions {
    /// The largest force left over the largest force that acts, at most.
    pub tolerance: f64,
    /// Newton steps at most.
    pub iterations: usize,
    /// The factor λ of gravity and loads.
    pub load: f64,
    /// Whether the search goes on from a saddle.
    pub leave_saddles: bool,
    /// The matrix of a step far from an equilibrium, where −K is not positive definite. Without a factorization `Progressive` is `OnDemand`.
    pub stiffness: StiffnessPolicy,
}

impl Default for EquilibriumOptions {
    fn default() -> Self {
        Self {
            tolerance: 1e-10,
            iterations: 2000,
            load: 1.0,
            leave_saddles: true,
            stiffness: StiffnessPolicy::OnDemand,
        }
    }
}

/// The kind of an equilibrium.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stability {
    /// A minimum of the energy: −K is positive definite.
    Stable,
    /// −K has eigenvalues of zero and none below: the scene can move freely.
    Indifferent,
    /// A saddle: −K has negative eigenvalues.
    Unstable,
    /// There is none: a body falls.
    None,
    /// None was found within the iterations.
    NotConverged,
}

impl Stability {
    /// As in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stable => "stable",
            Self::Indifferent => "indifferent",
            Self::Unstable => "unstable",
            Self::None => "none",
            Self::NotConverged => "not-converged",
        }
    }
}

/// Numbers of eigenvalues by their signs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Signs {
    /// Below zero.
    pub negative: usize,
    /// Within rounding, and what the force that is left may change, of zero.
    pub zero: usize,
    /// Above zero.
    pub positive: usize,
}

/// Where a search for an equilibrium ended.
#[derive(Debug, Clone)]
pub struct Equilibrium {
    /// The kind.
    pub stability: Stability,
    /// The last configuration, at rest.
    pub state: State,
    /// λ, the factor of gravity and loads.
    pub load: f64,
    /// The largest force left on a free coordinate over the largest force that acts; where next to nothing acts, over what strains by rounding exert,
    /// times 1e11.
    pub residual: f64,
    /// E, in J, of all springs, those between held particles included, weight and constant loads.
    pub energy: f64,
    /// Newton steps.
    pub iterations: usize,
    /// Of −K at the end.
    pub inertia: Signs,
    /// Whether the inertia was counted, by a factorization. Where that would take too long or too much memory, the lowest eigenvalues that a search finds
    /// stand for it.
    pub counted: bool,
    /// The lowest eigenvalue of −K with its direction over the free degrees of freedom, where that is not positive.
    pub lowest: Option<(f64, Vec<f64>)>,
    /// Particles of bodies that nothing holds against their load.
    pub falling: Vec<usize>,
    /// Factorizations, solves and what else was done.
    pub work: Work,
}

/// The equilibrium that is reached downhill from a state.
///
/// # Errors
/// A state of another system; coincident ends of a spring at the start; a matrix that is too large to factor; options that cannot be used.
///
/// # Examples
/// ```
/// use sprung::equilibrium::{EquilibriumOptions, Stability, equilibrium};
/// use sprung::{Spring, SystemBuilder};
///
/// // 2 kg on a spring of 100 N, 1 m long: stretched to 1 + 2·9.81/100 m.
/// let mut builder = SystemBuilder::new();
/// builder.gravity(0.0, -9.81, 0.0);
/// builder.particle([0.0, 0.0, 0.0], 1.0);
/// builder.particle([0.6, -0.8, 0.0], 2.0);
/// builder.spring(0, 1, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
/// builder.hold(0);
/// let (system, state) = builder.build()?;
/// let found = equilibrium(&system, &state, EquilibriumOptions::default())?;
/// assert_eq!(found.stability, Stability::Stable);
/// assert!((found.state.positions[1].y + 1.1962).abs() < 1e-10);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn equilibrium(system: &System, state: &State, options: EquilibriumOptions) -> Result<Equilibrium> {
    let is_fraction = |value: f64| value > 0.0 && value < 1.0;
    if !is_fraction(options.tolerance) {
        return Err(Invalid::new("tolerance", options.tolerance, "must be between 0 and 1").into());
    }
    if !options.load.is_finite() {
        return Err(Invalid::new("load", options.load, "must be finite").into());
    }
    if system.external_forces().next().is_some() {
        return Err(Error::Unsupported(
            "the search for an equilibrium needs potential energies, and external forces given as functions have none"
                .into(),
        ));
    }
    let mut search = Search::new(system, state, options)?;
    search.falling = falling(system, &search.state, options.load);
    if search.falling.is_empty() { search.run() } else { search.end(Stability::None) }
}

/// Particles of bodies with an unsupported axis along which loads do not cancel.
fn falling(system: &System, state: &State, load: f64) -> Vec<usize> {
    let forces = loads(system, state, load);
    let mut found = Vec::new();
    for body in bodies(system) {
        let members = || body.particles.iter().chain(&body.anchors);
        let falls = (0..system.dimension()).any(|axis| {
            let is_free = members().all(|&p| system.dofs().free_axes(p).contains(axis));
            let [sum, size] = body
                .particles
                .iter()
                .fold([0.0, 0.0], |[sum, size], &p| [sum + forces[p][axis], size + forces[p][axis].abs()]);
            is_free && sum.abs() > 1e-12 * size
        });
        if falls {
            found.extend(&body.particles);
        }
    }
    found
}

/// Weight and loads on every particle at rest, times a factor, in N.
fn loads(system: &System, state: &State, factor: f64) -> Vec<Vector3<f64>> {
    let mut forces = loads_at_rest(system, state);
    forces.iter_mut().for_each(|f| *f *= factor);
    forces
}

/// Sufficient decrease of E: the part of the slope that counts (Nocedal and Wright, Numerical Optimization, 3.1).
const ARMIJO: f64 = 1e-4;

/// Steps whose largest E is to be undercut (Grippo, Lampariello and Lucidi, SIAM J. Numer. Anal. 23, 1986): a long step that turns springs stretches them
/// to second order, which the next step undoes.
const MEMORY: usize = 10;

/// A shift that is rounding, as a part of ‖K‖.
const SINGULAR: f64 = 1e-10;

/// The residual below which a search is near an equilibrium.
const NEAR: f64 = 1e-3;

/// Shifted steps in a row that have to halve the residual.
const PATIENCE: usize = 20;

const HALVINGS: usize = 50;

/// Part of the terms of E below which its differences are taken from forces: far above rounding, far below what the rule neglects.
const CANCELLED: f64 = 1e-9;

/// Rounding of positions makes at least this residual: where nothing is strained nothing acts, and what is left is compared with rounding over this.
const ROUNDING: f64 = 1e-11;

/// An eigenvalue of −K counts as zero up to this part of ‖K‖.
const ZERO: f64 = 1e-11;

const SADDLES: usize = 50;

/// The solver for directions of Newton's method.
enum Solver {
    Factored(Box<Cholesky>),
    Iterative(Box<Iterative>),
}

struct Search<'s> {
    system: &'s System,
    options: EquilibriumOptions,
    matrices: Matrices<'s>,
    solver: Solver,
    projection: Projection,
    state: State,
    geometry: SpringGeometry,
    loads: Vec<Vector3<f64>>,
    /// Net forces on the free coordinates, and the largest force that acts.
    force: Vec<f64>,
    acting: f64,
    rounding: [f64; 2],
    /// E without the springs between held particles, whose part is constant.
    energy: f64,
    /// A body has rigid motions.
    is_free: bool,
    /// The last σ, in N/m.
    shift: f64,
    /// E before the last steps, at most [`MEMORY`].
    recent: VecDeque<f64>,
    iterations: usize,
    saddles: usize,
    falling: Vec<usize>,
    lowest: Option<(f64, Vec<f64>)>,
    work: Work,
}

impl<'s> Search<'s> {
    fn new(system: &'s System, state: &State, options: EquilibriumOptions) -> Result<Self> {
        state.check(system)?;
        let mut state = state.clone();
        state.velocities.fill(Vector3::zeros());
        let is_free = bodies(system).iter().any(|body| !body.rigid_motions(system, &state.positions).is_empty());
        let geometry = SpringGeometry::at(system, &state)?;
        let matrices = Matrices::new(system)?;
        let work = Work { symbolic_factorizations: 1, ..Work::default() };
        let mut search = Self {
            solver: Solver::new(system, matrices.k())?,
            loads: loads(system, &state, options.load),
            force: vec![0.0; system.dofs().len()],
            projection: Projection::new(system),
            system,
            options,
            matrices,
            state,
            geometry,
            acting: 0.0,
            rounding: [0.0; 2],
            energy: 0.0,
            is_free,
            shift: 0.0,
            recent: VecDeque::new(),
            iterations: 0,
            saddles: 0,
            falling: Vec::new(),
            lowest: None,
            work,
        };
        search.rounding = search.rounding();
        search.evaluate();
        Ok(search)
    }

    /// Forces and E at the positions of `geometry`.
    fn evaluate(&mut self) {
        let Self { system, geometry, loads, state, .. } = self;
        self.work.force_evaluations += 1;
        let largest = |forces: &[Vector3<f64>]| forces.iter().fold(0.0f64, |largest, f| largest.max(f.amax()));
        let mut forces = vec![Vector3::zeros(); system.particles()];
        add_elastic_force(system, geometry, &mut forces);
        let tension = geometry.springs(system).map(|((_, _, spring), at)| spring.elastic_force(at).norm());
        self.acting = tension.fold(largest(loads).max(self.rounding[0] / ROUNDING), f64::max);
        forces.iter_mut().zip(loads.iter()).for_each(|(f, load)| *f += load);
        system.dofs().gather(&forces, &mut self.force);
        let elastic: f64 =
            geometry.springs(system).map(|((number, ..), at)| system.elastic_energy(number, at, state.time)).sum();
        self.energy = elastic - self.work_of_loads();
    }

    /// `Σ f·x` of weight and loads.
    fn work_of_loads(&self) -> f64 {
        self.loads.iter().zip(&self.state.positions).map(|(f, x)| f.dot(x)).sum()
    }

    /// The forces that rounding of positions makes, `u k/l0 ‖x‖` of a spring's farther end: of one spring, and of all springs of a particle. No search
    /// gets below these.
    fn rounding(&self) -> [f64; 2] {
        let (mut largest, mut sums) = (0.0f64, vec![0.0; self.system.particles()]);
        for ((_, ends, spring), _) in self.geometry.springs(self.system) {
            let farther = ends.iter().fold(0.0f64, |farther, &end| farther.max(self.state.positions[end].amax()));
            let force = spring.axial_stiffness() * farther * f64::EPSILON;
            largest = largest.max(force);
            ends.iter().for_each(|&end| sums[end] += force);
        }
        [largest, sums.into_iter().fold(0.0, f64::max)]
    }

    /// The largest sum of k/l0 at a particle, in N/m.
    fn stiffness(&self) -> f64 {
        let mut sums = vec![0.0; self.system.particles()];
        for ((_, ends, spring), _) in self.geometry.springs(self.system) {
            ends.iter().for_each(|&end| sums[end] += spring.axial_stiffness());
        }
        sums.into_iter().fold(0.0, f64::max)
    }

    /// The largest force left on a free coordinate, in N.
    fn left(&self) -> f64 {
        self.force.iter().fold(0.0f64, |largest, f| largest.max(f.abs()))
    }

    fn residual(&self) -> f64 {
        let left = self.left();
        if left == 0.0 { 0.0 } else { left / self.acting }
    }

    /// A tolerance that rounding does not let it reach gives way to rounding, up to the default.
    fn has_converged(&self) -> bool {
        let is_rounding = self.left() <= self.rounding[1];
        let tolerance = self.options.tolerance;
        self.residual() <= if is_rounding { tolerance.max(EquilibriumOptions::default().tolerance) } else { tolerance }
    }

    fn run(mut self) -> Result<Equilibrium> {
        loop {
            let (mut shifted, mut before) = (0, f64::INFINITY);
            while !self.has_converged() {
                if self.iterations == self.options.iterations {
                    return self.end(Stability::NotConverged);
                }
                self.iterations += 1;
                let (step, is_shifted) = match self.solver {
                    Solver::Factored(_) => self.factored_step()?,
                    Solver::Iterative(_) => self.iterative_step(),
                };
                if !self.line_search(&step) {
                    return self.end(Stability::NotConverged);
                }
                // A direction of negative curvature along which no force acts keeps σ large.
                shifted = if is_shifted { shifted + 1 } else { 0 };
                if shifted == PATIENCE {
                    let is_slow = self.residual() > 0.5 * before;
                    (shifted, before) = (0, self.residual());
                    if self.options.leave_saddles
                        && is_slow
                        && let Some(direction) = self.unstable_direction(false)?
                    {
                        self.leave(&direction);
                    }
                }
            }
            // One more step, at full length, takes the residual to rounding.
            self.polish()?;
            let Some(direction) = self.unstable_direction(true)? else {
                let inertia = self.inertia(true)?;
                let stability = if inertia.zero > 0 { Stability::Indifferent } else { Stability::Stable };
                return Ok(self.ended(stability, inertia));
            };
            self.saddles += 1;
            if !self.options.leave_saddles || self.saddles > SADDLES || !self.leave(&direction) {
                return self.end(Stability::Unstable);
            }
        }
    }

    /// Moves along a step until E is low enough; false where no length does.
    fn line_search(&mut self, step: &[f64]) -> bool {
        let slope = dot(&self.force, step);
        if !(slope > 0.0 && slope.is_finite()) {
            return false;
        }
        let (start, force, size) = (self.state.positions.clone(), self.force.clone(), self.size());
        self.recent.truncate(MEMORY - 1);
        self.recent.push_front(self.energy);
        let highest = self.recent.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        // No particle moves farther than the scene is large.
        let longest = step.iter().fold(0.0f64, |longest, u| longest.max(u.abs()));
        let mut length = (size / longest).min(1.0);
        for _ in 0..HALVINGS {
            if self.place(&start, length, step) {
                let exact = self.energy - highest;
                let by_forces = -0.5 * length * (dot(&force, step) + dot(&self.force, step));
                let change = if exact.abs() > CANCELLED * self.terms() { exact } else { by_forces };
                if change <= -ARMIJO * length * slope {
                    return true;
                }
            }
            length *= 0.5;
        }
        self.place(&start, 0.0, step);
        false
    }

    /// Sets positions to `start + length · step`; false where springs have no direction or numbers overflow there.
    fn place(&mut self, start: &[Vector3<f64>], length: f64, step: &[f64]) -> bool {
        let dofs = self.system.dofs();
        for (p, (x, from)) in self.state.positions.iter_mut().zip(start).enumerate() {
            *x = from + dofs.get(step, p) * length;
        }
        if self.geometry.update(self.system, &self.state).is_err() {
            return false;
        }
        self.evaluate();
        self.energy.is_finite()
    }

    /// The size of the terms of E.
    fn terms(&self) -> f64 {
        let loads = self.loads.iter().zip(&self.state.positions).map(|(f, x)| f.dot(x).abs()).sum::<f64>();
        loads + self.energy.abs()
    }

    /// A length of the problem: the largest extent along an axis, and at least the longest spring, taut or not, and the farthest that the load of a
    /// particle stretches the springs there. A scene that has shrunk to a point still has the last two.
    fn size(&self) -> f64 {
        let positions = &self.state.positions;
        let extent = |axis: usize| {
            let range = positions
                .iter()
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x[axis]), high.max(x[axis])]);
            range[1] - range[0]
        };
        let mut stiffness = vec![0.0; positions.len()];
        let mut size = (0..3).map(extent).fold(0.0, f64::max);
        for ((number, ends, _), at) in self.geometry.springs(self.system) {
            // Its own parameters: those of a slack spring are zero.
            let spring = self.system.spring_then(number, self.state.time);
            size = size.max(at.length).max(spring.rest_length);
            ends.iter().for_each(|&end| stiffness[end] += spring.axial_stiffness());
        }
        let stretched = self
            .loads
            .iter()
            .zip(&stiffness)
            .enumerate()
            .filter(|(p, (_, stiffness))| **stiffness > 0.0 && self.system.dofs().free_axes(*p) != Axes::NONE);
        stretched.map(|(_, (load, stiffness))| load.amax() / stiffness).fold(size, f64::max)
    }

    /// One Newton step at full length, kept where it lowers the residual.
    fn polish(&mut self) -> Result<()> {
        if self.residual() == 0.0 {
            return Ok(());
        }
        let a = self.assemble(Stiffness::Full)?;
        let (start, before) = (self.state.positions.clone(), self.residual());
        if self.factor(&a) {
            let step = self.solve();
            if !self.place(&start, 1.0, &step) || self.residual() >= before {
                self.place(&start, 0.0, &step);
            }
        }
        Ok(())
    }

    fn inertia(&mut self, is_at_rest: bool) -> Result<Signs> {
        let a = self.assemble(Stiffness::Full)?;
        let band = self.zero_band(&a, is_at_rest);
        let order = a.order();
        if order == 0 {
            return Ok(Signs::default());
        }
        let Solver::Factored(cholesky) = &self.solver else { return self.signs_found(&a, band) };
        let mut factorization = Ldlt::sharing(cholesky)?;
        let mut counts = ShiftInvert::new(Pencil::of(&a), &mut factorization, &mut self.work);
        // A pivot that vanishes at one shift does not at another; what cannot be counted is not told from zero.
        let mut below = |shift: f64| (0..8).find_map(|k| counts.below(shift * (1.0 + 0.01 * f64::from(k))));
        let (negative, not_positive) = (below(-band).unwrap_or(0), below(band).unwrap_or(order));
        Ok(Signs { negative, zero: not_positive.saturating_sub(negative), positive: order - not_positive })
    }

    /// Eigenvalues up to this size, in N/m, are zero: rounding, and at an equilibrium what the force that is left may change.
    fn zero_band(&self, a: &SymmetricMatrix, is_at_rest: bool) -> f64 {
        let left = if is_at_rest { self.left() } else { 0.0 };
        // Of those springs whose K depends on their length: neither slack ones nor those without a rest length.
        let turning = |spring: &Spring| spring.rest_length > 0.0 && spring.stiffness != 0.0;
        let lengths = self.geometry.springs(self.system).filter(|((.., spring), _)| turning(spring));
        let shortest = lengths.map(|(_, at)| at.length).fold(f64::INFINITY, f64::min);
        ZERO * Pencil::of(a).norm() + 10.0 * left / shortest
    }

    /// The direction of the lowest eigenvalue of −K, where that is negative, at an equilibrium or on the way to one, where E falls along it however much
    /// force is left.
    fn unstable_direction(&mut self, is_at_rest: bool) -> Result<Option<Vec<f64>>> {
        self.lowest = None;
        let a = self.assemble(Stiffness::Full)?;
        let band = self.zero_band(&a, is_at_rest);
        if a.order() == 0 || self.factor(&a) {
            return Ok(None);
        }
        let lowest = match &self.solver {
            Solver::Factored(cholesky) => {
                let mut factorization = Ldlt::sharing(cholesky)?;
                let mut search = ShiftInvert::new(Pencil::of(&a), &mut factorization, &mut self.work);
                search.lowest(1, Accuracy::CERTIFIED).into_iter().next()
            }
            Solver::Iterative(_) => self.lowest_found(&a)?.into_iter().min_by(|a, b| a.value.total_cmp(&b.value)),
        };
        self.lowest = lowest.filter(|pair| pair.value <= band).map(|pair| (pair.value, pair.vector));
        Ok(self.lowest.clone().filter(|(value, _)| *value < -band).map(|(_, vector)| vector))
    }

    /// Moves off a saddle, along a direction or against it, to where E is lower.
    fn leave(&mut self, direction: &[f64]) -> bool {
        let (start, energy) = (self.state.positions.clone(), self.energy);
        self.recent.clear();
        let longest = direction.iter().fold(0.0f64, |longest, u| longest.max(u.abs()));
        let mut length = 0.1 * self.size() / longest;
        for _ in 0..HALVINGS {
            for sign in [1.0, -1.0] {
                // Of second order in the length, so that short moves are lost in rounding.
                if self.place(&start, sign * length, direction) && self.energy - energy < -f64::EPSILON * self.terms() {
                    return true;
                }
            }
            length *= 0.5;
        }
        self.place(&start, 0.0, direction);
        false
    }

    fn end(mut self, stability: Stability) -> Result<Equilibrium> {
        let is_at_rest = !matches!(stability, Stability::None | Stability::NotConverged);
        let inertia = self.inertia(is_at_rest)?;
        Ok(self.ended(stability, inertia))
    }

    fn ended(self, stability: Stability, inertia: Signs) -> Equilibrium {
        Equilibrium {
            stability,
            load: self.options.load,
            residual: self.residual(),
            energy: Energy::of(self.system, &self.state).elastic - self.work_of_loads(),
            iterations: self.iterations,
            inertia,
            counted: matches!(self.solver, Solver::Factored(_)),
            lowest: self.lowest,
            falling: self.falling,
            work: self.work,
            state: self.state,
        }
    }
}

impl Equilibrium {
    /// The derivatives of a cost by parameters, from its derivatives `∂J/∂x` by the positions at the equilibrium. Of positions, those of held coordinates
    /// count; damping and velocities are zero.
    ///
    /// # Errors
    /// An end that is no isolated equilibrium: −K is singular there; springs with a law of the caller's own; vectors of another length.
    pub fn gradient(&self, system: &System, positions: &[Vector3<f64>]) -> Result<Parameters> {
        check_length("positions", positions.len(), system.particles())?;
        if matches!(self.stability, Stability::None | Stability::NotConverged) || self.inertia.zero > 0 {
            return Err(Error::Unsupported(
                "a gradient needs an isolated equilibrium: −K is singular here, or the search did not arrive".into(),
            ));
        }
        if system.has_other_laws() {
            return Err(Error::Unsupported("gradients are those of the built-in spring law".into()));
        }
        let mut matrices = Matrices::new(system)?;
        matrices.update(&self.state, Stiffness::Full)?;
        let dofs = system.dofs();
        let mut adjoint = vec![0.0; dofs.len()];
        dofs.gather(positions, &mut adjoint);
        if !adjoint.is_empty() {
            let factored = matrices.k().scaled(-1.0).ldlt();
            let solved = factored.map_err(|error| Error::Unsupported(error.to_string()))?.solve(&adjoint)?;
            adjoint = solved;
        }
        let geometry = SpringGeometry::at(system, &self.state)?;
        let mut full = vec![Vector3::zeros(); system.particles()];
        dofs.scatter(&adjoint, &mut full);
        let at_rest = vec![Vector3::zeros(); system.particles()];
        let mut result = Parameters::zeros(system);
        let point = Point { geometry: &geometry, velocities: &at_rest, time: self.state.time };
        let [moved, _] = result.add_force_adjoint(system, &point, &full);
        result.masses.iter_mut().for_each(|m| *m *= self.load);
        result.gravity *= self.load;
        result.loads.iter_mut().for_each(|f| *f *= self.load);
        // Held coordinates move f by their stiffness, and J directly.
        for (p, (moved, direct)) in moved.iter().zip(positions).enumerate() {
            let total = Vector3::from_fn(|axis, _| moved[axis] + direct[axis]);
            result.positions[p] = Axes::ALL.without(dofs.free_axes(p)).project(&total);
        }
        Ok(result)
    }
}

#[cfg(test)]
mod tests;
