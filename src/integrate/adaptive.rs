//! Runs whose step size follows an error estimate.
//!
//! **What is controlled.** A step from x to x' is accepted if its estimated local errors e_x and e_v of positions and
//! velocities keep
//!
//! ```text
//! e = √(‖e_x‖² + (X/V)² ‖e_v‖²)/(r X) · w^((p + 1)/q) ≤ 1,      w = max(1, min(TV/X, 10), TV/(10 X)).
//! ```
//!
//! Norms are Euclidean over all particles. X is the spread `‖x − centroid‖` of the positions, and no less
//! than a hundredth of what that was before (two particles that pass each other have none for a moment), V the largest ‖v‖ so far. A motion
//! that has not begun yet has speed: V is at least `0.3 min(a₀T, √(a₀X))`, a₀ the norm of the accelerations at the start
//! of the run of T seconds. (Where there is but one place, V is at least `0.3 a₀T` and X is the way V T.)
//!
//! *Velocities have a full part in this.* X/V is the time in which a velocity error has become a position error of the same
//! relative size. A method that damps leaves hardly any position error behind in a step that misses a fast vibration, and all
//! of it in the velocity: a stiff rod or pendulum can be wrong by hundreds of times the tolerance by the end while every e_x is
//! small. The price is that a fast vibration which carries speed is resolved even where it displaces little.
//! Where a method's own estimates are known to fall short in this, e is multiplied by its [caution](AdaptiveStepper::caution).
//!
//! *Local errors add up.* With the same r in every step a method of order q whose estimate falls as h^(p + 1) ends with an error
//! of rtol^(q/(p + 1)), as steps become more the shorter they are. So `r = rtol (2 rtol)^((p + 1)/q − 1)`, and rtol above a half: of
//! a second-order method 0.14 rtol where that is 1e-2. Methods that go on with the finer of two formulas of neighbouring
//! orders have p + 1 = q, and r = rtol. In a run in which particles travel far every step may do less: errors at the end are
//! proportional to the way TV, in extents, up to about ten of them (measured on 700 random scenes with 2-, 4- and 8-th order alike), which is w.
//! The error at the end is then proportional to rtol, and ordinarily 0.01 to 1 rtol, since e_v is counted for a whole X/V and errors
//! cancel as motions swing.
//!
//! *What does not cancel* counts by itself: a method whose stages have the directions of springs from the step's start brakes the motion
//! where stiff springs turn, by as much of its energy in every step, see [`AdaptiveStepper::rotational_damping`].
//!
//! **What `rtol` promises.** An error of positions at the end of about rtol relative to their distance from their centroid,
//! where the motion does not multiply small differences: errors of all times are carried along, and a pendulum that is
//! nearly upside down, a buckling column or a folding cloth makes more of them, as it does of any difference.
//!
//! **The next step.** Gustafsson's PI controller (1991) proposes `h (0.9/e)^{0.7/(p + 1)} (e_last/e)^{0.4/(p + 1)}`, which is
//! smoother than `h e^{−1/(p + 1)}`; where stability bounds steps they keep farther away from e = 1 (see `control`). A method that saves
//! a factorization when h stays keeps it as long as the proposal is within a dead band. A step that fails (an indefinite matrix, a
//! collapsed spring) is tried again with half of h, and the steps after it come back to that length slowly: every failure of this kind
//! goes away with short steps, or is the run's end. The first step
//! is Hairer, Nørsett and Wanner's, see [`Scales::first_step`].
//!
//! **Which method** is best for few digits was measured on 730 ordinary scenes of `verification/study.md`. Of the tolerances 1e-2, 1e-3 and 1e-4 that end with at
//! most a given error the cheapest, in force evaluations, over the cheapest of all four methods, median and nine tenths of the scenes:
//!
//! | error | bdf2 | w2 | rodas4 | dop853 |
//! |---|---|---|---|---|
//! | 1e-1 | 1.7, 2.4 | 1.1, 1.7 | 1.2, 1.7 | 1.4, 7.2 |
//! | 1e-2 | 1.8, 5.1 | 1.2, 3.2 | 1.2, 1.7 | 1.4, 6.9 |
//! | 1e-3 | 3.0, 13 | 1.5, 6.7 | 1.1, 1.9 | 1.2, 5.7 |
//!
//! With 1e-2 on ready scenes of 100 to 400 particles rodas4 takes a third of the force evaluations and 0.4 of the time of w2 (cloths that swing down, 2 s: 8 100 and
//! 30 200 evaluations for 10 × 10, 10 300 and 30 200 for 20 × 20), about as long as bdf2 with a third to a fifth of its error; on lattices twice as long as w2, with a quarter of
//! its error. An explicit method is several times faster where nothing is stiff, and has no bound where something is: `--accuracy` weighs that, scene by
//! scene. So adaptive steps are those of rodas4 where no method is asked for.
//!
//! Steps land exactly on the end of the run and on every kink of a prescribed path, where motions are not smooth and methods
//! with a memory start anew.

mod control;
mod hermite;
mod samples;
mod scales;
mod stepper;

use super::{Monitor, Outcome, Status, StepFailure};
use crate::error::Invalid;
use crate::system::{State, System};
use control::Control;
pub(crate) use hermite::hermite;
use samples::Samples;
use scales::Scales;
pub(super) use scales::{joint, norm_of_all};
use std::ops::ControlFlow;
pub use stepper::{AdaptiveStepper, ErrorEstimate};

/// How a run with error control goes.
///
/// # Examples
/// ```
/// use sprung::integrate::{AdaptiveOptions, ImplicitOptions, Rodas4, run_adaptive};
/// use std::ops::ControlFlow;
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, mut state) = builder.build()?;
/// let mut stepper = Rodas4::new(&system, &state, &ImplicitOptions::default())?;
/// let how = AdaptiveOptions::new(1.0, 1e-6)?.sampled_every(0.25)?;
/// let mut times = Vec::new();
/// let outcome = run_adaptive(&mut stepper, &system, &mut state, &how, |_, sample| {
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
    /// About the error of positions at the end, relative to their distance from their centroid (Euclidean norms).
    pub rtol: f64,
    /// The first step to try, in s; `None` for one that the forces suggest.
    pub first_step: Option<f64>,
    /// When the run is observed.
    pub sampling: OutputTimes,
    /// Length of the run of which this is a part, in s: errors of all its parts add up. `None` where it is the whole.
    pub part_of: Option<f64>,
}

impl AdaptiveOptions {
    /// Of a run so long, in s, observed after every step; the first step is chosen by the forces.
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

/// When a run with error control is observed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OutputTimes {
    /// After every accepted step.
    Steps,
    /// At multiples of an interval, in s, whatever the steps, and at the end of the run. What is between the ends of a step
    /// the method [interpolates](AdaptiveStepper::interpolate).
    Every(f64),
}

/// Shortest step, relative to the run: one of 10¹⁰ steps does not end.
const SHORTEST: f64 = 1e-10;

/// Advances `state` by `how.duration` with steps that keep the error estimate within tolerance. `observe` sees a running
/// number and the state as often as `how.sampling` says, and may ask to stop.
pub fn run_adaptive(
    stepper: &mut dyn AdaptiveStepper,
    system: &System,
    state: &mut State,
    how: &AdaptiveOptions,
    mut observe: impl FnMut(u64, &State) -> ControlFlow<()>,
) -> Outcome {
    let pacing = Pacing::by_error(stepper, system, state, how);
    drive(stepper, system, state, pacing, None, |count, state, _| observe(count, state))
}

/// As [`run_adaptive`], with a monitor that enters every accepted step before `observe` sees samples of it, and ends the run
/// when energy appears from nowhere: the state is then one from before that.
pub fn run_adaptive_monitored(
    stepper: &mut dyn AdaptiveStepper,
    system: &System,
    state: &mut State,
    how: &AdaptiveOptions,
    monitor: &mut Monitor,
    mut observe: impl FnMut(u64, &State, &Monitor) -> ControlFlow<()>,
) -> Outcome {
    let pacing = Pacing::by_error(stepper, system, state, how);
    drive(stepper, system, state, pacing, Some(monitor), |count, state, monitor| {
        monitor.map_or(ControlFlow::Continue(()), |monitor| observe(count, state, monitor))
    })
}

/// How long a run's steps are, and when it is observed.
struct Pacing {
    duration: f64,
    sampling: OutputTimes,
    control: Control,
    scales: Scales,
}

impl Pacing {
    fn by_error(stepper: &mut dyn AdaptiveStepper, system: &System, state: &State, how: &AdaptiveOptions) -> Self {
        let orders = [stepper.order(), stepper.estimate_order()];
        let (scales, forces) = Scales::at_start(system, state, how, orders);
        stepper.statistics_mut().work.force_evaluations += forces;
        let first = how.first_step.unwrap_or_else(|| {
            let (step, forces) = scales.first_step(system, state, how, stepper.estimate_order());
            stepper.statistics_mut().work.force_evaluations += forces;
            step
        });
        let AdaptiveOptions { duration, sampling, .. } = *how;
        Self { duration, sampling, control: Control::new(first, duration), scales }
    }
}

fn drive(
    stepper: &mut dyn AdaptiveStepper,
    system: &System,
    state: &mut State,
    pacing: Pacing,
    mut monitor: Option<&mut Monitor>,
    mut observe: impl FnMut(u64, &State, Option<&Monitor>) -> ControlFlow<()>,
) -> Outcome {
    let Pacing { duration, sampling, mut control, mut scales } = pacing;
    let end = state.time + duration;
    let mut samples = Samples::new(sampling, state);
    let mut before = state.clone();
    let mut steps = 0;
    let stiffness = stiffness(system);
    stepper.restart();
    while state.time < end {
        let stop = system.prescribed().next_kink(state.time).map_or(end, |kink| kink.min(end));
        let (h, lands) = control.step_towards(stop - state.time);
        let failure = match try_step(stepper, system, &stiffness, &scales, state, h) {
            Ok(Tried { error, doubt }) if error <= 1.0 => {
                before.copy_from(state);
                if let Some(monitor) = &mut monitor {
                    monitor.begin_step(state);
                }
                stepper.accept(state);
                steps += 1;
                control.accepted(error, h, stepper);
                scales.see(state);
                if lands {
                    state.time = stop;
                    state.prescribe(system);
                }
                let enter = |monitor: &mut &mut Monitor| {
                    monitor.doubt(doubt);
                    monitor.propagate(stepper, state, h);
                    monitor.enter(steps, state, h)
                };
                if let Some(Err(failure)) = monitor.as_mut().map(enter) {
                    return Outcome::failed(steps, before.time, failure, steps, state, monitor);
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
            Ok(Tried { error, .. }) => {
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
        if control.h < SHORTEST * duration {
            return Outcome::failed(steps + 1, state.time, failure, steps, state, monitor);
        }
    }
    Outcome { steps, end: Ok(ControlFlow::Continue(())) }
}

/// What is known of a step that has been tried.
struct Tried {
    /// e.
    error: f64,
    /// The energy that the error is worth, in J.
    doubt: f64,
}

fn try_step(
    stepper: &mut dyn AdaptiveStepper,
    system: &System,
    stiffness: &[f64],
    scales: &Scales,
    state: &State,
    h: f64,
) -> Result<Tried, StepFailure> {
    let estimate = stepper.try_step(state, h)?;
    let doubt = doubt(system, stiffness, &estimate, state);
    let fine = scales.error(&estimate, state);
    let coarse = stepper.coarser_estimate().map(|estimate| scales.error(&estimate, state));
    let error = stepper.caution() * coarse.map_or(fine, |coarse| scales::joint(fine, coarse));
    let error = error.hypot(scales.lag(stepper.rotational_damping(), h, state));
    Ok(Tried { error, doubt })
}

/// `Σ 2 m (‖v‖ + 5 ‖e_v‖) ‖e_v‖ + 10 κ ‖e_x‖²` over the particles, κ being the sum of k/l0 of the springs at each: see `monitor/growth`.
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

#[cfg(test)]
mod tests;
