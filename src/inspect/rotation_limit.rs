//! How far a step turns springs, and what that does to them: the limit that no linearisation at one state sees.
//!
//! A linearised step moves the ends of a spring along straight lines, by `δ = δx_i − δx_j = δ∥ n + δ⊥`, with `n` the direction
//! at its start. It turns the spring by `θ ≈ ‖δ⊥‖/l`, which is `dt ‖v⊥‖/l` for one in flight, and counts its new length as
//! `l + δ∥`. In truth the spring has become longer than that, by
//!
//! ```text
//! e = √((l + δ∥)² + ‖δ⊥‖²) − |l + δ∥| ≈ ½ θ² l,
//! ```
//!
//! so turning alone has *stretched* it by e. At the next step the spring is taut, and a taut spring resists all motion across
//! it with the transverse coefficient `k (1/l0 − 1/l)`: turning too, because the linearisation takes the new direction as
//! fixed. The part of it that e has brought, `c = k (1/(l' − e) − 1/l')`, *brakes*: a mass μ that would go on by δ⊥ does so
//! by `δ⊥/(1 + ρ)` only, `ρ = c dt²/μ`. With the frequency `ω = √(k/(l0 μ))` along the spring and `z = ω dt` that is
//!
//! ```text
//! ρ ≈ ½ (z θ)²  for a spring that was at rest length,
//! ```
//!
//! large for a stiff spring however little it turns. A turn by one radian takes 1/θ steps, so while it turns that far the spring
//! loses the part `1 − (1 + ρ)^(−1/θ) ≈ ½ z² θ` of its turning, and that is what a run must keep small. Nothing is wrong with
//! the matrix, which may be positive definite and stable for every step: the braked motion is smooth, plausible and wrong.
//! `Axial` leaves the term out and is not braked; that a step stretches its springs concerns it all the same. A method that
//! linearises at a prediction of the step's end, or solves the nonlinear equations, is not concerned.
//!
//! **Neighbours.** Where the step deforms the springs around, their elasticity decides about the motion and not the
//! inertia of the ends. With `E = ½ Σ (k/l0) (n·δ)²` over the other springs at both ends, μ in ρ is `μ + dt² E/‖δ⊥‖²`: a body
//! that turns as a whole is judged as the lone spring is, one that only shakes is not. So ρ is an estimate, exact for a spring
//! by itself.

use super::bracket_search::{Trial, search};
use super::critical::LargestStep;
use super::shifted_solves::solve;
use crate::assembly::{SpringPattern, SystemMatrix};
use crate::error::Result;
use crate::force::{SpringGeometry, add_elastic_force, add_external_forces, add_weight};
use crate::linear::Ldlt;
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};
use crate::work::Work;
use faer::Par;
use nalgebra::Vector3;
use std::sync::Arc;

/// What a step does to the spring that suffers most from being turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    /// The spring.
    pub spring: usize,
    /// Its ends.
    pub particles: [usize; 2],
    /// The angle by which the step turns it, in rad.
    pub angle: f64,
    /// By how much turning stretches it, as a part of its rest length: `e/l0`.
    pub stretch: f64,
    /// ρ: the next step goes on turning by `1/(1 + ρ)` of what it should. Zero under `Axial`.
    pub brake: f64,
}

/// A tenth of its turning is what a spring may lose to the brake while it turns by one radian: springs that swing turn by about
/// that, so their motion is then wrong by about a tenth; the loss grows with the cube of the step.
pub const MOST_BRAKED: f64 = 0.1;

/// A hundredth of its length is what a step may stretch a spring by turning it, by 8°. Cloth and rubber strain by more, but this
/// strain comes from nowhere, at every step anew.
pub const MOST_STRETCHED: f64 = 0.01;

/// Springs that a symmetry makes equal differ by rounding: the first of them is named.
const TIE: f64 = 1.000001;

impl Turn {
    /// The part of its turning that the spring loses while it turns by one radian.
    pub fn braked(&self) -> f64 {
        if self.brake == 0.0 { 0.0 } else { -(-self.brake.ln_1p() / self.angle).exp_m1() }
    }

    /// How far beyond the limits this is: above 1 the step is too long for this spring.
    pub fn excess(&self) -> f64 {
        // Not the loss itself, which would make all that is far beyond the limit look the same.
        let braked = if self.brake == 0.0 { 0.0 } else { self.brake.ln_1p() / self.angle };
        (braked / -(-MOST_BRAKED).ln_1p()).max(self.stretch / MOST_STRETCHED)
    }

    /// The spring that a step of length dt, by these displacements in m from these extensions, turns worst; `None` where it turns none.
    pub fn worst(
        system: &System,
        extensions: &SpringGeometry,
        displacement: &[Vector3<f64>],
        dt: f64,
        option: Stiffness,
    ) -> Option<Self> {
        let moved = |p: usize| displacement.get(p).copied().unwrap_or_else(Vector3::zeros);
        let active = || extensions.springs(system);
        // (k/l0) (n·δ)² of every spring, summed at its ends.
        let axial = |[i, j]: [usize; 2], n: &Vector3<f64>, per_length: f64| {
            let along = n.dot(&(moved(i) - moved(j)));
            per_length * along * along
        };
        let mut around = vec![0.0; system.particles()];
        for ((_, pair, spring), at) in active() {
            let energy = axial(pair, &at.direction, spring.axial_stiffness());
            pair.into_iter().for_each(|p| around[p] += energy);
        }
        let inverse_mass = |p: usize| match system.dofs().rows(p).is_empty() {
            true => 0.0,
            false => 1.0 / system.masses()[p],
        };
        let mut worst: Option<Self> = None;
        for ((number, particles, spring), at) in active() {
            let [i, j] = particles;
            let shift = moved(i) - moved(j);
            let along = at.direction.dot(&shift);
            let squared = (shift - at.direction * along).norm_squared();
            if squared == 0.0 {
                continue;
            }
            let counted = at.length + along;
            let length = (counted * counted + squared).sqrt();
            // √(a² + s) − |a| without cancellation.
            let excess = squared / (length + counted.abs());
            let brake = match option {
                Stiffness::Axial => 0.0,
                Stiffness::Full | Stiffness::Tension => {
                    // What turning adds to the part of the length that is taut.
                    let (taut, added) = match counted >= spring.rest_length {
                        true => (counted, excess),
                        false => (spring.rest_length, (length - spring.rest_length).max(0.0)),
                    };
                    let coefficient = spring.stiffness * added / (taut * length);
                    let own = axial(particles, &at.direction, spring.axial_stiffness());
                    let elastic = 0.5 * (around[i] + around[j] - 2.0 * own).max(0.0);
                    let inertia = 1.0 / ((inverse_mass(i) + inverse_mass(j)) * dt * dt) + elastic / squared;
                    coefficient / inertia
                }
            };
            let angle = squared.sqrt().atan2(counted);
            let turn = Self { spring: number, particles, angle, stretch: excess / spring.gauge_length(), brake };
            let is_worse = |worst: Self| turn.excess() > TIE * worst.excess();
            if turn.excess().is_finite() && worst.is_none_or(is_worse) {
                worst = Some(turn);
            }
        }
        worst
    }
}

/// Finds how long a step from one state may be for the springs that it turns: one factorization for all lengths that are tried, a few dozen
/// solves together.
///
/// # Examples
/// ```
/// use faer::Par;
/// use sprung::Stiffness;
/// use sprung::inspect::RotationLimit;
/// # use nalgebra::Vector3;
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// # builder.velocities[1] = Vector3::new(0.0, 1.0, 0.0);
/// let (system, state) = builder.build()?;
/// // A particle that goes round at 1 m/s, 1 m from its centre: a step of 0.5 s turns its spring far.
/// let worst = RotationLimit::new(&system, &state, Par::Seq)?.worst(Stiffness::Axial, 0.5);
/// assert!(worst.is_some());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct RotationLimit<'s> {
    system: &'s System,
    state: &'s State,
    extensions: SpringGeometry,
    operator: SystemOperator<'s>,
    matrix: SystemMatrix,
    factorization: Ldlt,
    /// The option and dt of the matrix that is factored.
    at_hand: Option<(Stiffness, f64)>,
    /// m of every degree of freedom.
    masses: Vec<f64>,
    /// `g + f_el`, full-length.
    force: Vec<Vector3<f64>>,
    displacement: Vec<Vector3<f64>>,
    reduced: Vec<f64>,
    /// What it cost.
    pub work: Work,
}

/// How much longer or shorter than the step whose matrix is factored one may be that is solved with it.
const FARTHEST: f64 = 8.0;

impl<'s> RotationLimit<'s> {
    /// At a state.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large.
    pub fn new(system: &'s System, state: &'s State, par: Par) -> Result<Self> {
        let pattern = Arc::new(SpringPattern::of_stiffness(system)?);
        let factorization = Ldlt::analyse(pattern.pattern(), par)?;
        let work = Work { symbolic_factorizations: 1, ..Work::default() };
        Ok(Self::analysed(system, state, SpringGeometry::at(system, state)?, pattern, factorization, work))
    }

    /// On a pattern that has been analysed.
    pub(super) fn analysed(
        system: &'s System,
        state: &'s State,
        extensions: SpringGeometry,
        pattern: Arc<SpringPattern>,
        factorization: Ldlt,
        work: Work,
    ) -> Self {
        let operator = SystemOperator::new(system, &extensions, Stiffness::Tension, Combination::STIFFNESS);
        let matrix = SystemMatrix::zeros(pattern);
        let mut force = vec![Vector3::zeros(); system.particles()];
        add_weight(system, &mut force);
        add_external_forces(system, &state.moment(), &mut force);
        add_elastic_force(system, &extensions, &mut force);
        let displacement = vec![Vector3::zeros(); system.particles()];
        let reduced = vec![0.0; system.dofs().len()];
        let work = Work { force_evaluations: work.force_evaluations + 1, ..work };
        let mut masses = vec![0.0; system.dofs().len()];
        for (particle, mass) in system.masses().iter().enumerate() {
            masses[system.dofs().rows(particle)].fill(*mass);
        }
        Self {
            system,
            state,
            extensions,
            operator,
            matrix,
            factorization,
            at_hand: None,
            masses,
            force,
            displacement,
            reduced,
            work,
        }
    }

    /// The spring that a step of length dt, in s, turns worst; `None` where it turns none or cannot be computed.
    ///
    /// The step is the one of linearised backward Euler whose matrix is surely definite: under `Tension` for `Full` too.
    pub fn worst(&mut self, option: Stiffness, dt: f64) -> Option<Turn> {
        let solved = if option == Stiffness::Axial { Stiffness::Axial } else { Stiffness::Tension };
        self.operator.update(&self.extensions, solved, Combination::step(dt));
        for (p, ((right, f), v)) in
            self.displacement.iter_mut().zip(&self.force).zip(&self.state.velocities).enumerate()
        {
            *right = f + v * (self.system.masses()[p] / dt);
        }
        self.system.dofs().gather(&self.displacement, &mut self.reduced);
        self.displacement.fill(Vector3::zeros());
        self.system.prescribed().displacement(self.state.time + dt, &self.state.positions, &mut self.displacement);
        self.operator.subtract_coupling(&self.displacement, &mut self.reduced);
        if !self.solves(solved, dt) {
            return None;
        }
        self.system.dofs().scatter(&self.reduced, &mut self.displacement);
        Turn::worst(self.system, &self.extensions, &self.displacement, dt, option)
    }

    /// Solves for the step: near one whose matrix is factored by that, elsewhere by its own.
    fn solves(&mut self, solved: Stiffness, dt: f64) -> bool {
        let right = self.reduced.clone();
        let Self { operator, factorization, masses, work, .. } = self;
        let mut substitute = |r: &mut [f64]| {
            work.solves += 1;
            factorization.substitute(r);
        };
        match self.at_hand {
            Some((option, at)) if option == solved && at == dt => {
                substitute(&mut self.reduced);
                return true;
            }
            Some((option, at)) if option == solved && (FARTHEST.recip()..=FARTHEST).contains(&(dt / at)) => {
                if solve(operator, dt.recip(), masses, &mut substitute, &mut self.reduced) {
                    return true;
                }
            }
            _ => {}
        }
        self.at_hand = None;
        self.matrix.refill(&self.operator);
        self.work.assemblies += 1;
        self.work.factorizations += 1;
        if self.factorization.factor(self.matrix.matrix()).is_err() || !self.factorization.is_positive() {
            return false;
        }
        self.reduced.copy_from_slice(&right);
        self.work.solves += 1;
        self.factorization.substitute(&mut self.reduced);
        self.at_hand = Some((solved, dt));
        true
    }

    /// Takes over the factorization of A of a step of this length under an option, for its own.
    pub(super) fn take_over(&mut self, option: Stiffness, dt: f64, factorization: &mut Ldlt) {
        std::mem::swap(&mut self.factorization, factorization);
        self.at_hand = Some((option, dt));
    }

    /// The longest step, in s, that turns no spring too far, sought up and down from dt. [`Every`](LargestStep::Every) where
    /// even one of `4¹² dt` does not.
    pub fn largest_step(&mut self, option: Stiffness, dt: f64) -> LargestStep {
        self.limit_and_worst(option, dt).0
    }

    /// The longest step, and the spring that dt itself turns worst.
    pub(super) fn limit_and_worst(&mut self, option: Stiffness, dt: f64) -> (LargestStep, Option<Turn>) {
        let worst = self.worst(option, dt);
        let first = Trial { at: 0.0, excess: worst.map_or(f64::NEG_INFINITY, |turn| turn.excess().ln()) };
        let limit =
            search(first, |at| self.worst(option, dt * at.exp()).map_or(f64::NEG_INFINITY, |turn| turn.excess().ln()));
        let limit = match limit {
            None if first.excess > 0.0 => LargestStep::UpTo { dt: 0.0, refused: dt },
            None => LargestStep::Every,
            Some([low, high]) => LargestStep::UpTo { dt: dt * low.exp(), refused: dt * high.exp() },
        };
        (limit, worst)
    }
}

#[cfg(test)]
mod tests;
