//! The answer that runs are measured against, with an estimate of its own error.

use super::Deadline;
use super::dop853::{dop853, kinks};
use crate::accuracy::{Configuration, StepControl, relative_position_error, trial};
use crate::error::Result;
use crate::integrate::{ImplicitOptions, Method, Status};
use crate::interrupt::Interrupt;
use crate::system::{State, System};
use serde::Serialize;
use std::time::Duration;

/// A reference solution at the end time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reference {
    /// The computation, in words.
    pub method: String,
    /// Estimate of its own [relative position error](relative_position_error). No measured error below a few times this has a meaning.
    pub error_estimate: f64,
    /// The state at the end time.
    #[serde(skip)]
    pub state: State,
}

/// Nearer to the reference than this many times its own error nothing is measured.
pub(super) const ABOVE_THE_FLOOR: f64 = 3.0;

/// Rounding of the positions: no estimate is smaller.
const ROUNDING: f64 = 1e-15;

impl Reference {
    /// Computes the state `duration` seconds after `start` within about `limit`; dt is a step that methods may begin with. `None` without any answer.
    ///
    /// DOP853 of the crate `ivp` at two tolerances a hundredfold apart; their difference, the error of the looser run, is the estimate. Where it would
    /// take longer than half the limit (stiff scenes), Richardson extrapolation of the W-method over as many halvings of dt as fit. Its estimate is the
    /// difference from the same extrapolation of implicit midpoint, or, where that does not converge, from its own at doubled steps.
    ///
    /// # Errors
    /// Coincident ends of a spring in `start`; a matrix that is too large.
    pub fn compute(system: &System, start: &State, length: [f64; 2], limit: Duration) -> Result<Option<Self>> {
        Self::within(system, start, length, limit, Interrupt::NEVER)
    }

    pub(super) fn within(
        system: &System,
        start: &State,
        [dt, duration]: [f64; 2],
        limit: Duration,
        interrupt: Interrupt,
    ) -> Result<Option<Self>> {
        let [of_library, whole] = [limit / 2, limit].map(|time| Deadline::after(time, interrupt));
        // The second tolerance gives the reference, the first tells its error.
        let solve = |tolerance| dop853(system, start, duration, tolerance, of_library);
        let Some((coarse, state)) = solve(1e-10).and_then(|coarse| Some((coarse, solve(1e-12)?))) else {
            return Self::by_extrapolation(system, start, [dt, duration], whole);
        };
        let difference = relative_position_error(&coarse.positions, &state.positions, &start.positions);
        let method = "DOP853 (ivp), relative tolerance 1e-12".into();
        Ok(Some(Self { method, error_estimate: difference.max(ROUNDING), state }))
    }

    /// By Richardson extrapolation alone, from steps of dt on; see [`compute`](Self::compute).
    ///
    /// # Errors
    /// Coincident ends of a spring in `start`; a matrix that is too large.
    pub fn by_extrapolation(
        system: &System,
        start: &State,
        length: [f64; 2],
        deadline: impl Into<Deadline>,
    ) -> Result<Option<Self>> {
        let deadline = deadline.into();
        let [dt, duration] = length;
        let mut ladders = [Method::ImplicitMidpoint, Method::W2].map(Ladder::new);
        let mut best: Option<Self> = None;
        // Between kinks of what is given in time errors are powers of the step; each interval has steps of one length.
        let mut from = start.time;
        let mut intervals: Vec<(f64, f64)> = Vec::new();
        for to in kinks(system, from, from + duration) {
            intervals.push((to, ((to - from) / dt).ceil().max(4.0)));
            from = to;
        }
        let difference = |a: &State, b: &State| relative_position_error(&a.positions, &b.positions, &start.positions);
        while ladders.iter().any(|ladder| ladder.open) && deadline.allows(Duration::ZERO) {
            for ladder in ladders.iter_mut().filter(|ladder| ladder.open) {
                ladder.climb(system, start, &intervals, deadline)?;
            }
            let steps: f64 = intervals.iter().map(|(_, steps)| steps).sum();
            // From doubled steps to these an error of third order falls by seven eighths; what is left is below a quarter of that.
            let settled = |(now, before)| 0.25 * difference(now, before);
            let candidate = match ladders.each_ref().map(Ladder::two) {
                [Some(a), Some(b)] => {
                    let apart = difference(a.0, b.0).max(settled(a)).max(settled(b));
                    Some((b.0, apart, "held to that of implicit midpoint"))
                }
                two => {
                    two.into_iter().flatten().last().map(|two| (two.0, settled(two), "held to that of doubled steps"))
                }
            };
            if let Some((state, difference, held_to)) = candidate {
                // Every step rounds the positions, and extrapolation does not take that off.
                let difference = difference.max(0.5 * f64::EPSILON * steps);
                if best.as_ref().is_none_or(|best| difference < best.error_estimate) {
                    let method = format!("Richardson extrapolation of w2 with {steps} steps, {held_to}");
                    best = Some(Self { method, error_estimate: difference.max(ROUNDING), state: state.clone() });
                }
            }
            intervals.iter_mut().for_each(|(_, steps)| *steps *= 2.0);
        }
        Ok(best)
    }
}

/// A second-order method at dt, dt/2, dt/4, …
struct Ladder {
    configuration: Configuration,
    last: Option<State>,
    /// `x(dt/2) + (x(dt/2) − x(dt))/3`, third order or better.
    extrapolated: Option<State>,
    before: Option<State>,
    /// False from the first run on for which there was no time.
    open: bool,
}

impl Ladder {
    fn new(method: Method) -> Self {
        let configuration = Configuration { method, options: ImplicitOptions::default() };
        Self { configuration, last: None, extrapolated: None, before: None, open: true }
    }

    fn two(&self) -> Option<(&State, &State)> {
        self.extrapolated.as_ref().zip(self.before.as_ref())
    }

    /// Runs through intervals, each given by its end and its number of steps.
    fn climb(&mut self, system: &System, start: &State, intervals: &[(f64, f64)], deadline: Deadline) -> Result<()> {
        let in_time = || deadline.allows(Duration::ZERO);
        let (mut state, mut wall) = (Some(start.clone()), Duration::ZERO);
        for &(end, steps) in intervals {
            let Some(begin) = state.take() else { break };
            let duration = end - begin.time;
            let control = StepControl::Step(duration / steps);
            let run = trial(system, &begin, &self.configuration, control, duration, &in_time)?;
            wall += run.wall;
            self.open = run.status != Status::Interrupted;
            state = (run.status == Status::Completed).then_some(run.state);
        }
        // The next run takes twice as long.
        self.open &= deadline.allows(2 * wall);
        self.before = self.extrapolated.take();
        self.extrapolated = self.last.as_ref().zip(state.as_ref()).map(|(coarse, fine)| {
            let mut state = fine.clone();
            let extrapolate = |to: &mut Vec<_>, from: &[_]| {
                for (fine, coarse) in to.iter_mut().zip(from) {
                    *fine += (*fine - coarse) / 3.0;
                }
            };
            extrapolate(&mut state.positions, &coarse.positions);
            extrapolate(&mut state.velocities, &coarse.velocities);
            state
        });
        self.last = state;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::fixtures::oscillator;
    use crate::system::{Curve, Loads};
    use nalgebra::Vector3;
    use std::time::Instant;

    /// From the second run on the error of the step's square is taken off: `x(dt/2) + (x(dt/2) − x(dt))/3`.
    #[test]
    fn ladders_extrapolate_by_a_third_of_the_difference() {
        let (system, start) = oscillator();
        let far = Deadline::from(Instant::now() + Duration::from_secs(7200));
        let mut ladder = Ladder::new(Method::W2);
        let (mut states, mut errors) = (Vec::<f64>::new(), Vec::new());
        for steps in [10.0, 20.0, 40.0] {
            ladder.climb(&system, &start, &[(2.0, steps)], far).unwrap();
            assert!(ladder.open);
            states.push(ladder.last.as_ref().unwrap().positions[1].x);
            let extrapolated = ladder.extrapolated.as_ref().map(|state| state.positions[1].x);
            if let [.., coarse, fine] = states[..] {
                assert_eq!(extrapolated, Some(fine + (fine - coarse) / 3.0));
                errors.push((extrapolated.unwrap() - 1.0 - 0.3 * 2.0f64.cos()).abs());
            }
        }
        assert!(ladder.two().is_some() && errors[1] < errors[0] / 4.0 && errors[1] < 1e-6, "{errors:?}");
    }

    /// A gravity pulse of a millisecond, and a step of dt that passes over it: each interval between its kinks has steps of its own.
    #[test]
    fn extrapolation_begins_anew_at_kinks() {
        let (system, start) = oscillator();
        let values = [0.0, 2000.0, 0.0].map(|x| Vector3::new(x, 0.0, 0.0)).to_vec();
        let gravity = Some(Curve { times: vec![0.4321, 0.4326, 0.4331], values });
        let system = system.with_loads(Loads { gravity, ..Loads::default() }).unwrap();
        let far = Instant::now() + Duration::from_secs(600);
        let exact = dop853(&system, &start, 1.0, 1e-12, far).unwrap().positions[1].x;
        let mut ladder = Ladder::new(Method::W2);
        let intervals = |part: f64| [0.4321, 0.4326, 0.4331, 1.0].map(|end| (end, 8.0 * part));
        for part in [1.0, 2.0, 4.0] {
            ladder.climb(&system, &start, &intervals(part), Deadline::from(far)).unwrap();
        }
        let error = (ladder.extrapolated.unwrap().positions[1].x - exact).abs();
        let deadline = Instant::now() + Duration::from_secs(1);
        let reference = Reference::by_extrapolation(&system, &start, [0.1, 1.0], deadline).unwrap().unwrap();
        assert!(error < 1e-5, "{error:e}");
        let error = (reference.state.positions[1].x - exact).abs();
        assert!(error < 1e-6 && error < 3.0 * reference.error_estimate, "{error:e} {reference:?}");
    }
}
