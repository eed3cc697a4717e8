use super::*;
use crate::integrate::fixtures::{particles, scene};
use crate::integrate::{Dop853, RunFailure};
use crate::linear::SolveFailure;

/// Every cubic motion is met exactly, position and velocity.
#[test]
fn between_the_ends_of_a_step_motions_are_cubic() {
    let (_, state) = particles(&[0.0, 0.0]);
    let cubics = [[1.0, -2.0, 3.0, 0.5], [-4.0, 1.5, -0.25, 2.0]];
    let at = |t: f64| {
        let mut state = State { time: t, ..state.clone() };
        for (p, [a, b, c, d]) in cubics.iter().enumerate() {
            state.positions[p] = Vector3::new(a + t * (b + t * (c + t * d)), 1.0, 0.0);
            state.velocities[p] = Vector3::new(b + t * (2.0 * c + t * 3.0 * d), 0.0, 0.0);
        }
        state
    };
    let (before, after, mut sample) = (at(0.5), at(2.0), state.clone());
    for time in [0.5, 0.75, 1.1, 1.9, 2.0] {
        hermite(&before, &after, time, &mut sample);
        let exact = at(time);
        for (a, b) in [(&sample.positions, &exact.positions), (&sample.velocities, &exact.velocities)] {
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).norm() <= 1e-13 * (1.0 + b.norm())), "{time}: {a:?} {b:?}");
        }
    }
}

/// Samples come at multiples of the interval; one within rounding of the end is the end itself, and comes once.
#[test]
fn samples_near_the_end_are_the_end() {
    let (system, state) = particles(&[0.0]);
    let times = |interval: f64, end: f64| {
        let sampling = OutputTimes::Every(interval);
        let mut samples = Samples { sampling, start: state.time, count: 0, sample: state.clone() };
        let (after, mut seen) = (State { time: end, ..state.clone() }, Vec::new());
        let mut observe = |count: u64, state: &State| {
            seen.push((count, state.time));
            ControlFlow::Continue(())
        };
        assert!(samples.observe(&system, &mut Still::new(&[]), &state, &after, true, &mut observe).is_continue());
        seen
    };
    assert_eq!(times(2.0, 5.0), [(1, 2.0), (2, 4.0), (3, 5.0)]);
    assert_eq!(times(2.0, 4.0), [(1, 2.0), (2, 4.0)]);
    for none in [0.0, -1.0, f64::NAN] {
        assert_eq!(times(none, 5.0), [(1, 5.0)]);
    }
    // A little later than the sample, by less than counts as rounding and by more.
    let [less, more] = [0.5, 4.0].map(|part| 1024.0 * (1.0 + part * 1e-9));
    assert_eq!(times(1024.0, less), [(1, less)]);
    assert_eq!(times(1024.0, more), [(1, 1024.0), (2, more)]);
}

/// Moves nothing, and estimates the same errors again and again.
pub(super) struct Still {
    errors: Vec<f64>,
    tried: Vec<f64>,
    rejected: usize,
    order: u32,
    gains: bool,
    bounded: bool,
    estimate: Vec<Vector3<f64>>,
    statistics: Statistics,
}

impl Still {
    pub const GROWTH: f64 = 2.0;

    /// Errors by the norm of the positions' estimate; a NaN stands for a step that fails, −∞ for one that is interrupted.
    pub fn new(errors: &[f64]) -> Self {
        Self {
            errors: errors.to_vec(),
            tried: Vec::new(),
            rejected: 0,
            order: 2,
            gains: true,
            bounded: false,
            estimate: vec![Vector3::zeros(); 2],
            statistics: Statistics::default(),
        }
    }

    pub fn of(order: u32, gains: bool) -> Self {
        Self { order, gains, ..Self::new(&[]) }
    }

    /// A method whose steps stability bounds.
    pub fn bounded(order: u32) -> Self {
        Self { bounded: true, ..Self::of(order, false) }
    }
}

impl TimeStepper for Still {
    fn name(&self) -> &'static str {
        "still"
    }

    fn step(&mut self, _: &mut State, _: f64) -> Result<(), StepFailure> {
        unreachable!("runs with error control try steps")
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }
}

impl AdaptiveStepper for Still {
    fn try_step(&mut self, _: &State, dt: f64) -> Result<ErrorEstimate<'_>, StepFailure> {
        let error = self.errors[self.tried.len() % self.errors.len()];
        self.tried.push(dt);
        if error.is_nan() {
            return Err(StepFailure::NonFinite);
        }
        if error == f64::NEG_INFINITY {
            return Err(SolveFailure::Interrupted.into());
        }
        self.estimate.fill(Vector3::zeros());
        self.estimate[0].x = error;
        Ok(ErrorEstimate { positions: &self.estimate, velocities: &[] })
    }

    fn accept(&mut self, state: &mut State) {
        state.time += self.tried.last().unwrap();
    }

    fn reject(&mut self) {
        self.rejected += 1;
    }

    fn order(&self) -> u32 {
        self.order
    }

    fn reuses_factorization(&self) -> bool {
        self.gains
    }

    fn is_bounded_by_stability(&self) -> bool {
        self.bounded
    }

    fn largest_growth(&self) -> f64 {
        Self::GROWTH
    }

    fn statistics_mut(&mut self) -> &mut Statistics {
        &mut self.statistics
    }
}

/// A run with such errors: the stepper, the outcome and the time at its end.
fn still(errors: &[f64], duration: f64, first_step: f64) -> (Still, Outcome, f64) {
    let (system, mut state) = particles(&[0.0, 1.0]);
    let mut stepper = Still::new(errors);
    let how = AdaptiveOptions { first_step: Some(first_step), ..AdaptiveOptions::new(duration, 1e-3).unwrap() };
    let outcome = run_adaptive(&mut stepper, &system, &mut state, &how, |_, _| ControlFlow::Continue(()));
    (stepper, outcome, state.time)
}

/// A step that still fails when it is shorter than 1e-10 of the run ends it, and is told with its number and time.
#[test]
fn runs_end_where_no_step_is_short_enough() {
    // Half of a step that fails is tried next, even if it is just the shortest.
    for (duration, first, tries) in [(4.0, 8.0 * SHORTEST, 2), (4.0, 7.0 * SHORTEST, 1), (0.25, 0.5 * SHORTEST, 2)] {
        let (stepper, outcome, _) = still(&[f64::NAN], duration, first);
        let failure = RunFailure { step: 1, time: 0.0, failure: StepFailure::NonFinite };
        assert_eq!(outcome, Outcome { steps: 0, end: Err(failure) });
        let rejected = (stepper.rejected, stepper.statistics.rejected_steps);
        assert_eq!((stepper.tried.len(), rejected), (tries, (tries, tries as u64)), "{duration} {first}");
    }
    let (_, outcome, _) = still(&[&[0.0; 2][..], &[f64::INFINITY; 61]].concat(), 1.0, 0.125);
    let failure = RunFailure { step: 3, time: 0.375, failure: StepFailure::Tolerance };
    assert_eq!(outcome, Outcome { steps: 2, end: Err(failure) });
}

/// A step that is interrupted ends the run where it is, and is not tried again.
#[test]
fn interrupted_steps_end_runs() {
    let (stepper, outcome, time) = still(&[0.0, f64::NEG_INFINITY], 1.0, 0.25);
    assert_eq!((outcome, time), (Outcome { steps: 1, end: Ok(ControlFlow::Break(())) }, 0.25));
    assert_eq!((stepper.tried.len(), stepper.rejected), (2, 0));
}

/// Three particles in a row on springs of 12 N/m and 5 N/m: `Σ 2 m (‖v‖ + 5 ‖e_v‖) ‖e_v‖ + Σ 10 κ ‖e_x‖²`.
#[test]
fn errors_are_worth_energy() {
    let particles = [(0.0, 2.0), (1.0, 3.0), (2.0, 7.0)].map(|(x, mass)| ([x, 0.0, 0.0], mass));
    let springs = [(0, 1, [6.0, 0.5, 0.0]), (1, 2, [10.0, 2.0, 0.0])];
    let (system, mut state) = scene(&particles, &springs).build().unwrap();
    let stiffness = stiffness(&system);
    assert_eq!(stiffness, [12.0, 17.0, 5.0]);
    state.velocities = vec![Vector3::new(0.0, 3.0, 0.0), Vector3::x(), Vector3::zeros()];
    let positions = [Vector3::x() * 0.5, Vector3::z() * -0.25, Vector3::zeros()];
    let velocities = [Vector3::x() * -0.5, Vector3::y() * 0.25, Vector3::zeros()];
    let estimate = ErrorEstimate { positions: &positions, velocities: &velocities };
    let (kinetic, elastic) = (4.0 * 5.5 * 0.5 + 6.0 * 2.25 * 0.25, 120.0 * 0.25 + 170.0 * 0.0625);
    assert_eq!(doubt(&system, &stiffness, &estimate, &state), kinetic + elastic);
}

#[test]
fn samples_come_at_intervals_that_are_positive() {
    let how = AdaptiveOptions { first_step: Some(0.25), ..AdaptiveOptions::new(2.0, 1e-3).unwrap() };
    assert_eq!(how.sampled_every(0.5), Ok(AdaptiveOptions { sampling: OutputTimes::Every(0.5), ..how }));
    for interval in [0.0, -1.0, f64::INFINITY, f64::NAN] {
        assert!(how.sampled_every(interval).is_err(), "{interval}");
    }
}

/// A lattice of springs that vibrate at many paces: after the first steps stability bounds the step. Without the rule for that every fifth is
/// rejected.
#[cfg(feature = "scene")]
#[test]
fn few_steps_are_rejected_where_stability_bounds_them() {
    let scene = crate::scene::builtin(crate::scene::Kind::Lattice, 5).unwrap();
    let (system, start) = scene.build().unwrap();
    for rtol in [1e-4, 1e-6] {
        let (mut stepper, mut state) = (Dop853::new(&system, &start).unwrap(), start.clone());
        let how = AdaptiveOptions::new(scene.time.duration.unwrap(), rtol).unwrap();
        let outcome = run_adaptive(&mut stepper, &system, &mut state, &how, |_, _| ControlFlow::Continue(()));
        let rejected = stepper.statistics().rejected_steps;
        assert_eq!(outcome.status().name(), "completed");
        assert!(rejected * 15 < outcome.steps, "{rejected} of {}", outcome.steps);
    }
}
