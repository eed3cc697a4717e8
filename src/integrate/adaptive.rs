//! Runs whose step size follows an error estimate.
//!
//! **Error.** A step from x to x' is accepted if its estimated local errors e_x and e_v of positions and velocities keep
//!
//! ```text
//! e = √(‖e_x‖² + (X/V)² ‖e_v‖²)/(r X) · w^((p + 1)/q) ≤ 1,      w = max(1, min(TV/X, 10), TV/(10 X)),
//! ```
//!
//! times the method's [safety factor](AdaptiveStepper::safety_factor). Norms are Euclidean over all particles. X is the spread `‖x − centroid‖` of
//! the positions, and no less than a hundredth of its largest value so far (two particles that pass each other have none for a moment). V is the
//! largest ‖v‖ so far, and at least `0.3 min(a₀T, √(a₀X))`, a₀ the norm of the accelerations at the start of the run of T seconds. (Where all
//! particles are at one place, V is at least `0.3 a₀T` and X is V T.) X/V is the time in which a velocity error becomes a position error of the same
//! relative size.
//!
//! *Local errors add up.* With the same r in every step a method of order q whose estimate falls as h^(p + 1) ends with an error of rtol^(q/(p + 1)).
//! So `r = rtol (2 rtol)^((p + 1)/q − 1)`, and rtol above a half. Errors at the end are proportional to the path length TV in extents, up to about
//! ten of them: the factor w, measured on random scenes (`verification/study.md`).
//!
//! **The next step.** Gustafsson's PI controller (1991) proposes `h (0.9/e)^{0.7/(p + 1)} (e_last/e)^{0.4/(p + 1)}`, see `step_size`. A method that
//! saves a factorization when h stays keeps it as long as the proposal is within a dead band. A step that fails (an indefinite matrix, a collapsed
//! spring) is tried again with half of h, and later steps come back to that length slowly.
//!
//! Steps land exactly on the end of the run and on every kink of a prescribed path, where methods with a memory start anew.

mod scales;
mod step_size;

use super::{Monitor, Outcome, Statistics, Status, StepFailure, TimeStepper, is_end};
use crate::error::Invalid;
use crate::system::{State, System};
use nalgebra::Vector3;
use scales::Scales;
pub(super) use scales::joint;
use std::ops::ControlFlow;
use step_size::Control;

/// Options of a run with error control.
///
/// # Examples
/// ```
/// use sprung::integrate::{AdaptiveOptions, ImplicitOptions, Rodas4, run_adaptive};
/// use std::ops::ControlFlow;
///
/// # let mut builder = sprung::SystemBuilder::new();
/// # [0.0, 1.0].map(|x| builder.particle([x, 0.0, 0.0], 1.0));
/// # builder.hold(0).spring(0, 1, sprung::Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// let (system, mut state) = builder.build()?;
/// let mut stepper = Rodas4::new(&system, &state, &ImplicitOptions::default())?;
/// let options = AdaptiveOptions::new(1.0, 1e-6)?.sampled_every(0.25)?;
/// let mut times = Vec::new();
/// let outcome = run_adaptive(&mut stepper, &system, &mut state, &options, |_, sample| {
///     times.push(sample.time);
///     ControlFlow::Continue(())
/// });
/// assert_eq!(outcome.status().name(), "completed");
/// assert_eq!(times, [0.25, 0.5, 0.75, 1.0]);
/// assert!((state.positions[1].x - (2.0 - 10.0_f64.sqrt().cos())).abs() < 1e-5);
/// assert!(AdaptiveOptions::new(1.0, 0.0).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdaptiveOptions {
    /// Length of the run, in s; positive.
    pub duration: f64,
    /// About the error of positions at the end, relative to their distance from their centroid, where the motion does not magnify small differences.
    pub rtol: f64,
    /// The first step to try, in s; `None` for one that the forces suggest.
    pub first_step: Option<f64>,
    /// When the run is observed.
    pub sampling: OutputTimes,
    /// Length of the run of which this is a part, in s: errors of all its parts add up. `None` where it is the whole.
    pub part_of: Option<f64>,
}

impl AdaptiveOptions {
    /// A run of this length, in s, observed after every step; the forces suggest the first step.
    ///
    /// # Errors
    /// [`Invalid`] for a duration that is not positive and finite, or an `rtol` that does not lie between 0 and 1.
    pub fn new(duration: f64, rtol: f64) -> Result<Self, Invalid> {
        if !(duration.is_finite() && duration > 0.0) {
            return Err(Invalid::new("duration", duration, "must be finite and positive"));
        }
        if !(rtol > 0.0 && rtol < 1.0) {
            return Err(Invalid::new("rtol", rtol, "must lie between 0 and 1"));
        }
        Ok(Self { duration, rtol, first_step: None, sampling: OutputTimes::Steps, part_of: None })
    }

    /// The same, observed every so many seconds, whatever the steps.
    ///
    /// # Errors
    /// [`Invalid`] for an interval that is not positive and finite.
    pub fn sampled_every(self, interval: f64) -> Result<Self, Invalid> {
        if !(interval.is_finite() && interval > 0.0) {
            return Err(Invalid::new("interval", interval, "must be finite and positive"));
        }
        Ok(Self { sampling: OutputTimes::Every(interval), ..self })
    }
}

/// The times at which a run with error control is observed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OutputTimes {
    /// After every accepted step.
    Steps,
    /// At multiples of an interval, in s, and at the end of the run; within steps by [interpolation](AdaptiveStepper::interpolate).
    Every(f64),
}

/// An estimate of the local error of a step, full-length; zero where coordinates are prescribed.
#[derive(Debug, Clone, Copy)]
pub struct ErrorEstimate<'a> {
    /// Errors of the positions, in m.
    pub positions: &'a [Vector3<f64>],
    /// Errors of the velocities, in m/s.
    pub velocities: &'a [Vector3<f64>],
}

/// A method that estimates the local error of its steps.
///
/// A step is tried, and then accepted or rejected. [`TimeStepper::restart`] is called where the motion is not smooth.
pub trait AdaptiveStepper: TimeStepper {
    /// Computes a step of dt seconds and estimates its error; the state is left as it is.
    ///
    /// # Errors
    /// The reason why the step could not be done.
    fn try_step(&mut self, state: &State, dt: f64) -> Result<ErrorEstimate<'_>, StepFailure>;

    /// Another estimate ẽ for the step tried last, of lower order. With one the error e of the first counts as `e²/√(e² + 0.01 ẽ²)`, after Hairer.
    fn coarser_estimate(&self) -> Option<ErrorEstimate<'_>> {
        None
    }

    /// Makes the end of the step tried last the current state.
    fn accept(&mut self, state: &mut State);

    /// Forgets the step tried last.
    fn reject(&mut self) {}

    /// q, the method's order: the power of h with which the error at a fixed time falls.
    fn order(&self) -> u32;

    /// The p for which the estimate of the step tried last falls as h^(p + 1). Before the first step, that of the method.
    fn estimate_order(&self) -> u32 {
        self.order()
    }

    /// The factor of the estimates: formulas that damp fast vibrations as the method itself does fall short of its errors.
    fn safety_factor(&self) -> f64 {
        1.0
    }

    /// The share of the kinetic energy that the linearisation took from springs that turn in the step tried last; the estimate does not see it.
    fn rotational_damping(&self) -> f64 {
        0.0
    }

    /// A step as long as the last one saves work, as a factorization.
    fn reuses_factorization(&self) -> bool {
        false
    }

    /// Stability bounds the steps, as those of explicit methods.
    fn is_bounded_by_stability(&self) -> bool {
        false
    }

    /// The largest factor from one step to the next.
    fn largest_growth(&self) -> f64 {
        5.0
    }

    /// Sets `sample` to the motion at a time within the step accepted last, from `before` to `after`; prescribed coordinates need not be right. By
    /// default the cubic Hermite polynomial through both ends, right to O(h⁴).
    fn interpolate(&mut self, before: &State, after: &State, time: f64, sample: &mut State) {
        hermite(before, after, time, sample);
    }

    /// The statistics, to which the run adds.
    fn statistics_mut(&mut self) -> &mut Statistics;
}

/// The cubic Hermite polynomial through the ends of a step, and its derivative.
pub(crate) fn hermite(before: &State, after: &State, time: f64, sample: &mut State) {
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
}

/// Shortest step, relative to the run: one of 10¹⁰ steps does not end.
const SHORTEST: f64 = 1e-10;

/// Advances `state` by `options.duration` with steps that keep the error estimate within tolerance. `observe` sees a running number and the state
/// as often as `options.sampling` says, and may ask to stop.
pub fn run_adaptive(
    stepper: &mut dyn AdaptiveStepper,
    system: &System,
    state: &mut State,
    options: &AdaptiveOptions,
    mut observe: impl FnMut(u64, &State) -> ControlFlow<()>,
) -> Outcome {
    drive(stepper, system, state, options, None, |count, state, _| observe(count, state))
}

/// As [`run_adaptive`], with a monitor, as [`run_monitored`](super::run_monitored) has it.
pub fn run_adaptive_monitored(
    stepper: &mut dyn AdaptiveStepper,
    system: &System,
    state: &mut State,
    options: &AdaptiveOptions,
    monitor: &mut Monitor,
    mut observe: impl FnMut(u64, &State, &Monitor) -> ControlFlow<()>,
) -> Outcome {
    drive(stepper, system, state, options, Some(monitor), |count, state, monitor| {
        monitor.map_or(ControlFlow::Continue(()), |monitor| observe(count, state, monitor))
    })
}

fn drive(
    stepper: &mut dyn AdaptiveStepper,
    system: &System,
    state: &mut State,
    options: &AdaptiveOptions,
    mut monitor: Option<&mut Monitor>,
    mut observe: impl FnMut(u64, &State, Option<&Monitor>) -> ControlFlow<()>,
) -> Outcome {
    let mut scales = Scales::at_start(system, state, options, [stepper.order(), stepper.estimate_order()]);
    let suggested = || scales.first_step(system, state, options, stepper.estimate_order());
    let (first, forces) = options.first_step.map_or_else(suggested, |step| (step, 0));
    stepper.statistics_mut().work.force_evaluations += 1 + forces;
    let mut control = Control::new(first, options.duration);
    let end = state.time + options.duration;
    let mut samples = Samples { sampling: options.sampling, start: state.time, count: 0, sample: state.clone() };
    let mut before = state.clone();
    let mut steps = 0;
    let stiffness = stiffness(system);
    stepper.restart();
    while state.time < end {
        let stop = system.prescribed().next_kink(state.time).map_or(end, |kink| kink.min(end));
        let (h, lands) = control.step_towards(stop - state.time);
        let failure = match try_step(stepper, system, &stiffness, &scales, state, h) {
            Ok((error, doubt)) if error <= 1.0 => {
                before.copy_from(state);
                stepper.accept(state);
                steps += 1;
                control.accepted(error, h, stepper);
                scales.see(state);
                if lands {
                    state.time = stop;
                    state.prescribe(system);
                }
                if let Some(monitor) = &mut monitor {
                    monitor.doubt(doubt);
                    monitor.propagate(stepper, state, h);
                    if let Err(failure) = monitor.enter(steps, state, h) {
                        return Outcome::failed(steps, before.time, failure, steps, state, Some(monitor));
                    }
                }
                let is_last = state.time >= end;
                let mut observe = |count, sample: &State| observe(count, sample, monitor.as_deref());
                let seen = samples.observe(system, stepper, &before, state, is_last, &mut observe);
                if seen.is_break() && !is_last {
                    return Outcome { steps, end: Ok(ControlFlow::Break(())) };
                }
                if lands && !is_last {
                    stepper.restart();
                }
                continue;
            }
            Ok((error, _)) => {
                control.rejected(error, h, stepper);
                StepFailure::Tolerance
            }
            Err(failure) if failure.status() == Status::Interrupted => {
                return Outcome { steps, end: Ok(ControlFlow::Break(())) };
            }
            Err(failure) => {
                control.failed(h);
                failure
            }
        };
        stepper.reject();
        stepper.statistics_mut().rejected_steps += 1;
        if control.h < SHORTEST * options.duration {
            return Outcome::failed(steps + 1, state.time, failure, steps, state, monitor);
        }
    }
    Outcome { steps, end: Ok(ControlFlow::Continue(())) }
}

/// Tries a step of h seconds: e, and the energy that the error is worth, in J.
fn try_step(
    stepper: &mut dyn AdaptiveStepper,
    system: &System,
    stiffness: &[f64],
    scales: &Scales,
    state: &State,
    h: f64,
) -> Result<(f64, f64), StepFailure> {
    let estimate = stepper.try_step(state, h)?;
    let doubt = doubt(system, stiffness, &estimate, state);
    let fine = scales.error(&estimate, state);
    let coarse = stepper.coarser_estimate().map(|estimate| scales.error(&estimate, state));
    let error = stepper.safety_factor() * coarse.map_or(fine, |coarse| joint(fine, coarse));
    Ok((error.hypot(scales.lag(stepper.rotational_damping(), h, state)), doubt))
}

/// `Σ 2 m (‖v‖ + 5 ‖e_v‖) ‖e_v‖ + 10 κ ‖e_x‖²`, κ the sum of k/l0 of the springs at a particle: see `monitor/instability`.
fn doubt(system: &System, stiffness: &[f64], estimate: &ErrorEstimate, state: &State) -> f64 {
    let of_velocities = system.masses().iter().zip(estimate.velocities).zip(&state.velocities);
    let kinetic = of_velocities.map(|((mass, e), v)| 2.0 * mass * (v.norm() + 5.0 * e.norm()) * e.norm());
    let elastic = stiffness.iter().zip(estimate.positions).map(|(stiffness, e)| 10.0 * stiffness * e.norm_squared());
    kinetic.sum::<f64>() + elastic.sum::<f64>()
}

/// The sum of k/l0 of the springs at every particle, in N/m.
fn stiffness(system: &System) -> Vec<f64> {
    let mut sums = vec![0.0; system.particles()];
    for (_, ends, spring) in system.active() {
        ends.into_iter().for_each(|p| sums[p] += spring.axial_stiffness());
    }
    sums
}
struct Samples {
    sampling: OutputTimes,
    start: f64,
    count: u64,
    sample: State,
}

impl Samples {
    fn observe(
        &mut self,
        system: &System,
        stepper: &mut dyn AdaptiveStepper,
        before: &State,
        after: &State,
        is_last: bool,
        observe: &mut impl FnMut(u64, &State) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        // An interval that is not positive has no multiples.
        if let OutputTimes::Every(interval) = self.sampling
            && interval > 0.0
        {
            loop {
                let time = self.start + (self.count + 1) as f64 * interval;
                if time >= after.time || is_last && is_end(time, [self.start, after.time]) {
                    break;
                }
                self.count += 1;
                stepper.interpolate(before, after, time, &mut self.sample);
                self.sample.time = time;
                self.sample.prescribe(system);
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

#[cfg(test)]
mod tests;
