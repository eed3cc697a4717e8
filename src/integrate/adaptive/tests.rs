use super::{
    AdaptiveStepper, Adaptivity, Control, ErrorEstimate, GROWTH, SHORTEST, SHRINKAGE, Samples, Sampling, interpolate,
    root_mean_square, run_adaptive, stops,
};
use crate::integrate::{Statistics, StepFailure, TimeStepper};
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
use nalgebra::Vector3;
use std::ops::ControlFlow;

/// Free particles at these places on the first axis.
fn particles(places: &[f64]) -> (System, State) {
    let mut builder = SystemBuilder::new();
    for &x in places {
        builder.particle([x, 0.0, 0.0], 1.0);
    }
    builder.build().unwrap()
}

fn control(h: f64) -> Control {
    Control { h, rtol: 1e-3, duration: 2.0, velocity: 0.0, last_error: 1.0, growth: GROWTH }
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-12 * b.abs()
}

#[test]
fn the_last_two_steps_before_a_stop_share_what_is_left() {
    let control = control(0.1);
    assert_eq!(control.step_towards(0.1009), (0.1009, true));
    assert_eq!(control.step_towards(0.1011), (0.05055, false));
    assert_eq!(control.step_towards(0.1999), (0.09995, false));
    assert_eq!(control.step_towards(0.21), (0.1, false));
}

#[test]
fn errors_are_relative_to_the_spread_and_to_the_part_of_the_run() {
    let (_, state) = particles(&[1.0, 7.0]);
    let positions = [Vector3::new(3e-4, 0.0, 0.0), Vector3::new(0.0, 3e-4, 0.0)];
    let estimate = ErrorEstimate { positions: &positions, velocities: &positions };
    // (2 s/0.25 s) (3e-4 m)/(2·3 m·1e-3).
    assert!(close(control(0.1).error(&estimate, &state, 0.25), 0.4));
    let undefined = [Vector3::repeat(f64::NAN); 2];
    let estimate = ErrorEstimate { positions: &undefined, velocities: &undefined };
    assert_eq!(control(0.1).error(&estimate, &state, 0.25), f64::INFINITY);
}

/// A single particle has no spread: its distance from the origin counts, or its way if that is longer.
#[test]
fn the_error_of_one_particle_is_relative_to_its_place_or_its_way() {
    let (_, state) = particles(&[5.0]);
    let positions = [Vector3::new(3e-3, 0.0, 4e-3)];
    let estimate = ErrorEstimate { positions: &positions, velocities: &positions };
    for (velocity, length) in [(0.0, 5.0), (2.4, 5.0), (4.0, 8.0)] {
        let error = Control { velocity, ..control(0.1) }.error(&estimate, &state, 0.25);
        assert!(close(error, 8.0 * 5e-3 / (2e-3 * length)), "{velocity}: {error}");
    }
}

#[test]
fn the_next_step_follows_the_error_and_its_change() {
    let (_, state) = particles(&[0.0]);
    let next = |mut control: Control, error: f64, h: f64| {
        control.accepted(error, h, &state);
        assert_eq!((control.last_error, control.growth), (error, GROWTH));
        control.h
    };
    // h (0.9/e)^0.35 (e_last/e)^0.2 with e_last = 1.
    assert!(close(next(control(0.1), 0.5, 0.1), 0.1 * 1.8f64.powf(0.35) * 2.0f64.powf(0.2)));
    let falling = Control { last_error: 0.1, ..control(0.1) };
    assert!(close(next(falling, 1.0, 0.1), 0.1 * 0.9f64.powf(0.35) * 0.1f64.powf(0.2)));
    // Within the dead band nothing changes; growth and shrinkage are bounded.
    assert_eq!(next(control(0.1), 0.8, 0.1), 0.1);
    assert_eq!(next(control(0.1), 1e-5, 0.1), 0.1 * GROWTH);
    assert_eq!(next(Control { growth: 1.0, ..control(0.1) }, 1e-5, 0.1), 0.1);
    assert_eq!(next(Control { last_error: 1e-6, ..control(0.1) }, 1.0, 0.1), 0.1 * SHRINKAGE);
    // A step shortened to land on a stop makes no later one longer, but it may make them shorter.
    assert_eq!(next(control(0.1), 0.5, 0.05), 0.1);
    assert!(close(next(control(0.1), 0.5, 0.095), 0.095 * 1.8f64.powf(0.35) * 2.0f64.powf(0.2)));
    let falling = Control { last_error: 0.1, ..control(0.1) };
    assert!(close(next(falling, 1.0, 0.05), 0.05 * 0.9f64.powf(0.35) * 0.1f64.powf(0.2)));
}

#[test]
fn steps_shrink_after_rejections_and_failures() {
    let after = |error: Option<f64>| {
        let mut control = control(0.1);
        match error {
            Some(error) => control.rejected(error, 0.1),
            None => control.failed(0.1),
        }
        assert_eq!(control.growth, 1.0);
        control.h
    };
    assert!(close(after(Some(4.0)), 0.04));
    assert!(close(after(Some(1.0)), 0.08));
    assert!(close(after(Some(1e6)), 0.02));
    assert!(close(after(Some(f64::INFINITY)), 0.02));
    assert!(close(after(None), 0.025));
}

#[test]
fn the_largest_velocity_so_far_is_kept() {
    let (_, mut state) = particles(&[0.0, 1.0]);
    let mut control = control(0.1);
    for (speed, largest) in [(3.0, 3.0), (2.0, 3.0), (5.0, 5.0)] {
        state.velocities.fill(Vector3::new(0.0, speed, 0.0));
        control.accepted(0.8, 0.1, &state);
        assert_eq!(control.velocity, largest);
    }
}

#[test]
fn runs_stop_at_the_kinks_ahead_and_at_the_end() {
    let mut builder = SystemBuilder::new();
    for x in 0..2 {
        builder.particle([f64::from(x), 0.0, 0.0], 1.0);
    }
    for (particle, times) in [(0, vec![0.0, 0.5, 1.0, 3.0]), (1, vec![0.25, 1.0, 1.5])] {
        let offsets = vec![Vector3::zeros(); times.len()];
        let motion = Motion::Path { times, offsets };
        builder.constraints.push(Constraint { particles: vec![particle], axes: Axes::ALL, motion });
    }
    let (system, _) = builder.build().unwrap();
    assert_eq!(stops(&system, 0.0, 1.5), [0.25, 0.5, 1.0, 1.5]);
    assert_eq!(stops(&system, 0.5, 2.0), [1.0, 1.5, 2.0]);
}

/// Every cubic motion is met exactly, position and velocity.
#[test]
fn between_the_ends_of_a_step_motions_are_cubic() {
    let (system, state) = particles(&[0.0, 0.0]);
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
        interpolate(&system, &before, &after, time, &mut sample);
        let exact = at(time);
        assert_eq!(sample.time, time);
        for (a, b) in [(&sample.positions, &exact.positions), (&sample.velocities, &exact.velocities)] {
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).norm() <= 1e-13 * (1.0 + b.norm())), "{time}: {a:?} {b:?}");
        }
    }
}

#[test]
fn root_mean_squares_are_over_vectors() {
    let vectors = [Vector3::new(3.0, 4.0, 0.0), Vector3::new(0.0, 0.0, 5.0), Vector3::zeros(), Vector3::zeros()];
    assert!(close(root_mean_square(vectors.into_iter()), 12.5f64.sqrt()));
    assert_eq!(root_mean_square(std::iter::empty()), 0.0);
}

/// Samples come at multiples of the interval; one within rounding of the end is the end itself, and comes once.
#[test]
fn samples_near_the_end_are_the_end() {
    let (system, state) = particles(&[0.0]);
    let times = |interval: f64, end: f64| {
        let mut samples = Samples::new(Sampling::Every(interval), &state);
        let (after, mut seen) = (State { time: end, ..state.clone() }, Vec::new());
        let mut observe = |count: u64, state: &State| {
            seen.push((count, state.time));
            ControlFlow::Continue(())
        };
        assert!(samples.observe(&system, &state, &after, true, &mut observe).is_continue());
        seen
    };
    assert_eq!(times(2.0, 5.0), [(1, 2.0), (2, 4.0), (3, 5.0)]);
    assert_eq!(times(2.0, 4.0), [(1, 2.0), (2, 4.0)]);
    // A little later than the sample, by less than counts as rounding and by more.
    let [less, more] = [0.5, 4.0].map(|part| 1024.0 * (1.0 + part * SHORTEST));
    assert_eq!(times(1024.0, less), [(1, less)]);
    assert_eq!(times(1024.0, more), [(1, 1024.0), (2, more)]);
}

/// Moves nothing, and estimates the same errors again and again.
struct Still {
    errors: Vec<f64>,
    tried: Vec<f64>,
    accepted: usize,
    estimate: Vec<Vector3<f64>>,
    statistics: Statistics,
}

impl Still {
    /// Errors by the root mean square of the positions' estimate; a NaN stands for a step that fails.
    fn new(errors: &[f64]) -> Self {
        let estimate = vec![Vector3::zeros(); 2];
        Self { errors: errors.to_vec(), tried: Vec::new(), accepted: 0, estimate, statistics: Statistics::default() }
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
        self.estimate.fill(Vector3::new(error, 0.0, 0.0));
        Ok(ErrorEstimate { positions: &self.estimate, velocities: &self.estimate })
    }

    fn accept(&mut self, state: &mut State) {
        self.accepted += 1;
        state.time += self.tried.last().unwrap();
    }

    fn reject(&mut self) {
        self.statistics.rejected_steps += 1;
    }
}

fn how(duration: f64, first_step: f64) -> Adaptivity {
    Adaptivity { duration, rtol: 1e-3, first_step, sampling: Sampling::Steps }
}

/// A step that still fails when it is shorter than 1e-13 of the run ends it, and is told with its number and time.
#[test]
fn runs_end_where_no_step_is_short_enough() {
    let (system, start) = particles(&[0.0, 1.0]);
    // A quarter of a step that fails is tried next, even if it is just the shortest.
    for (duration, first, tries) in [(4.0, 16.0 * SHORTEST, 2), (4.0, 15.0 * SHORTEST, 1), (0.25, SHORTEST, 2)] {
        let (mut stepper, mut state) = (Still::new(&[f64::NAN]), start.clone());
        let outcome = run_adaptive(&mut stepper, &system, &mut state, &how(duration, first), |_, _| panic!("no step"));
        let failure = outcome.end.unwrap_err();
        assert_eq!((outcome.steps, failure.step, failure.time), (0, 1, 0.0));
        assert_eq!(failure.failure, StepFailure::NonFinite);
        assert_eq!(
            (stepper.tried.len(), stepper.statistics.rejected_steps),
            (tries, tries as u64),
            "{duration} {first}"
        );
    }
    let (mut stepper, mut state) = (Still::new(&[0.0, 0.0, f64::INFINITY]), start.clone());
    stepper.errors.extend([f64::INFINITY; 60]);
    let outcome = run_adaptive(&mut stepper, &system, &mut state, &how(1.0, 0.125), |_, _| ControlFlow::Continue(()));
    let failure = outcome.end.unwrap_err();
    assert_eq!((outcome.steps, failure.step, failure.time), (2, 3, 0.375));
    assert_eq!(failure.failure, StepFailure::Tolerance);
}

/// A request to stop ends the run, unless that was at its end anyway.
#[test]
fn observers_may_end_runs() {
    let (system, start) = particles(&[0.0, 1.0]);
    let run = |until: u64| {
        let (mut stepper, mut state) = (Still::new(&[0.0]), start.clone());
        let observe = |count, _: &State| if count < until { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
        let outcome = run_adaptive(&mut stepper, &system, &mut state, &how(1.0, 0.25), observe);
        (outcome.steps, outcome.end.unwrap(), state.time)
    };
    // Steps of 0.25 s, then of 0.375 s: two halves of what is left.
    assert_eq!(run(1), (1, ControlFlow::Break(()), 0.25));
    assert_eq!(run(2), (2, ControlFlow::Break(()), 0.625));
    assert_eq!(run(3), (3, ControlFlow::Continue(()), 1.0));
    assert_eq!(run(9), (3, ControlFlow::Continue(()), 1.0));
}
