//! The local error of a step, from differences of velocities.
//!
//! The derivative at t' of the parabola through the values of y at t₋, t, t' is off by `h (h + h₋) y'''/6`, and the formula takes
//! it times τ for that of y. So its local error is
//!
//! ```text
//! e = τ h (h + h₋) y'''/6.
//! ```
//!
//! With the divided differences `v[t', t] = (v' − v)/h` and so on, `x''' ≈ 2 v[t', t, t₋]` and `v''' ≈ 6 v[t', t, t₋, t₋₋]`:
//!
//! ```text
//! e_x = ⅓ τ h (v[t', t] − v[t, t₋]),      e_v = τ h (h + h₋) v[t', t, t₋, t₋₋].
//! ```
//!
//! A step without a past is one of backward Euler, whose errors are `½ h² y''`: with the accelerations a = M⁻¹f at its start, which are
//! the divided difference `v[t, t]` of a point that counts twice,
//!
//! ```text
//! e_x = ½ h (v' − v),      e_v = h (v[t', t] − a).
//! ```
//!
//! The point counts twice in the differences of the next step too. Velocities of the formula itself are as good as those of
//! the motion here: their error is smooth, as steps damp what they do not resolve.

use super::duration;
use super::history::History;
use crate::integrate::ErrorEstimate;
use crate::system::{Axes, State, System};
use nalgebra::Vector3;

/// What an estimate needs of earlier steps, and the estimate itself.
pub(super) struct Estimate {
    /// v[t₋, t₋₋] and t₋ − t₋₋, seen from the next step; `None` where that is not known.
    span: Option<f64>,
    slopes: Vec<Vector3<f64>>,
    /// v[t, t] at the start of a step without a past, and whether the step that is tried is one.
    begins: bool,
    accelerations: Vec<Vector3<f64>>,
    positions: Vec<Vector3<f64>>,
    velocities: Vec<Vector3<f64>>,
    /// Of every particle: prescribed coordinates have no errors, and velocities that jump at the kinks of their paths.
    free: Vec<Axes>,
}

impl Estimate {
    /// Nothing known.
    pub fn new(system: &System) -> Self {
        let zeros = || vec![Vector3::zeros(); system.particles()];
        let free = (0..system.particles()).map(|p| system.dofs().free_axes(p)).collect();
        let [slopes, accelerations, positions, velocities] = [zeros(), zeros(), zeros(), zeros()];
        Self { span: None, slopes, begins: false, accelerations, positions, velocities, free }
    }

    /// Whether the step before is known well enough for an estimate.
    pub fn is_known(&self) -> bool {
        self.span.is_some()
    }

    /// Says that steps are taken whose estimates nobody asks for.
    pub fn forget(&mut self) {
        (self.span, self.begins) = (None, false);
    }

    /// Says that the step which is tried next has a past, as long as it is not rejected.
    pub fn go_on(&mut self) {
        self.begins = false;
    }

    /// Says that it has none. Returns where accelerations at its start are to be written, zero where coordinates are prescribed; the step
    /// after it is a known one.
    pub fn begin(&mut self) -> &mut [Vector3<f64>] {
        self.begins = true;
        &mut self.accelerations
    }

    /// Takes note that the step from a state is done; `history` still has the one before it.
    pub fn record(&mut self, history: &History, state: &State, ratio: f64) {
        match history.length().filter(|_| ratio > 0.0) {
            None if self.begins => {
                self.span = Some(0.0);
                self.slopes.copy_from_slice(&self.accelerations);
            }
            None => self.span = None,
            Some(_) if self.span.is_none() => {}
            Some(last) => {
                self.span = Some(last);
                let before = &history.before().velocities;
                for ((slope, v), before) in self.slopes.iter_mut().zip(&state.velocities).zip(before) {
                    *slope = (v - before) / last;
                }
            }
        }
    }

    /// That of the step of h seconds from a state to the next one; `history` has the one before it.
    pub fn of_step(&mut self, history: &History, state: &State, next: &State, h: f64, ratio: f64) -> ErrorEstimate<'_> {
        let tau = duration(h, ratio);
        let last = if ratio > 0.0 { h / ratio } else { 0.0 };
        let span = self.span.unwrap_or(0.0);
        let before = &history.before().velocities;
        for (p, v) in state.velocities.iter().enumerate() {
            let slope = (next.velocities[p] - v) / h;
            if ratio == 0.0 {
                self.positions[p] = slope * (0.5 * h * h);
                self.velocities[p] = (slope - self.accelerations[p]) * h;
                continue;
            }
            let last_slope = (v - before[p]) / last;
            let change = slope - last_slope;
            let last_change = (last_slope - self.slopes[p]) / (last + span);
            let third = (change / (h + last) - last_change) / (h + last + span);
            self.positions[p] = change * (tau * h / 3.0);
            self.velocities[p] = third * (tau * h * (h + last));
        }
        for ((position, velocity), free) in self.positions.iter_mut().zip(&mut self.velocities).zip(&self.free) {
            for axis in (0..3).filter(|&axis| !free.contains(axis)) {
                (position[axis], velocity[axis]) = (0.0, 0.0);
            }
        }
        ErrorEstimate { positions: &self.positions, velocities: &self.velocities }
    }
}

#[cfg(test)]
mod tests {
    use super::{Estimate, History};
    use crate::system::{State, System, SystemBuilder};
    use nalgebra::Vector3;

    /// A particle at 0, whose velocity is a polynomial of time.
    fn particle() -> (System, State) {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.build().unwrap()
    }

    fn at(time: f64, velocity: impl Fn(f64) -> f64) -> State {
        State { time, positions: vec![Vector3::zeros()], velocities: vec![Vector3::new(velocity(time), 0.0, 0.0)] }
    }

    /// The estimates of steps that end at the given times, the first one without a past.
    fn estimates(times: &[f64], velocity: impl Fn(f64) -> f64 + Copy, acceleration: f64) -> Vec<[f64; 2]> {
        let (system, start) = particle();
        let (mut estimate, mut history) = (Estimate::new(&system), History::new(&system, &start));
        let mut errors = Vec::new();
        for step in times.windows(2) {
            let (state, next) = (at(step[0], velocity), at(step[1], velocity));
            let h = step[1] - step[0];
            let ratio = history.length().map_or(0.0, |last| h / last);
            if ratio == 0.0 {
                estimate.begin()[0].x = acceleration;
            }
            let found = estimate.of_step(&history, &state, &next, h, ratio);
            errors.push([found.positions[0].x, found.velocities[0].x]);
            estimate.record(&history, &state, ratio);
            history.record(&state, &next, h);
        }
        errors
    }

    /// `x‴ = 2` and no error of velocities: τ h (h + h₋)/3, with τ = 2h/3 and 4h/5·… of ratios 1 and 2.
    #[test]
    fn velocities_that_are_parabolas_have_errors_of_positions_alone() {
        let found = estimates(&[0.0, 1.0, 2.0, 4.0], |t| t * t, 0.0);
        let expected = [[0.5, 1.0], [2.0 / 3.0 * 2.0 / 3.0, 0.0], [6.0 / 5.0 * 2.0 * 3.0 / 3.0, 0.0]];
        for (found, expected) in found.iter().zip(expected) {
            assert!((found[0] - expected[0]).abs() < 1e-12 && (found[1] - expected[1]).abs() < 1e-12, "{found:?}");
        }
    }

    /// `v‴ = 6`: τ h (h + h₋), from the second step on, the first point counting twice with its acceleration.
    #[test]
    fn third_differences_are_those_of_four_points() {
        let found = estimates(&[0.0, 1.0, 2.0, 4.0, 5.0], |t| t * t * t + 7.0 * t, 7.0);
        for (found, (tau, h, last)) in
            found[1..].iter().zip([(2.0 / 3.0, 1.0, 1.0), (6.0 / 5.0, 2.0, 1.0), (0.75, 1.0, 2.0)])
        {
            let expected = tau * h * (h + last);
            assert!((found[1] - expected).abs() < 1e-12 * expected, "{found:?} {expected}");
        }
    }

    /// A steady acceleration of 3: backward Euler goes ½ h² a too far.
    #[test]
    fn the_first_step_has_the_error_of_backward_euler() {
        assert_eq!(estimates(&[0.0, 0.5], |t| 3.0 * t, 3.0), [[0.375, 0.0]]);
        // v″ = 2: ½ h² v″.
        assert_eq!(estimates(&[0.0, 0.5], |t| t * t, 0.0), [[0.0625, 0.25]]);
    }

    #[test]
    fn steps_that_nobody_estimates_are_not_known() {
        let (system, start) = particle();
        let (mut estimate, mut history) = (Estimate::new(&system), History::new(&system, &start));
        assert!(!estimate.is_known());
        estimate.record(&history, &start, 0.0);
        history.record(&start, &start, 1.0);
        assert!(!estimate.is_known());
        // A step that was tried without a past is known once it is done.
        estimate.begin();
        assert!(!estimate.is_known());
        estimate.record(&history, &start, 0.0);
        assert!(estimate.is_known());
        estimate.go_on();
        estimate.record(&history, &start, 0.0);
        assert!(!estimate.is_known());
        estimate.begin();
        estimate.record(&history, &start, 0.0);
        estimate.forget();
        assert!(!estimate.is_known());
    }

    /// After a step that had no past, whatever there was before it, its start counts twice with the acceleration there.
    #[test]
    fn steps_without_a_past_leave_their_acceleration() {
        let (system, start) = particle();
        let (mut estimate, mut history) = (Estimate::new(&system), History::new(&system, &start));
        history.record(&at(0.0, |t| t), &at(1.0, |t| t), 1.0);
        for (ratio, span, slope) in [(0.0, 0.0, 5.0), (0.5, 1.0, 2.0)] {
            estimate.begin()[0].x = 5.0;
            estimate.record(&history, &at(1.0, |t| 2.0 * t), ratio);
            assert_eq!((estimate.span, estimate.slopes[0].x), (Some(span), slope));
        }
    }
}
