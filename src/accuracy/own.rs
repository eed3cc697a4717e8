//! What a run says of its own error, with no other run beside it.
//!
//! Figures that [accompany every run](crate::integrate::Figures) add up what its steps neglect. A vibration of frequency ω and amplitude A is told by
//! [Verlet's method](crate::integrate::Verlet) with a phase that is off by `(ωh)²/24` of itself, by `A ω³ h² T/24` after the time T. That is
//! what the changes of velocities from step to step add up to, whatever they are made of:
//!
//! ```text
//! E = (1/24) Σ h ‖(v' − v) − (v − v₋)‖.
//! ```
//!
//! Once phases are lost the error is 2A at most. In N steps E of it is `N (ωh)³ A/24`, so that E counts with `48/(N z³)` where that is less
//! than one, z being ωh of velocities in the mean; with no less than a part of itself, as a mean says little of what is slower. BDF2 errs by
//! what its positions are off from the trapezoidal rule of its velocities.
//!
//! Neither knows what a motion makes of errors. What goes far bends far, so that the way of the particles, in extents of the scene, counts
//! where it is above one, and nothing is said of runs in which ends of springs pass each other within a step. What buckles is for others to
//! see: [`stability`](super::stability).
//!
//! (Half of the runs by Verlet's method of the study's thousand scenes err by at most 0.9 E, nine of ten by at most 2 E. Of 1233 answers to
//! them that are believed by this three are wrong, by up to 2.0; constants were set by these scenes. Own derivation.)

use crate::integrate::{Figures, Method};

/// What is multiplied with the figures: of Verlet's method, and of BDF2.
const SAFETY: [f64; 2] = [3.0, 4.0];

/// The part of E that counts at least. (With a tenth an answer is wrong by 20.)
const LEAST_PART: f64 = 0.2;

/// The longest that the ends of a spring may get past each other in a step, in its lengths.
const PASSING: f64 = 0.5;

/// Estimates of the error at the end, relative to the extent; infinite where there are none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Own {
    /// What the steps neglect, added up.
    pub neglected: f64,
    /// How far the particles went, in extents, or one: what they may have magnified it by.
    pub way: f64,
    /// What is believed of the error.
    pub error: f64,
}

impl Own {
    /// Of a run by its figures.
    pub fn of(figures: &Figures, method: Method) -> Self {
        let way = figures.way.max(1.0);
        let [verlet, bdf2] = SAFETY;
        let (neglected, error) = match method {
            Method::Verlet => {
                let neglected = figures.bend / 24.0;
                let part = (48.0 / (figures.steps as f64 * figures.pace().powi(3))).clamp(LEAST_PART, 1.0);
                let believed = figures.reach <= PASSING;
                (neglected, if believed { verlet * way * part * neglected } else { f64::INFINITY })
            }
            Method::Bdf2 => {
                let neglected = figures.estimate(method).unwrap_or(f64::INFINITY);
                (neglected, bdf2 * way * neglected)
            }
            _ => (f64::INFINITY, f64::INFINITY),
        };
        // What is beyond all numbers is not small.
        Self { neglected, way, error: if error.is_nan() { f64::INFINITY } else { error } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::{ImplicitOptions, Monitor, MonitorOptions, Schedule, run_monitored};
    use crate::system::State;
    use crate::system::fixtures::oscillator;
    use std::ops::ControlFlow;

    fn figures(method: Method, steps: f64, duration: f64) -> (Figures, State) {
        let (system, mut state) = oscillator();
        let mut monitor = Monitor::new(&system, &state, MonitorOptions::default()).unwrap();
        let mut stepper = method.stepper(&system, &state, &ImplicitOptions::default()).unwrap();
        let schedule = Schedule::duration(duration / steps, duration);
        run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, |_, _, _| ControlFlow::Continue(()));
        (monitor.figures(&state), state)
    }

    /// Of one vibration: `A ω³ h² T/24`, but for the mean of a sine, 2/π. Its phases are right to a hundredth, so that all of it counts.
    #[test]
    fn vibrations_are_off_by_their_phases() {
        let (figures, _) = figures(Method::Verlet, 200.0, 4.0);
        let own = Own::of(&figures, Method::Verlet);
        assert!((own.neglected / (figures.bend / 24.0) - 1.0).abs() < 1e-12);
        assert!((own.error / (3.0 * figures.way.max(1.0) * own.neglected) - 1.0).abs() < 1e-12, "{own:?} {figures:?}");
    }

    /// The error is below what is believed of it, and not a hundredth of it.
    #[test]
    fn errors_are_what_runs_say() {
        for method in [Method::Verlet, Method::Bdf2] {
            for steps in [40.0, 200.0] {
                let (figures, end) = figures(method, steps, 1.0);
                let (_, exact) = super::tests::figures(Method::Dop853, 2000.0, 1.0);
                let error = (end.positions[1] - exact.positions[1]).norm() / figures.extent;
                let believed = Own::of(&figures, method).error;
                assert!(error < believed && error > 0.01 * believed, "{} {error:e} {believed:e}", method.name());
            }
        }
    }

    fn given(steps: u64, change: f64, bend: f64, way: f64, reach: f64) -> Figures {
        Figures { steps, change, bend, way, reach, ..Figures::default() }
    }

    /// Where phases are lost a part of it counts: with z = 1 in 96 steps a half, in 10⁴ no less than a fifth.
    #[test]
    fn lost_phases_go_no_further() {
        let error = |steps| Own::of(&given(steps, 0.5, 1.0, 0.2, 0.0), Method::Verlet).error * 24.0 / SAFETY[0];
        assert!((error(48) - 1.0).abs() < 1e-12 && (error(96) - 0.5).abs() < 1e-12);
        assert!((error(10_000) - LEAST_PART).abs() < 1e-12);
        // Nothing moves, and velocities beyond all numbers.
        assert_eq!(Own::of(&given(10, 0.0, 0.0, 0.0, 0.0), Method::Verlet).error, 0.0);
        let beyond = given(10, f64::INFINITY, f64::INFINITY, 1.0, 0.0);
        assert_eq!(Own::of(&beyond, Method::Verlet).error, f64::INFINITY);
    }

    #[test]
    fn long_ways_and_long_steps_are_in_doubt() {
        let error = |way, reach| Own::of(&given(10, 0.5, 1.0, way, reach), Method::Verlet).error;
        assert!((error(3.0, PASSING) / error(1.0, 0.0) - 3.0).abs() < 1e-12);
        assert_eq!(error(0.5, 0.0), error(1.0, 0.0));
        assert_eq!(error(1.0, 1.01 * PASSING), f64::INFINITY);
        assert_eq!(Own::of(&given(10, 0.5, 1.0, 1.0, 0.0), Method::Rodas4).error, f64::INFINITY);
    }
}
