//! DOP853, the explicit Runge–Kutta method of eighth order by Dormand and Prince, with step control and an interpolant by Hairer and Wanner.
//!
//! **The method** has twelve stages. On positions and velocities, `x' = v`, `v' = a(x, v)`, with accelerations a_j of the stages,
//!
//! ```text
//! V_i = v + h Σ A_ij a_j,      X_i = x + h Σ A_ij V_j = x + c_i h v + h² Σ (A²)_ij a_j,
//! ```
//!
//! so that only accelerations are stored and every stage reads them once. Row 12 of A is the formula itself: `x' = X_12`, `v' = V_12`.
//!
//! **Error estimate.** With two embedded differences E5 and E3 of the same stages, of fifth and third order, the error is taken as
//! `‖e5‖²/√(‖e5‖² + 0.01 ‖e3‖²)`, which falls as h⁸, see [`AdaptiveStepper::coarser_estimate`]. The method's own error falls as h⁹. On a
//! vibration of frequency ω, z = ωh, the formulas give
//!
//! ```text
//! ‖e5‖/‖e3‖ = 0.0033 z²,      |R(iz) − e^{iz}| = 0.148 z · ‖e5‖²/√(‖e5‖² + 0.01 ‖e3‖²)
//! ```
//!
//! within 10 % up to z = 2, where the second factor goes over to a constant 0.4. So the local error of a step is `0.148 min(z, 3)` times the joint
//! estimate, right within a third as far as the method is stable.
//!
//! **Between the ends of a step** the motion is a polynomial of degree seven, `v + h Σ w_j(s) a_j` at the share s of the step and x as above, right
//! to O(h⁸). It takes three more evaluations, made when one is asked for. Near the stability limit and beyond it the polynomial magnifies fast
//! vibrations that the formula itself damps: on a vibration it differs from the quintic through positions, velocities and accelerations at both ends
//! by `1.6 ‖e5‖` up to z = 3, by `4.5 ‖e5‖` at z = 5 and by `23 ‖e5‖` at z = 8; at a moment by up to z times that. Where they differ by more than
//! `5 ‖e5‖`, 1.6 times the limit 3 of the formula's accuracy, a shorter step of the method takes its place, of eleven evaluations.
//!
//! **Prescribed coordinates** have no acceleration between the kinks of their paths, so that stages move them as the path does. Steps are cut at
//! kinks.
//!
//! Sources: Dormand and Prince (1980), Prince and Dormand (1981); Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, II.5, II.10,
//! and their code dop853.f.

mod coefficients;

use super::adaptive::{hermite, joint};
use super::explicit::check_explicit;
use super::substeps::substeps;
use super::{
    AdaptiveStepper, CompletedStep, ErrorEstimate, PropagatedError, Statistics, StepFailure, TimeStepper, fits,
    free_square, norm_of_all, zero_prescribed,
};
use crate::error::Result;
use crate::force::set_total_force;
use crate::system::{State, System};
use coefficients::{A, C, E3, E5, Row, SQUARE, STAGES, chain, sum, weights};
use nalgebra::Vector3;

/// Eighth order, twelve force evaluations a step; explicit.
#[doc(alias = "Runge-Kutta")]
pub struct Dop853<'s> {
    system: &'s System,
    /// The accelerations of the stages, zero where coordinates are prescribed.
    stages: [Vec<Vector3<f64>>; STAGES],
    /// The start of the step, the current stage, and the end of the step.
    base: State,
    stage: State,
    next: State,
    /// The length of the last step tried, and a time at which prescribed velocities are those of the step.
    h: f64,
    middle: f64,
    /// True if the first stage's acceleration is that at the start of the next step.
    knows_first: bool,
    /// True if the stages of the interpolant of the last accepted step are known.
    knows_last: bool,
    /// The estimates by E5 and by E3, of positions and velocities.
    estimates: [[Vec<Vector3<f64>>; 2]; 2],
    /// The error of positions in the last step, in m.
    local_error: f64,
    /// The same method for steps aside: from displaced states, and to samples within a step.
    twin: Option<Box<Self>>,
    statistics: Statistics,
}

/// The stage that is the end of the step, and the formula's row.
const END: usize = 12;

/// Adds `Σ along_j a_j` to x and `Σ across_j a_j` to v, over the stages with a coefficient, block by block so that sums stay in the cache.
fn add_stages(
    stages: &[Vec<Vector3<f64>>; STAGES],
    [along, across]: [&Row; 2],
    x: &mut [Vector3<f64>],
    v: &mut [Vector3<f64>],
) {
    const BLOCK: usize = 64;
    for (block, (x, v)) in x.chunks_mut(BLOCK).zip(v.chunks_mut(BLOCK)).enumerate() {
        for ((stage, &p), &q) in stages.iter().zip(along).zip(across) {
            if p == 0.0 && q == 0.0 {
                continue;
            }
            let own = stage.get(block * BLOCK..).unwrap_or_default();
            for ((x, v), a) in x.iter_mut().zip(&mut *v).zip(own) {
                *x += a * p;
                *v += a * q;
            }
        }
    }
}

/// Sets `to` to `x + passed v + Σ along_j a_j` and `v + Σ across_j a_j`, x and v being those of a state.
fn set_combination(stages: &[Vec<Vector3<f64>>; STAGES], rows: [&Row; 2], from: &State, passed: f64, to: &mut State) {
    let starts = from.positions.iter().zip(&from.velocities);
    for ((x, v), (x0, v0)) in to.positions.iter_mut().zip(&mut to.velocities).zip(starts) {
        *x = x0 + v0 * passed;
        *v = *v0;
    }
    add_stages(stages, rows, &mut to.positions, &mut to.velocities);
}

impl<'s> Dop853<'s> {
    /// A stepper for a system.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a state of another system; too little memory.
    pub fn new(system: &'s System, state: &State) -> Result<Self> {
        check_explicit(system, state, 700)?;
        Ok(Self::unchecked(system, state))
    }

    fn unchecked(system: &'s System, state: &State) -> Self {
        let zeros = || vec![Vector3::zeros(); system.particles()];
        Self {
            system,
            stages: std::array::from_fn(|_| zeros()),
            base: state.clone(),
            stage: state.clone(),
            next: state.clone(),
            h: 0.0,
            middle: state.time,
            knows_first: false,
            knows_last: false,
            estimates: [[zeros(), zeros()], [zeros(), zeros()]],
            local_error: 0.0,
            twin: None,
            statistics: Statistics::default(),
        }
    }
    fn set_acceleration(&mut self, stage: usize) -> Result<(), StepFailure> {
        let Self { system, stages, stage: at, statistics, .. } = self;
        let a = &mut stages[stage];
        statistics.work.force_evaluations += 1;
        set_total_force(system, &at.moment(), a)?;
        for (a, mass) in a.iter_mut().zip(system.masses()) {
            *a /= *mass;
        }
        zero_prescribed(system, a);
        Ok(())
    }

    /// Sets `self.stage` to the point of a stage, `V_i` and `X_i`.
    fn set_point(&mut self, stage: usize) {
        let Self { stages, base, stage: to, h, .. } = self;
        let (h, c) = (*h, C[stage]);
        let (along, across) = (SQUARE[stage].map(|a| a * h * h), A[stage].map(|a| a * h));
        set_combination(stages, [&along, &across], base, c * h, to);
        to.time = base.time + c * h;
    }

    /// Computes `next`, h seconds after `base`. No kink may be in between.
    fn advance(&mut self, h: f64) -> Result<(), StepFailure> {
        self.h = h;
        self.middle = self.base.time + 0.5 * h;
        self.knows_last = false;
        self.system.prescribed().set_velocities(self.middle, &mut self.base.velocities);
        if !self.knows_first {
            self.stage.copy_from(&self.base);
            self.set_acceleration(0)?;
            self.knows_first = true;
        }
        for stage in 1..END {
            self.set_point(stage);
            self.set_acceleration(stage)?;
        }
        self.set_point(END);
        std::mem::swap(&mut self.stage, &mut self.next);
        StepFailure::unless_finite(self.system, self.next.is_finite())
    }

    /// `h Σ E_j V_j` and `h Σ E_j a_j` for both embedded differences.
    fn set_estimates(&mut self) {
        let Self { system, stages, base, h, estimates, .. } = self;
        for ([x, v], row) in estimates.iter_mut().zip([&E5, &E3]) {
            let share = sum(row) * *h;
            for (x, v0) in x.iter_mut().zip(&base.velocities) {
                *x = v0 * share;
            }
            v.fill(Vector3::zeros());
            add_stages(stages, [&chain(row, &A).map(|e| e * *h * *h), &row.map(|e| e * *h)], x, v);
            zero_prescribed(system, x);
            zero_prescribed(system, v);
        }
    }

    /// An estimate of the error of positions in the step just computed, in m, see the module.
    fn position_error(&self) -> f64 {
        // Of positions and velocities together: each alone goes through zero in a vibration.
        let both =
            |[x, v]: &[Vec<Vector3<f64>>; 2]| norm_of_all(self.system, x).hypot(self.h * norm_of_all(self.system, v));
        let [fine, coarse] = [both(&self.estimates[0]), both(&self.estimates[1])];
        if fine == 0.0 {
            return 0.0;
        }
        let z = (fine / (0.0033 * coarse)).sqrt();
        0.148 * z.min(3.0) * joint(fine, coarse) / fine * norm_of_all(self.system, &self.estimates[0][0])
    }

    /// Computes the accelerations that only the interpolant of the last accepted step, to `after`, needs.
    fn set_last(&mut self, after: &State) -> Result<(), StepFailure> {
        if self.knows_last {
            return Ok(());
        }
        self.stage.copy_from(after);
        self.system.prescribed().set_velocities(self.middle, &mut self.stage.velocities);
        self.set_acceleration(END)?;
        for stage in END + 1..STAGES {
            self.set_point(stage);
            self.set_acceleration(stage)?;
        }
        self.knows_last = true;
        Ok(())
    }

    /// The interpolant at a share of the last accepted step.
    fn set_sample(&self, before: &State, share: f64, sample: &mut State) {
        let (h, weights) = (self.h, weights(share));
        let (along, across) = (chain(&weights, &A).map(|w| w * h * h), weights.map(|w| w * h));
        set_combination(&self.stages, [&along, &across], before, sum(&weights) * h, sample);
    }

    /// A sample differs from the quintic through both ends of the last accepted step by at most `5 ‖e5‖`, or rounding.
    fn is_near_quintic(&self, [before, after]: [&State; 2], share: f64, sample: &State) -> bool {
        let Self { system, h, stages, estimates: [[error_x, error_v], _], .. } = self;
        let (mut apart, mut allowed) = ([0.0; 2], [0.0; 2]);
        for p in 0..system.own_particles() {
            let (x0, v0, a0, a1) = (before.positions[p], before.velocities[p], stages[0][p], stages[END][p]);
            // The position, velocity and acceleration at the end beyond those of constant acceleration, in steps.
            let d = after.positions[p] - x0 - (v0 + a0 * (0.5 * h)) * *h;
            let e = (after.velocities[p] - v0 - a0 * *h) * *h;
            let f = (a1 - a0) * (h * h);
            let (third, fourth, fifth) =
                (d * 10.0 - e * 4.0 + f * 0.5, e * 7.0 - d * 15.0 - f, d * 6.0 - e * 3.0 + f * 0.5);
            let s = share;
            let x = x0 + (v0 + a0 * (0.5 * s * h)) * (s * h) + (third + (fourth + fifth * s) * s) * (s * s * s);
            let v = v0 + a0 * (s * h) + (third * 3.0 + (fourth * 4.0 + fifth * (5.0 * s)) * s) * (s * s / h);
            apart[0] += free_square(system, p, &(sample.positions[p] - x));
            apart[1] += free_square(system, p, &(sample.velocities[p] - v));
            let rounding = 64.0 * f64::EPSILON;
            allowed[0] += 25.0 * error_x[p].norm_squared() + (rounding * x.norm()).powi(2);
            allowed[1] += 25.0 * error_v[p].norm_squared() + (rounding * v.norm()).powi(2);
        }
        let [x, v, allowed_x, allowed_v] = system.total([apart[0], apart[1], allowed[0], allowed[1]]);
        x + h * h * v <= allowed_x + h * h * allowed_v
    }
}

impl TimeStepper for Dop853<'_> {
    fn name(&self) -> &'static str {
        "dop853"
    }

    fn load_kinks(&self) -> &[f64] {
        self.system.prescribed().load_kinks()
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        StepFailure::of_arguments(self.system, state, dt)?;
        self.next.copy_from(state);
        let mut local_error = 0.0;
        let system = self.system;
        for substep in substeps(system.prescribed(), state.time, dt) {
            std::mem::swap(&mut self.base, &mut self.next);
            self.knows_first = false;
            self.advance(substep.length())?;
            self.set_estimates();
            local_error += self.position_error();
            self.next.time = substep.end;
            self.next.prescribe(system);
        }
        state.copy_from(&self.next);
        self.knows_first = false;
        self.local_error = local_error;
        Ok(())
    }

    fn restart(&mut self) {
        self.knows_first = false;
        self.knows_last = false;
    }

    /// Φ is the difference quotient of the step itself: twelve evaluations from a displaced state.
    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        let system = self.system;
        if !fits(system, error, step) {
            return false;
        }
        let twin = self.twin.get_or_insert_with(|| Box::new(Self::unchecked(system, step.before)));
        let epsilon = error.displace(system, step.before, step.length, &mut twin.base);
        if epsilon > 0.0 {
            twin.knows_first = false;
            let done = twin.advance(step.length);
            // A step that was cut at a kink is compared with one that was not, from the same state.
            let is_cut = system.prescribed().next_kink(step.before.time).is_some_and(|kink| kink < step.after.time);
            if is_cut && done.is_ok() {
                let displaced = twin.next.clone();
                twin.base.copy_from(step.before);
                twin.knows_first = false;
                if twin.advance(step.length).is_ok() {
                    error.take_difference(system, &displaced, &twin.next, epsilon);
                }
            } else if done.is_ok() {
                error.take_difference(system, &twin.next, step.after, epsilon);
            }
            self.statistics.work.force_evaluations += std::mem::take(&mut twin.statistics.work.force_evaluations);
        }
        let [x, v] = &self.estimates[0];
        error.set_local_to(system, self.local_error, [x, v]);
        error.add_local();
        true
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }
}

impl AdaptiveStepper for Dop853<'_> {
    fn try_step(&mut self, state: &State, dt: f64) -> Result<ErrorEstimate<'_>, StepFailure> {
        StepFailure::of_arguments(self.system, state, dt)?;
        // The interpolant's acceleration at the end of the last step is that at the start of this one.
        if self.knows_last {
            self.stages.swap(0, END);
            self.knows_first = true;
        }
        self.base.copy_from(state);
        self.advance(dt)?;
        self.set_estimates();
        let [[positions, velocities], _] = &self.estimates;
        Ok(ErrorEstimate { positions, velocities })
    }

    fn coarser_estimate(&self) -> Option<ErrorEstimate<'_>> {
        let [_, [positions, velocities]] = &self.estimates;
        Some(ErrorEstimate { positions, velocities })
    }

    fn accept(&mut self, state: &mut State) {
        self.next.prescribe(self.system);
        state.copy_from(&self.next);
        self.knows_first = false;
        self.local_error = self.position_error();
    }

    fn order(&self) -> u32 {
        8
    }

    fn estimate_order(&self) -> u32 {
        7
    }

    fn interpolate(&mut self, before: &State, after: &State, time: f64, sample: &mut State) {
        if after.check(self.system).is_err() || self.set_last(after).is_err() {
            return hermite(before, after, time, sample);
        }
        let share = (time - before.time) / self.h;
        self.set_sample(before, share, sample);
        if self.is_near_quintic([before, after], share, sample) {
            return;
        }
        let twin = self.twin.get_or_insert_with(|| Box::new(Self::unchecked(self.system, before)));
        twin.base.copy_from(before);
        twin.stages[0].copy_from_slice(&self.stages[0]);
        twin.knows_first = true;
        if twin.advance(time - before.time).is_ok() {
            sample.copy_from(&twin.next);
        }
        self.statistics.work.force_evaluations += std::mem::take(&mut twin.statistics.work.force_evaluations);
    }

    /// Where stability bounds the steps, errors of fast vibrations are as large as the tolerance all the time.
    fn safety_factor(&self) -> f64 {
        3.0
    }

    fn is_bounded_by_stability(&self) -> bool {
        true
    }

    fn statistics_mut(&mut self) -> &mut Statistics {
        &mut self.statistics
    }
}

#[cfg(test)]
mod tests;
