//! The last step, as long as it says something about the next one, and the local error of a step by differences of velocities.
//!
//! **A step has no past** that starts at a kink of a path, of gravity or of a rest length, or whose interior or whose last step's interior holds one:
//! velocities or the rates of forces jump there. (A path with kinks in both steps is a curve given by points closer than steps resolve them, and does
//! not count, unless the step is too long beside the last one.) Nor has a step a past that starts from a state where the last one did not end.
//!
//! **Local error.** The derivative at t' of the parabola through the values of y at t₋, t, t' is off by `h (h + h₋) y'''/6`, and the formula takes it
//! times τ for that of y: `e = τ h (h + h₋) y'''/6`. With the divided differences `v[t', t] = (v' − v)/h` and so on,
//!
//! ```text
//! e_x = ⅓ τ h (v[t', t] − v[t, t₋]),      e_v = τ h (h + h₋) v[t', t, t₋, t₋₋].
//! ```
//!
//! A step without a past is one of backward Euler with the error `½ h² y''`: with the accelerations a = M⁻¹f at its start as the divided difference
//! `v[t, t]` of a point that counts twice, in the differences of the next step too,
//!
//! ```text
//! e_x = ½ h (v' − v),      e_v = h (v[t', t] − a).
//! ```

use super::duration;
use crate::integrate::schedule::SAME;
use crate::integrate::{ErrorEstimate, zero_prescribed};
use crate::system::{Dof, State, System};
use nalgebra::Vector3;

/// The largest ratio of a step to the last one, safely below 1 + √2.
pub(super) const MOST_GROWTH: f64 = 2.0;

/// The last step.
pub(super) struct History {
    /// Its length, in s; `None` when there was none.
    length: Option<f64>,
    pub before: State,
    after: State,
    /// The kinks of all paths, of gravity and of rest lengths, ascending, in s.
    kinks: Vec<f64>,
}

impl History {
    pub fn new(system: &System, state: &State) -> Self {
        Self { length: None, before: state.clone(), after: state.clone(), kinks: system.prescribed().kinks() }
    }

    /// ω of a step of h seconds from a state: its ratio to the last step, or zero where it has no past.
    pub fn ratio(&self, system: &System, state: &State, h: f64) -> f64 {
        match self.length {
            Some(last) if self.ends_at(system, state, h) && !self.is_broken(state.time, last, h) => h / last,
            _ => 0.0,
        }
    }

    /// True if a kink separates the step of h seconds from time t from the last one.
    fn is_broken(&self, t: f64, last: f64, h: f64) -> bool {
        let tolerance = SAME * h.min(last);
        let between = |from: f64, to: f64| {
            let next = self.kinks.partition_point(|&kink| kink < from);
            self.kinks.get(next).is_some_and(|&kink| kink < to)
        };
        let now = between(t - tolerance, t + h - tolerance);
        let before = between(t - last - tolerance, t - tolerance) && h <= MOST_GROWTH * last;
        let inside = between(t - last + tolerance, t - tolerance);
        (now || inside) && !(now && before)
    }

    /// True if a state is the end of the last step. Its time may have been rounded otherwise, and prescribed coordinates with it.
    fn ends_at(&self, system: &System, state: &State, h: f64) -> bool {
        let after = &self.after;
        let rounding = SAME * h + 4.0 * f64::EPSILON * state.time.abs();
        let is_same = |dof: Dof| {
            let (p, axis) = (dof.particle, dof.axis);
            state.positions[p][axis] == after.positions[p][axis]
                && state.velocities[p][axis] == after.velocities[p][axis]
        };
        (state.time - after.time).abs() <= rounding && system.dofs().iter().all(is_same)
    }

    pub fn clear(&mut self) {
        self.length = None;
    }

    pub fn record(&mut self, before: &State, after: &State, h: f64) {
        self.length = Some(h);
        self.before.copy_from(before);
        self.after.copy_from(after);
    }
}

/// The estimate of a step, and the differences of earlier steps in it.
pub(super) struct Estimate {
    /// v[t₋, t₋₋] and t₋ − t₋₋, seen from the next step; `None` where that is not known.
    span: Option<f64>,
    slopes: Vec<Vector3<f64>>,
    /// True if the step that is tried has no past.
    pub is_first: bool,
    /// v[t, t] at its start, zero where coordinates are prescribed.
    pub accelerations: Vec<Vector3<f64>>,
    positions: Vec<Vector3<f64>>,
    velocities: Vec<Vector3<f64>>,
}

impl Estimate {
    pub fn new(system: &System) -> Self {
        let zeros = || vec![Vector3::zeros(); system.particles()];
        let [slopes, accelerations, positions, velocities] = [zeros(), zeros(), zeros(), zeros()];
        Self { span: None, slopes, is_first: false, accelerations, positions, velocities }
    }

    pub fn is_known(&self) -> bool {
        self.span.is_some()
    }

    pub fn clear(&mut self) {
        (self.span, self.is_first) = (None, false);
    }

    /// Records that the step from a state is done; `history` still has the one before it.
    pub fn record(&mut self, history: &History, state: &State, ratio: f64) {
        match history.length.filter(|_| ratio > 0.0) {
            None if self.is_first => {
                self.span = Some(0.0);
                self.slopes.copy_from_slice(&self.accelerations);
            }
            None => self.span = None,
            Some(_) if self.span.is_none() => {}
            Some(last) => {
                self.span = Some(last);
                let before = &history.before.velocities;
                for ((slope, v), before) in self.slopes.iter_mut().zip(&state.velocities).zip(before) {
                    *slope = (v - before) / last;
                }
            }
        }
    }

    /// The estimate for the step of h seconds from a state to the next one; `history` has the one before it.
    pub fn of_step(
        &mut self,
        system: &System,
        history: &History,
        [state, next]: [&State; 2],
        h: f64,
        ratio: f64,
    ) -> ErrorEstimate<'_> {
        let tau = duration(h, ratio);
        let last = if ratio > 0.0 { h / ratio } else { 0.0 };
        let span = self.span.unwrap_or(0.0);
        let before = &history.before.velocities;
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
        zero_prescribed(system, &mut self.positions);
        zero_prescribed(system, &mut self.velocities);
        ErrorEstimate { positions: &self.positions, velocities: &self.velocities }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::fixtures::{particles, scene};
    use crate::system::{Axes, Constraint, Motion};

    /// A free particle and one on a path with kinks at the given times.
    fn with_kinks(times: &[f64]) -> (System, State) {
        let mut builder = scene(&[([0.0; 3], 1.0), ([1.0, 0.0, 0.0], 1.0)], &[]);
        let motion = Motion::Path { times: times.to_vec(), offsets: vec![Vector3::zeros(); times.len()] };
        builder.constrain(Constraint { particles: vec![1], axes: Axes::ALL, motion });
        builder.build().unwrap()
    }

    /// The ratio of a step of `h` from time t after one of `last`, on a path with the given kinks.
    fn ratio(kinks: &[f64], t: f64, last: f64, h: f64) -> f64 {
        let (system, start) = with_kinks(kinks);
        let (before, after) = (State { time: t - last, ..start.clone() }, State { time: t, ..start });
        let mut history = History::new(&system, &before);
        assert_eq!(history.ratio(&system, &before, last), 0.0);
        history.record(&before, &after, last);
        history.ratio(&system, &after, h)
    }

    /// The last step is from 1 to 1.5, this one to 2. Within the tolerance of the start is inside, within that of the end is not; the tolerance is
    /// relative to the shorter step. Kinks before the last step do not count; curves of many points have none.
    #[test]
    fn steps_after_kinks_have_no_past() {
        let with =
            [&[0.9][..], &[1.0], &[2.0], &[2.1], &[2.0 - 0.5e-9], &[1.0, 1.5, 2.0], &[1.1, 1.6], &[1.1, 1.3, 1.7]];
        let without = [&[1.1][..], &[1.5], &[1.9], &[0.2, 1.7], &[1.5 - 0.5e-9], &[1.1, 1.2, 2.3]];
        for (kinks, expected) in with.map(|kinks| (kinks, 1.0)).into_iter().chain(without.map(|kinks| (kinks, 0.0))) {
            assert_eq!(ratio(kinks, 1.5, 0.5, 0.5), expected, "{kinks:?}");
        }
        assert_eq!([0.25, 1.0].map(|h| ratio(&[99.0], 1.0, 0.5, h)), [0.5, 2.0]);
        let short = 2f64.powi(-10);
        assert_eq!([1e-7, 1e-13].map(|before| ratio(&[1.5 + short - before], 1.5, short, short)), [0.0, 1.0]);
        // A step that is too long beside the last one does not follow the curve.
        assert_eq!([1.0, 1.01].map(|h| ratio(&[1.0, 1.5], 1.5, 0.5, h)), [2.0, 0.0]);
    }

    /// Another position, velocity or time of a free particle; times may have been rounded, and prescribed positions with them.
    #[test]
    fn the_past_ends_where_the_state_was_changed() {
        let (system, before) = with_kinks(&[99.0]);
        let after = State { time: 1e3, ..before.clone() };
        let mut history = History::new(&system, &before);
        history.record(&before, &after, 0.5);
        let ratio = |change: &dyn Fn(&mut State)| {
            let mut state = after.clone();
            change(&mut state);
            history.ratio(&system, &state, 0.5)
        };
        assert_eq!(ratio(&|state| state.positions[1].x += 1e-9), 1.0);
        assert_eq!(ratio(&|state| state.time += 2e-10), 1.0);
        assert_eq!(ratio(&|state| state.time += 1e-8), 0.0);
        assert_eq!(ratio(&|state| state.positions[0].z += 1e-9), 0.0);
        assert_eq!(ratio(&|state| state.velocities[0].y += 1e-9), 0.0);
        // Rounding of a millisecond's step and of a time of a quarter of an hour: 1.0e-12 s and 0.9e-12 s.
        let later = |by: f64| history.ratio(&system, &State { time: 1e3 + by, ..after.clone() }, 2f64.powi(-10));
        assert!(later(1.6e-12) > 0.0 && later(2.5e-12) == 0.0 && later(1e-9) == 0.0);
    }

    /// The estimates of steps of a particle at 0 that end at the given times, the first one without a past.
    fn estimates(times: &[f64], velocity: impl Fn(f64) -> f64, acceleration: f64) -> Vec<[f64; 2]> {
        let (system, start) = particles(&[0.0]);
        let at = |time: f64| State { time, velocities: vec![Vector3::x() * velocity(time)], ..start.clone() };
        let (mut estimate, mut history) = (Estimate::new(&system), History::new(&system, &start));
        let mut errors = Vec::new();
        for step in times.windows(2) {
            let (state, next) = (at(step[0]), at(step[1]));
            let h = step[1] - step[0];
            let ratio = history.length.map_or(0.0, |last| h / last);
            if ratio == 0.0 {
                estimate.is_first = true;
                estimate.accelerations[0].x = acceleration;
            }
            let found = estimate.of_step(&system, &history, [&state, &next], h, ratio);
            errors.push([found.positions[0].x, found.velocities[0].x]);
            estimate.record(&history, &state, ratio);
            history.record(&state, &next, h);
        }
        errors
    }

    /// The first step is one of backward Euler, which goes ½ h² a too far. After it the errors are `τ h (h + h₋) y‴/6`, with τ = 2/3 and 6/5 s
    /// for ratios 1 and 2: for `v = t²` of positions alone, for `v = t³ + 7t` of velocities too, the first point counting twice with its
    /// acceleration.
    #[test]
    fn estimates_are_the_errors_of_polynomials() {
        assert_eq!(estimates(&[0.0, 0.5], |t| 3.0 * t, 3.0), [[0.375, 0.0]]);
        let found = estimates(&[0.0, 1.0, 2.0, 4.0], |t| t * t, 0.0);
        let expected = [[0.5, 1.0], [2.0 / 3.0 * 2.0 / 3.0, 0.0], [6.0 / 5.0 * 2.0 * 3.0 / 3.0, 0.0]];
        assert!(
            found.as_flattened().iter().zip(expected.as_flattened()).all(|(a, b)| (a - b).abs() < 1e-12),
            "{found:?}"
        );
        let found = estimates(&[0.0, 1.0, 2.0, 4.0, 5.0], |t| t * t * t + 7.0 * t, 7.0);
        for (found, expected) in found[1..].iter().zip([2.0 / 3.0 * 2.0, 6.0 / 5.0 * 2.0 * 3.0, 0.75 * 3.0]) {
            assert!((found[1] - expected).abs() < 1e-12 * expected, "{found:?} {expected}");
        }
    }
}
