//! The rotation of springs in a step, and its effect: the limit that no linearisation at one state sees.
//!
//! A linearised step moves the ends of a spring along straight lines, by `δ = δx_i − δx_j = δ∥ n + δ⊥`, with `n` the direction at its start. It
//! rotates the spring by `θ ≈ ‖δ⊥‖/l`, which is `dt ‖v⊥‖/l` in free flight, and counts its new length as `l + δ∥`. The true length is larger by
//!
//! ```text
//! e = √((l + δ∥)² + ‖δ⊥‖²) − |l + δ∥| ≈ ½ θ² l.
//! ```
//!
//! At the next step the spring is taut, and resists all motion across it with the transverse coefficient `k (1/l0 − 1/l)`, because the linearisation
//! takes the new direction as fixed. The part of it that e has brought, `c = k (1/(l' − e) − 1/l')`, *brakes*: a mass μ that would go on by δ⊥ does
//! so by `δ⊥/(1 + ρ)` only, `ρ = c dt²/μ`. With the frequency `ω = √(k/(l0 μ))` along the spring and `z = ω dt` that is
//!
//! ```text
//! ρ ≈ ½ (z θ)²  for a spring that was at rest length.
//! ```
//!
//! A rotation by one radian takes 1/θ steps, in which the spring loses the part `1 − (1 + ρ)^(−1/θ) ≈ ½ z² θ` of its rotation. A may be positive
//! definite and stable for every step: the braked motion is smooth, plausible and wrong. `Axial` leaves the term out and is not braked, but stretches
//! its springs too. A method that linearises at a prediction of the step's end, or solves the nonlinear equations, is not concerned.
//!
//! **Neighbours** that the step deforms decide with their elasticity: with `E = ½ Σ (k/l0) (n·δ)²` over the other springs at both ends, μ in ρ is
//! `μ + dt² E/‖δ⊥‖²`. So ρ is an estimate, exact for a spring by itself.
//!
//! **Steps of other lengths** are solved with one factor. With `s = 1/dt` the matrix of a step is `P(s) = s² M + s C + K`, here with C and K positive
//! semidefinite. The eigenvalues of `P(s₀)⁻¹P(s)` lie between 1 and `(s/s₀)²`, so that conjugate gradients preconditioned with the factor of `P(s₀)`
//! take some twenty solves for a step four times as long or short (Hestenes and Stiefel 1952). The error e has `eᵀP(s)e = rᵀP(s)⁻¹r ≤ rᵀM⁻¹r/s²`,
//! which is compared with `xᵀP(s)x = xᵀb`.

use super::critical::LargestStep;
use super::oracle::Oracle;
use crate::error::Result;
use crate::force::{SpringGeometry, add_elastic_force, add_external_forces, add_weight};
use crate::linear::{Ldlt, dot};
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::rigid::sums_at_ends;
use crate::spring::{Extension, Spring, Stiffness};
use crate::system::{State, System};
use crate::work::Work;
use faer::Par;
use nalgebra::Vector3;

/// The rotation of a spring in a step, and its effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    /// The spring.
    pub spring: usize,
    /// Its ends.
    pub particles: [usize; 2],
    /// The angle of the rotation, in rad.
    pub angle: f64,
    /// The stretch by rotation, relative to the rest length: `e/l0`.
    pub stretch: f64,
    /// ρ: the next step continues the rotation by the factor `1/(1 + ρ)`. Zero under `Axial`.
    pub brake: f64,
}

/// The largest part of its rotation that a spring may lose in one radian. Springs that swing rotate by about that, so their motion is then wrong by
/// about a tenth; the loss grows with the cube of the step.
pub const MOST_BRAKED: f64 = 0.1;

/// The largest stretch of a spring by its rotation in a step, relative to its length: by 8°. Cloth and rubber strain by more, but this strain comes
/// from nowhere, at every step anew.
pub const MOST_STRETCHED: f64 = 0.01;

impl Turn {
    /// The part of its rotation that the spring loses in one radian.
    pub fn braked(&self) -> f64 {
        -(-self.decay()).exp_m1()
    }

    /// The logarithm by which the rotation decays in one radian.
    fn decay(&self) -> f64 {
        if self.brake == 0.0 { 0.0 } else { self.brake.ln_1p() / self.angle }
    }

    /// The excess over the limits: above 1 the step is too long for this spring.
    pub fn excess(&self) -> f64 {
        // Not the loss itself, which saturates far beyond the limit.
        (self.decay() / -(-MOST_BRAKED).ln_1p()).max(self.stretch / MOST_STRETCHED)
    }

    /// The spring with the largest [excess](Self::excess) in a step of length dt by these displacements, in m; `None` where none rotates.
    pub fn worst(
        system: &System,
        extensions: &SpringGeometry,
        displacement: &[Vector3<f64>],
        dt: f64,
        option: Stiffness,
    ) -> Option<Self> {
        let moved = |p: usize| displacement.get(p).copied().unwrap_or_else(Vector3::zeros);
        // (k/l0) (n·δ)² of every spring, summed at its ends.
        let axial = |[i, j]: [usize; 2], spring: &Spring, at: &Extension| {
            let along = at.direction.dot(&(moved(i) - moved(j)));
            spring.axial_stiffness() * along * along
        };
        let axials = extensions.springs(system).map(|((_, ends, spring), at)| (ends, axial(ends, spring, at)));
        let around = sums_at_ends(system, axials);
        let inverse_mass = |p: usize| match system.dofs().rows(p).is_empty() {
            true => 0.0,
            false => 1.0 / system.masses()[p],
        };
        let mut worst: Option<Self> = None;
        for ((number, particles, spring), at) in extensions.springs(system) {
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
                Stiffness::Full | Stiffness::Tension | Stiffness::Absolute => {
                    // The taut part of the length, and that added by the rotation.
                    let (taut, added) = match counted >= spring.rest_length {
                        true => (counted, excess),
                        false => (spring.rest_length, (length - spring.rest_length).max(0.0)),
                    };
                    let coefficient = spring.stiffness * added / (taut * length);
                    let elastic = 0.5 * (around[i] + around[j] - 2.0 * axial(particles, spring, at)).max(0.0);
                    let inertia = 1.0 / ((inverse_mass(i) + inverse_mass(j)) * dt * dt) + elastic / squared;
                    coefficient / inertia
                }
            };
            let angle = squared.sqrt().atan2(counted);
            let turn = Self { spring: number, particles, angle, stretch: excess / spring.gauge_length(), brake };
            // Springs that a symmetry makes equal differ by rounding: the first of them is named.
            let is_worse = |worst: Self| turn.excess() > 1.000001 * worst.excess();
            if turn.excess().is_finite() && worst.is_none_or(is_worse) {
                worst = Some(turn);
            }
        }
        worst
    }
}

/// Finds the longest step from one state by the rotation of its springs.
pub struct RotationLimit<'s> {
    system: &'s System,
    state: &'s State,
    extensions: SpringGeometry,
    operator: SystemOperator<'s>,
    oracle: Oracle,
    /// The option and dt of the matrix that is factored.
    factored: Option<(Stiffness, f64)>,
    masses: Vec<f64>,
    /// `g + f_el`, full-length.
    force: Vec<Vector3<f64>>,
    /// The work of the search.
    pub work: Work,
}

impl<'s> RotationLimit<'s> {
    /// At a state.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large.
    pub fn new(system: &'s System, state: &'s State, par: Par) -> Result<Self> {
        let mut work = Work::default();
        let oracle = Oracle::analyse(system, par, &mut work)?;
        let mut limit = Self::analysed(system, state, SpringGeometry::at(system, state)?, oracle);
        limit.work.add(&work);
        Ok(limit)
    }

    /// As [`new`](Self::new), with an analysed pattern.
    pub(super) fn analysed(system: &'s System, state: &'s State, extensions: SpringGeometry, oracle: Oracle) -> Self {
        let operator = SystemOperator::new(system, &extensions, Stiffness::Tension, Combination::STIFFNESS);
        let mut force = vec![Vector3::zeros(); system.particles()];
        add_weight(system, &mut force);
        add_external_forces(system, &state.moment(), &mut force);
        add_elastic_force(system, &extensions, &mut force);
        Self {
            operator,
            oracle,
            factored: None,
            masses: system.dofs().iter().map(|dof| system.masses()[dof.particle]).collect(),
            force,
            work: Work { force_evaluations: 1, ..Work::default() },
            system,
            state,
            extensions,
        }
    }

    /// The spring that a step of length dt, in s, rotates worst; `None` where it rotates none or cannot be computed.
    ///
    /// The step is that of linearised backward Euler, under `Tension` for `Full` too, as that matrix is positive definite, and for `Absolute`, which
    /// differs for compressed springs alone: those that a turn does not stretch.
    pub fn worst(&mut self, option: Stiffness, dt: f64) -> Option<Turn> {
        let solved = if option == Stiffness::Axial { Stiffness::Axial } else { Stiffness::Tension };
        self.operator.update(&self.extensions, solved, Combination::step(dt));
        let Self { system, state, .. } = *self;
        let forces = self.force.iter().zip(&state.velocities).zip(system.masses());
        let right: Vec<_> = forces.map(|((f, v), mass)| f + v * (mass / dt)).collect();
        let mut reduced = system.dofs().reduced(&right);
        let mut displacement = vec![Vector3::zeros(); system.particles()];
        system.prescribed().displacement(state.time + dt, &state.positions, &mut displacement);
        self.operator.subtract_coupling(&displacement, &mut reduced);
        if !self.solve(solved, dt, &mut reduced) {
            return None;
        }
        system.dofs().scatter(&reduced, &mut displacement);
        Turn::worst(system, &self.extensions, &displacement, dt, option)
    }

    /// Solves for the step, with the factor at hand if that is of a step at most eight times as long or short.
    fn solve(&mut self, solved: Stiffness, dt: f64, reduced: &mut [f64]) -> bool {
        let right = reduced.to_vec();
        let Self { operator, oracle, masses, work, .. } = self;
        if let Some((_, at)) = self.factored.filter(|(option, _)| *option == solved) {
            let mut substitute = |r: &mut [f64]| {
                work.solves += 1;
                oracle.factorization.substitute(r);
            };
            if at == dt {
                substitute(reduced);
                return true;
            }
            let is_near = (0.125..=8.0).contains(&(dt / at));
            if is_near && conjugate_gradients(operator, dt.recip(), masses, &mut substitute, reduced) {
                return true;
            }
        }
        self.factored = None;
        if !oracle.is_definite(operator, work) {
            return false;
        }
        reduced.copy_from_slice(&right);
        work.solves += 1;
        oracle.factorization.substitute(reduced);
        self.factored = Some((solved, dt));
        true
    }

    pub(super) fn take_over(&mut self, option: Stiffness, dt: f64, factorization: &mut Ldlt) {
        std::mem::swap(&mut self.oracle.factorization, factorization);
        self.factored = Some((option, dt));
    }

    /// The longest step, in s, that rotates no spring too far, searched up and down from dt. [`Every`](LargestStep::Every) where even one of `4¹² dt`
    /// does not.
    pub fn largest_step(&mut self, option: Stiffness, dt: f64) -> LargestStep {
        self.limit_and_worst(option, dt).0
    }

    pub(super) fn limit_and_worst(&mut self, option: Stiffness, dt: f64) -> (LargestStep, Option<Turn>) {
        let excess = |worst: Option<Turn>| worst.map_or(f64::NEG_INFINITY, |turn| turn.excess().ln());
        let worst = self.worst(option, dt);
        let first = Trial { at: 0.0, excess: excess(worst) };
        let limit = match search(first, |at| excess(self.worst(option, dt * at.exp()))) {
            None if first.excess > 0.0 => LargestStep::UpTo { dt: 0.0, refused: dt },
            None => LargestStep::Every,
            Some([low, high]) => LargestStep::UpTo { dt: dt * low.exp(), refused: dt * high.exp() },
        };
        (limit, worst)
    }
}

/// The shortest leap of the search, as a factor of dt. It covers twelve of them, and one leap may be four.
const LEAP: f64 = 4.0;

/// The relative width of the bracket: an estimate needs two digits.
const WIDTH: f64 = 0.01;

#[derive(Debug, Clone, Copy)]
struct Trial {
    /// The logarithm of its length over that of the first trial.
    at: f64,
    /// The logarithm of the excess: above zero where the step is too long.
    excess: f64,
}

/// A bracket of the limit near the first trial, which lies at 0; `None` where there is none. The logarithm of the excess is nearly a line over that of
/// dt: leaps go a little beyond the zero of the line through the last two trials, until the sign changes.
fn search(first: Trial, mut excess: impl FnMut(f64) -> f64) -> Option<[f64; 2]> {
    let is_too_long = first.excess > 0.0;
    let direction = if is_too_long { -1.0 } else { 1.0 };
    let shortest = LEAP.ln();
    let farthest = 12.0 * shortest;
    let (mut near, mut leap) = (first, shortest);
    while near.at.abs() < farthest {
        let at = direction * (near.at.abs() + leap).min(farthest);
        let far = Trial { at, excess: excess(at) };
        if (far.excess > 0.0) != is_too_long {
            let [low, high] = if is_too_long { [far, near] } else { [near, far] };
            return Some(narrowed(low, high, excess));
        }
        let ahead = far.excess * (far.at - near.at).abs() / (near.excess - far.excess);
        leap = if ahead.is_finite() { (1.1 * ahead).clamp(shortest, 4.0 * shortest) } else { shortest };
        near = far;
    }
    None
}

/// Narrows a bracket to [`WIDTH`] by the Illinois method (Dowell and Jarratt 1971): an end that stays is given half of its excess. Trials keep half of
/// the width away from the ends, and after a dozen they are bisections.
fn narrowed(mut low: Trial, mut high: Trial, mut excess: impl FnMut(f64) -> f64) -> [f64; 2] {
    let width = WIDTH.ln_1p();
    let (mut trials, mut was_high) = (0, None);
    while high.at - low.at > width {
        let line = low.at + (high.at - low.at) * low.excess / (low.excess - high.excess);
        let at = match line.is_finite() && trials < 12 {
            true => line.clamp(low.at + 0.5 * width, high.at - 0.5 * width),
            false => low.at.midpoint(high.at),
        };
        let trial = Trial { at, excess: excess(at) };
        let is_high = trial.excess > 0.0;
        let (moved, stays) = if is_high { (&mut high, &mut low) } else { (&mut low, &mut high) };
        *moved = trial;
        if was_high == Some(is_high) {
            stays.excess *= 0.5;
        }
        was_high = Some(is_high);
        trials += 1;
    }
    [low.at, high.at]
}

/// Solves `P(s) x = b`, b in the place of x, to an error of 10⁻⁵ in the norm of P(s), in forty iterations at most; returns `false` where that fails.
/// `masses` is the diagonal of M.
fn conjugate_gradients(
    p: &dyn LinearOperator,
    s: f64,
    masses: &[f64],
    precondition: &mut dyn FnMut(&mut [f64]),
    x: &mut [f64],
) -> bool {
    let b = x.to_vec();
    let mut rest = b.clone();
    x.fill(0.0);
    let (mut direction, mut product) = (vec![0.0; b.len()], vec![0.0; b.len()]);
    let mut before = f64::INFINITY;
    for iteration in 0..=40 {
        let error: f64 = rest.iter().zip(masses).map(|(r, mass)| r * r / mass).sum();
        let energy = dot(x, &b);
        if !(error.is_finite() && energy.is_finite()) {
            return false;
        }
        if error <= (1e-5 * s).powi(2) * energy || error == 0.0 {
            return true;
        }
        if iteration == 40 {
            break;
        }
        let mut z = rest.clone();
        precondition(&mut z);
        let now = dot(&rest, &z);
        let beta = now / before;
        direction.iter_mut().zip(&z).for_each(|(d, z)| *d = z + beta * *d);
        p.apply(&direction, &mut product);
        let alpha = now / dot(&direction, &product);
        x.iter_mut().zip(&direction).for_each(|(x, d)| *x += alpha * d);
        rest.iter_mut().zip(&product).for_each(|(r, p)| *r -= alpha * p);
        before = now;
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspect::fixtures::{pin, pinned};
    use crate::inspect::tests::chain;
    use crate::system::{ExternalForce, StateView};

    /// Powers, as turning gives them, kinks where another spring becomes the worst, jumps, and values that are no numbers.
    #[test]
    fn limits_are_found_in_a_few_trials() {
        type Excess = fn(f64) -> f64;
        let cases: [(Excess, f64); 9] = [
            (|dt| 3.0 * (dt / 1.7).ln(), 1.7),
            (|dt| 4.0 * (dt / 1e-3).ln(), 1e-3),
            (|dt| 1.5 * (dt / 5e4).ln(), 5e4),
            (|dt| (4.0 * (dt / 1.2).ln()).max((dt / 1.1).ln()), 1.1),
            (|dt| (dt / 3.9).ln() + (dt / 3.9).ln().powi(3), 3.9),
            (|dt| if dt > 2.0 { 5.0 } else { -5.0 }, 2.0),
            (|dt| if dt > 0.02 { 5.0 } else { -5.0 }, 0.02),
            (|dt| if dt > 1.01 { 1e-9 } else { f64::NEG_INFINITY }, 1.01),
            (|dt| if dt > 3.99 { f64::INFINITY } else { -1e-9 }, 3.99),
        ];
        for (number, (excess, limit)) in cases.into_iter().enumerate() {
            let mut trials = 0;
            let found = search(Trial { at: 0.0, excess: excess(1.0) }, |at: f64| {
                trials += 1;
                excess(at.exp())
            });
            let Some(between) = found else { panic!("{number}: no limit") };
            let ([low, high], rounding) = (between.map(f64::exp), 1.0 + 1e-12);
            assert!(low <= limit * rounding && limit <= high * rounding, "{number}: {low} {high}");
            assert!(high / low <= (1.0 + WIDTH) * rounding, "{number}: {low} {high}");
            assert!(trials <= if number < 5 { 9 } else { 25 }, "{number}: {trials} trials");
        }
        for (first, all) in [(-1.0, -1.0), (f64::NEG_INFINITY, f64::NEG_INFINITY), (1.0, 2.0)] {
            assert_eq!(search(Trial { at: 0.0, excess: first }, |_| all), None);
        }
        // A step of exactly the limit is not too long: the search goes up from it, and stops going down at it.
        for (offset, limit) in [(0.0, 0.0), (LEAP.ln(), -LEAP.ln())] {
            let found = search(Trial { at: 0.0, excess: offset }, |at| at + offset);
            assert_eq!(found.map(|[low, _]| low), Some(limit));
        }
    }

    /// (s² m + c) x = b by hand: exactly, with what solves exactly or nearly, and not at all where squares overflow.
    #[test]
    fn steps_are_solved_for_unless_they_overflow() {
        let (system, state) = pinned(&[pin(2.0, -1.0), pin(1.0, -12.0)]);
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let p = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.5));
        for (diagonal, most) in [([9.0, 16.0], 1), ([8.0, 4.0], 2)] {
            let mut uses = 0;
            let mut precondition = |r: &mut [f64]| {
                uses += 1;
                r.iter_mut().zip(diagonal).for_each(|(r, diagonal)| *r /= diagonal);
            };
            let mut x = [27.0, 32.0];
            assert!(conjugate_gradients(&p, 2.0, &[2.0, 1.0], &mut precondition, &mut x));
            assert!((x[0] - 3.0).abs() < 1e-12 && (x[1] - 2.0).abs() < 1e-12, "{x:?}");
            assert_eq!(uses, most);
        }
        let mut unused = |_: &mut [f64]| panic!("a direction that is of no use");
        assert!(!conjugate_gradients(&p, 2.0, &[2.0, 1.0], &mut unused, &mut [1e200, 0.0]));
    }

    /// A particle between two walls that flies across its springs at 10⁹ m/s: no step that is tried is short enough.
    #[test]
    fn a_motion_so_fast_that_every_step_is_too_long_has_no_limit() {
        let (system, mut state) = chain(1, 1.0);
        let limit =
            |state: &State| RotationLimit::new(&system, state, Par::Seq).unwrap().largest_step(Stiffness::Axial, 1.0);
        assert_eq!(limit(&state), LargestStep::Every);
        state.velocities[1].y = 1e9;
        assert_eq!(limit(&state), LargestStep::UpTo { dt: 0.0, refused: 1.0 });
        state.velocities[1].y = 1.0;
        assert!(matches!(limit(&state), LargestStep::UpTo { dt, refused } if 0.0 < dt && dt < refused));
    }

    /// Wind that pushes as gravity would limits steps as gravity does.
    #[test]
    fn external_forces_turn_springs_too() {
        #[derive(Debug)]
        struct Wind;

        impl ExternalForce for Wind {
            fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
                force.iter_mut().take(at.positions.len()).for_each(|f| f.y -= 90.0);
            }
        }

        let (system, state) = chain(1, 1.0);
        let limit =
            |system: &System| RotationLimit::new(system, &state, Par::Seq).unwrap().largest_step(Stiffness::Axial, 1.0);
        let calm = limit(&system);
        let blown = limit(&system.clone().with_external_force(Wind));
        assert!(calm == LargestStep::Every && matches!(blown, LargestStep::UpTo { .. }), "{calm:?} {blown:?}");
    }
}
