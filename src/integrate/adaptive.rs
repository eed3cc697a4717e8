//! Runs whose step size follows an error estimate.
//!
//! **What is controlled.** Local errors add up over a run of T seconds, so a step of h seconds may make the part h/T of the
//! error allowed (error per unit step). With e_x the estimated local error of the positions a step is accepted if
//!
//! ```text
//! e = (T/h) ‖e_x‖/(2 L rtol) ≤ 1,
//! ```
//!
//! norms being root mean squares over the particles, L the distance of particles from their centre. Then the error at the end
//! is proportional to rtol. (Control of the local error alone would leave rtol^(2/3) with a method of second order.) It is less
//! than the sum of the local errors, which partly cancel as motions swing to and fro, hence the 2: pendulums and
//! tetrahedra, damped or not, end with errors of 0.06 to 2.7 rtol.
//!
//! Velocities need no part in this. Of a smooth motion both errors come from one expansion, `e_x ∝ h³ x⃛` and `e_v` its time
//! derivative, so that what the sum of the e_v displaces by the end is of the size of the sum of the e_x. Of a stiff spring the
//! velocity error is large and displaces nothing; to count it would resolve every rattle of a cloth.
//!
//! **The next step.** e falls with h². Gustafsson's PI controller (1991) proposes `h (0.9/e)^{0.35} (e_last/e)^{0.2}`, which
//! is smoother than `h/√e`. As long as the proposal stays within a dead band around h, h is kept, and with it the matrix and
//! its factorization. A step that fails (an indefinite matrix, a collapsed spring) is tried again with a quarter of h:
//! every failure of this kind goes away with short steps, or is the run's end.
//!
//! Steps land exactly on the end of the run and on every kink of a prescribed path, where motions are not smooth.

use super::{ErrorEstimate, Monitor, Outcome, StepFailure, TimeStepper};
use crate::system::{Motion, State, System};
use nalgebra::Vector3;
use std::ops::ControlFlow;

/// A method that estimates the local error of its steps.
pub trait AdaptiveStepper: TimeStepper {
    /// Computes a step of dt seconds and estimates its error; the state is left as it is.
    ///
    /// # Errors
    /// Why the step could not be done.
    fn try_step(&mut self, state: &State, dt: f64) -> Result<ErrorEstimate<'_>, StepFailure>;

    /// Makes the end of the step tried last the current state.
    fn accept(&mut self, state: &mut State);

    /// Forgets the step tried last; counts it.
    fn reject(&mut self);
}

/// How a run with error control goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adaptivity {
    /// Length of the run, in s; positive.
    pub duration: f64,
    /// About the error of positions at the end, relative to their distance from their centre (root mean squares).
    pub rtol: f64,
    /// The first step to try, in s.
    pub first_step: f64,
    /// When the run is observed.
    pub sampling: Sampling,
}

/// When a run with error control is observed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sampling {
    /// After every accepted step.
    Steps,
    /// At multiples of an interval, in s, whatever the steps, and at the end of the run. Between the ends of a step
    /// positions are cubic Hermite polynomials, right to O(h⁴), and velocities their derivatives.
    Every(f64),
}

/// How much larger than the error at the end the sum of the local errors may be.
const CANCELLATION: f64 = 2.0;

/// Shortest step, relative to the run.
const SHORTEST: f64 = 1e-13;

/// Proposals within these factors of h keep it.
const DEAD_BAND: std::ops::RangeInclusive<f64> = 0.9..=1.3;

/// The most by which one step may be shorter or longer than the last. Positions' errors pass through zero as motions swing,
/// which must not let steps run away.
const SHRINKAGE: f64 = 0.2;
const GROWTH: f64 = 2.0;

/// Advances `state` by `how.duration` with steps that keep the error estimate within tolerance. `observe` sees a running
/// number and the state as often as `how.sampling` says, and may ask to stop.
pub fn run_adaptive(
    stepper: &mut dyn AdaptiveStepper,
    system: &System,
    state: &mut State,
    how: &Adaptivity,
    mut observe: impl FnMut(u64, &State) -> ControlFlow<()>,
) -> Outcome {
    drive(stepper, system, state, how, None, |count, state, _| observe(count, state))
}

/// As [`run_adaptive`], with a monitor that enters every accepted step before `observe` sees samples of it, and ends the run
/// when energy appears from nowhere: the state is then one from before that.
pub fn run_adaptive_monitored(
    stepper: &mut dyn AdaptiveStepper,
    system: &System,
    state: &mut State,
    how: &Adaptivity,
    monitor: &mut Monitor,
    mut observe: impl FnMut(u64, &State, &Monitor) -> ControlFlow<()>,
) -> Outcome {
    drive(stepper, system, state, how, Some(monitor), |count, state, monitor| {
        monitor.map_or(ControlFlow::Continue(()), |monitor| observe(count, state, monitor))
    })
}

fn drive(
    stepper: &mut dyn AdaptiveStepper,
    system: &System,
    state: &mut State,
    how: &Adaptivity,
    mut monitor: Option<&mut Monitor>,
    mut observe: impl FnMut(u64, &State, Option<&Monitor>) -> ControlFlow<()>,
) -> Outcome {
    let end = state.time + how.duration;
    let stops = stops(system, state.time, end);
    let mut stops = stops.iter().copied().peekable();
    let mut control = Control::new(how, state);
    let mut samples = Samples::new(how.sampling, state);
    let mut before = state.clone();
    let mut steps = 0;
    while let Some(&stop) = stops.peek() {
        let (h, lands) = control.step_towards(stop - state.time);
        let tried = stepper.try_step(state, h).map(|estimate| {
            let local = root_mean_square(estimate.positions.iter().copied()) * (state.positions.len() as f64).sqrt();
            (control.error(&estimate, state, h), local)
        });
        let failure = match tried {
            Ok((error, local)) if error <= 1.0 => {
                before.copy_from(state);
                stepper.accept(state);
                steps += 1;
                control.accepted(error, h, state);
                if lands {
                    state.time = stop;
                    state.prescribe(system);
                    stops.next();
                }
                if let Some(Err(failure)) = monitor.as_mut().map(|monitor| monitor.enter(steps, state, h, Some(local)))
                {
                    return Outcome::failed(steps, before.time, failure, steps, state, monitor);
                }
                let is_last = stops.peek().is_none();
                let mut observe = |count, sample: &State| observe(count, sample, monitor.as_deref());
                if samples.observe(system, &before, state, is_last, &mut observe).is_break() && !is_last {
                    return Outcome { steps, end: Ok(ControlFlow::Break(())) };
                }
                continue;
            }
            Ok((error, _)) => {
                control.rejected(error, h);
                StepFailure::Tolerance
            }
            Err(failure) => {
                control.failed(h);
                failure
            }
        };
        stepper.reject();
        if control.h < SHORTEST * how.duration {
            return Outcome::failed(steps + 1, state.time, failure, steps, state, monitor);
        }
    }
    Outcome { steps, end: Ok(ControlFlow::Continue(())) }
}

/// The kinks of prescribed paths between two times, and the later time itself.
fn stops(system: &System, start: f64, end: f64) -> Vec<f64> {
    let times = |motion: &'_ Motion| match motion {
        Motion::Path { times, .. } => times.clone(),
        Motion::Held | Motion::Velocity(_) => Vec::new(),
    };
    let kinks = system.prescribed().motions().iter().flat_map(times);
    let mut stops: Vec<f64> = kinks.chain([end]).filter(|&time| start < time && time <= end).collect();
    stops.sort_by(f64::total_cmp);
    stops.dedup();
    stops
}

/// The step size controller.
struct Control {
    /// The step to try next, but for landing on a stop.
    h: f64,
    rtol: f64,
    duration: f64,
    /// The largest velocity so far.
    velocity: f64,
    last_error: f64,
    /// The largest factor for the next step: after a rejection it is not to grow at once.
    growth: f64,
}

impl Control {
    fn new(how: &Adaptivity, state: &State) -> Self {
        let Adaptivity { duration, rtol, first_step, .. } = *how;
        let velocity = root_mean_square(state.velocities.iter().copied());
        Self { h: first_step.min(duration), rtol, duration, velocity, last_error: 1.0, growth: GROWTH }
    }

    /// The step to take when a stop is `distance` ahead, and whether it lands there. The last two steps share what is
    /// left, so that none is tiny.
    fn step_towards(&self, distance: f64) -> (f64, bool) {
        if distance <= self.h * 1.01 {
            (distance, true)
        } else if distance < 2.0 * self.h {
            (0.5 * distance, false)
        } else {
            (self.h, false)
        }
    }

    /// e.
    fn error(&self, estimate: &ErrorEstimate, state: &State, h: f64) -> f64 {
        let centre = state.positions.iter().sum::<Vector3<f64>>() / state.positions.len().max(1) as f64;
        let spread = root_mean_square(state.positions.iter().map(|x| x - centre));
        // A single particle has only its place and its way to be compared with.
        let alone = || root_mean_square(state.positions.iter().copied()).max(self.velocity * self.duration);
        let length = if spread > 0.0 { spread } else { alone() };
        let error = root_mean_square(estimate.positions.iter().copied());
        let error = ratio(error, length) * self.duration / (h * CANCELLATION * self.rtol);
        if error.is_nan() { f64::INFINITY } else { error }
    }

    fn accepted(&mut self, error: f64, h: f64, after: &State) {
        self.velocity = self.velocity.max(root_mean_square(after.velocities.iter().copied()));
        let error = error.max(1e-6);
        let factor = (0.9 / error).powf(0.35) * (self.last_error / error).powf(0.2);
        self.last_error = error;
        // A step shortened to land on a stop says nothing against the longer one.
        let is_full = h >= 0.9 * self.h;
        if !DEAD_BAND.contains(&factor) && (is_full || factor < 1.0) {
            self.h = h * factor.clamp(SHRINKAGE, self.growth);
        }
        self.growth = GROWTH;
    }

    fn rejected(&mut self, error: f64, h: f64) {
        self.growth = 1.0;
        self.h = h * (0.8 / error.sqrt()).clamp(SHRINKAGE, 0.8);
    }

    fn failed(&mut self, h: f64) {
        self.growth = 1.0;
        self.h = 0.25 * h;
    }
}

/// What the observer sees.
struct Samples {
    sampling: Sampling,
    start: f64,
    count: u64,
    sample: State,
}

impl Samples {
    fn new(sampling: Sampling, state: &State) -> Self {
        Self { sampling, start: state.time, count: 0, sample: state.clone() }
    }

    fn observe(
        &mut self,
        system: &System,
        before: &State,
        after: &State,
        is_last: bool,
        observe: &mut impl FnMut(u64, &State) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        if let Sampling::Every(interval) = self.sampling {
            loop {
                let time = self.start + (self.count + 1) as f64 * interval;
                // A sample within rounding of the end is the end.
                let reach = if is_last { after.time - SHORTEST * interval } else { after.time };
                if time >= reach {
                    break;
                }
                self.count += 1;
                interpolate(system, before, after, time, &mut self.sample);
                observe(self.count, &self.sample)?;
            }
            if !is_last {
                return ControlFlow::Continue(());
            }
        }
        self.count += 1;
        observe(self.count, after)
    }
}

/// The cubic Hermite polynomial through the ends of a step, and its derivative; prescribed coordinates by their motion.
fn interpolate(system: &System, before: &State, after: &State, time: f64, sample: &mut State) {
    let h = after.time - before.time;
    let s = (time - before.time) / h;
    for (p, x0) in before.positions.iter().enumerate() {
        let chord = (after.positions[p] - x0) / h;
        let (v0, v1) = (before.velocities[p], after.velocities[p]);
        // x0 + h (s v0 + s² (3c − 2v0 − v1) + s³ (v0 + v1 − 2c)), c the chord's slope.
        let (second, third) = (chord * 3.0 - v0 * 2.0 - v1, v0 + v1 - chord * 2.0);
        sample.positions[p] = x0 + (v0 + (second + third * s) * s) * (s * h);
        sample.velocities[p] = v0 + (second * 2.0 + third * (3.0 * s)) * s;
    }
    sample.time = time;
    sample.prescribe(system);
}

/// Of two numbers that are not negative; nothing out of nothing is nothing.
fn ratio(part: f64, whole: f64) -> f64 {
    if part == 0.0 { 0.0 } else { part / whole }
}

fn root_mean_square(vectors: impl ExactSizeIterator<Item = Vector3<f64>>) -> f64 {
    let count = vectors.len().max(1) as f64;
    (vectors.map(|v| v.norm_squared()).sum::<f64>() / count).sqrt()
}

#[cfg(test)]
mod tests;
