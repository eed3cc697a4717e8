//! The errors of steps, carried on to the end of the run: how much the motion magnifies them.
//!
//! A difference δ of two motions that are near each other goes on as `δ' = J δ`, J being the Jacobian of the motion on the way. So what the
//! steps of a run have made wrong by its end is about
//!
//! ```text
//! δ_n = R(h J_n) δ_{n−1} + e_n,
//! ```
//!
//! e_n being the error of step n by the method's own estimate, positions and velocities of all particles: where a scene folds or buckles δ
//! grows by orders of magnitude while no step errs by much.
//!
//! **What carries it on** is the matrix of the step, `A = M/τ² − G/τ − K`, which is factored already. With τ = h/4
//!
//! ```text
//! R(z) = ((1 + z/4)/(1 − z/4))²,
//! ```
//!
//! two steps of the midpoint rule, each of half the length, at the cost of one solve each. Vibrations keep their amplitude, however fast, as
//! `|R| = 1` on the imaginary axis. Of half a step from (δ_x, δ_v) the middle (z_x, z_v) solves
//!
//! ```text
//! A z_x = M δ_x/τ² − G δ_x/τ + M δ_v/τ,      z_v = (z_x − δ_x)/τ,
//! ```
//!
//! and the end is twice the middle less the beginning. K and G are those where the step begins, and of damped springs that turn
//! `∂f_d/∂x` is left out: of δ two digits are more than enough.
//!
//! **Where it ends.** Two motions that have nothing in common any more are not further apart than the scene lets them be, while δ
//! would grow for ever: of cloths whose wrinkles fall to one side or the other to 10²⁶ times the extent in two seconds, where the motions are a
//! tenth of it apart. So the ends of a spring differ by half its length at most in δ: beyond that springs of the two motions point to different
//! sides, and `δ' = J δ` says nothing any more. What is too much is taken from both ends, more from the lighter one, and from their velocities in
//! proportion; where it is twice that, as after a step near the pole of R, all of δ is made smaller first. What moves as a whole may still be off by
//! any way. (Half is measured: on cloths of 8² and 20² particles a third of δ, which is what [estimates](super::Figures::estimate) take, is then within five
//! times of the truth.)
//!
//! Where a solve fails δ stays as it is.
//!
//! (Transported local errors are an old idea, as in Skeel, Thirteen ways to estimate global error, Numer. Math. 48, 1986; with the matrix of the step: own
//! derivation.)

use super::adaptive::norm_of_all;
use super::implicit::LinearSystem;
use crate::force::{Extensions, add_damping_force};
use crate::spring::{Extension, Spring};
use crate::system::{Axes, System};
use nalgebra::Vector3;

/// The part of a spring's length, or of its rest length where that is more, by which its ends differ at most.
const APART: f64 = 0.5;

/// Differences so many times as large grew in a step that does not resolve them.
const SUDDEN: f64 = 2.0;

/// Of positions and of velocities.
pub(super) type Kept = [Vec<[f64; 3]>; 2];

/// δ: what the errors of the steps of a run have become, of positions in m and of velocities in m/s.
///
/// # Examples
/// ```
/// use sprung::integrate::{CarriedErrors, ImplicitOptions, Rodas4, TimeStepper};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, mut state) = builder.build()?;
/// let mut stepper = Rodas4::new(&system, &state, &ImplicitOptions::default())?;
/// stepper.carry_errors(CarriedErrors::none(&system));
/// for _ in 0..10 {
///     stepper.step(&mut state, 0.1)?;
/// }
/// // A vibration magnifies nothing: it is off by about what its steps were.
/// let wrong = stepper.carried_errors().map(|errors| errors.norm(&system));
/// assert!(wrong.is_some_and(|wrong| 1e-9 < wrong && wrong < 1e-2));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct CarriedErrors {
    positions: Vec<Vector3<f64>>,
    velocities: Vec<Vector3<f64>>,
}

impl CarriedErrors {
    /// Nothing is wrong yet.
    pub fn none(system: &System) -> Self {
        let zeros = || vec![Vector3::zeros(); system.particles()];
        Self { positions: zeros(), velocities: zeros() }
    }

    /// As it was kept; nothing where that is of another system.
    pub(super) fn of(system: &System, kept: &Kept) -> Self {
        if kept.iter().any(|rows| rows.len() != system.particles()) {
            return Self::none(system);
        }
        let [positions, velocities] = kept.each_ref().map(|rows| rows.iter().map(|row| Vector3::from(*row)).collect());
        Self { positions, velocities }
    }

    /// To go on with.
    pub(super) fn kept(&self) -> Kept {
        [&self.positions, &self.velocities].map(|rows| rows.iter().map(|row| (*row).into()).collect())
    }

    fn is_zero(&self) -> bool {
        self.positions.iter().chain(&self.velocities).all(|difference| *difference == Vector3::zeros())
    }

    /// ‖δ_x‖ over all particles, in m.
    pub fn norm(&self, system: &System) -> f64 {
        norm_of_all(system, &self.positions)
    }

    /// Carries δ over a step with the matrix that `linear` has for it, of τ = `tau` seconds, a quarter of the step. The buffers have an entry for
    /// every particle.
    pub(super) fn carry(&mut self, linear: &mut LinearSystem, tau: f64, [force, middle]: [&mut [Vector3<f64>]; 2]) {
        let system = linear.system;
        for _ in 0..2 {
            if self.is_zero() {
                return;
            }
            // −G δ_x/τ: damping forces at the velocities −δ_x/τ, in a buffer that is free until the solve.
            for (minus, x) in middle.iter_mut().zip(&self.positions) {
                *minus = -x / tau;
            }
            let differences = self.positions.iter().zip(&self.velocities);
            for ((force, (x, v)), mass) in force.iter_mut().zip(differences).zip(system.masses()) {
                *force = (x / tau + v) * (mass / tau);
            }
            add_damping_force(system, &linear.extensions, middle, force);
            middle.fill(Vector3::zeros());
            if linear.solve_as_needed(force, middle).is_err() {
                return;
            }
            let differences = self.positions.iter_mut().zip(&mut self.velocities);
            for ((x, v), z) in differences.zip(&*middle) {
                *v = (z - *x) * (2.0 / tau) - *v;
                *x = z * 2.0 - *x;
            }
        }
        self.limit(system, &linear.extensions);
    }

    /// Draws the ends of springs together that differ by more than they may.
    fn limit(&mut self, system: &System, extensions: &Extensions) {
        let apart = |positions: &[Vector3<f64>], [i, j]: [usize; 2]| (positions[i] - positions[j]).norm();
        let ratio = |at @ ((_, ends, _), _): Stretched| apart(&self.positions, ends) / most(at);
        let largest = extensions.springs(system).map(ratio).fold(0.0, f64::max);
        if largest <= 1.0 {
            return;
        }
        if largest > SUDDEN {
            for difference in self.positions.iter_mut().chain(&mut self.velocities) {
                *difference *= SUDDEN / largest;
            }
        }
        let weight = |p: usize| if system.dofs().free_axes(p) == Axes::NONE { 0.0 } else { 1.0 / system.masses()[p] };
        for at @ ((_, [i, j], _), _) in extensions.springs(system) {
            let part = most(at) / apart(&self.positions, [i, j]);
            if part >= 1.0 {
                continue;
            }
            let less = (1.0 - part) / (weight(i) + weight(j));
            for all in [&mut self.positions, &mut self.velocities] {
                let taken = (all[i] - all[j]) * less;
                for (end, sign) in [(i, -1.0), (j, 1.0)] {
                    let free = system.dofs().free_axes(end);
                    let share = sign * weight(end);
                    all[end] += Vector3::from_fn(|axis, _| if free.contains(axis) { share * taken[axis] } else { 0.0 });
                }
            }
        }
    }

    /// Adds `factor` times the error of a step, zero where coordinates are prescribed.
    pub(super) fn add(&mut self, factor: f64, positions: &[Vector3<f64>], velocities: &[Vector3<f64>]) {
        self.positions.iter_mut().zip(positions).for_each(|(sum, error)| *sum += error * factor);
        self.velocities.iter_mut().zip(velocities).for_each(|(sum, error)| *sum += error * factor);
    }
}

/// A spring by its number, with its ends and where they are.
type Stretched<'a> = ((usize, [usize; 2], &'a Spring), &'a Extension);

/// By how much its ends differ at most, in m.
fn most(((.., spring), at): Stretched) -> f64 {
    APART * at.length.max(spring.rest_length)
}

#[cfg(test)]
mod tests;
