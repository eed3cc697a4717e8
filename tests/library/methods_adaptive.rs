//! Runs with error control: the error that they reach, what they cost, and where they land.

use crate::motions::{after, build, case, distance, norm, policies, state_at, with};
use nalgebra::Vector3;
use sprung::chart::dop853;
use sprung::integrate::{AdaptiveOptions, Method, OutputTimes, Statistics, Status, run_adaptive};
use sprung::integrate::{ImplicitOptions, Outcome};
use sprung::linear::SolverChoice;
use sprung::system::Axes;
use sprung::{Constraint, Motion, Spring, State, Stiffness, System, SystemBuilder};
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

fn run(
    system: &System,
    start: &State,
    options: &ImplicitOptions,
    how: &AdaptiveOptions,
) -> (State, Outcome, Statistics) {
    run_by(Method::W2, system, start, options, how)
}

fn run_by(
    method: Method,
    system: &System,
    start: &State,
    options: &ImplicitOptions,
    how: &AdaptiveOptions,
) -> (State, Outcome, Statistics) {
    let mut state = start.clone();
    let mut stepper = method.adaptive_stepper(system, &state, options).unwrap().unwrap();
    let outcome = run_adaptive(&mut *stepper, system, &mut state, how, |_, _| ControlFlow::Continue(()));
    assert_eq!(outcome.status(), Status::Completed, "{outcome:?}");
    (state, outcome, *stepper.statistics())
}

const SCENES: [&str; 8] = [
    "spherical pendulum",
    "elastic pendulum",
    "damped tetrahedron",
    "undamped tetrahedron",
    "falling damped tetrahedron",
    "pendulum on a moving anchor",
    "pendulum on a roller",
    "stiffer spherical pendulum",
];

fn adaptivity(duration: f64, rtol: f64) -> AdaptiveOptions {
    AdaptiveOptions { duration, rtol, first_step: Some(0.01), sampling: OutputTimes::Steps, part_of: None }
}

#[test]
fn the_error_at_the_end_follows_the_tolerance() {
    for name in SCENES {
        let case = case("trajectories", name);
        let (system, start) = build(&case);
        for (duration, tolerances) in [(0.5, &[1e-3, 1e-4, 1e-5, 1e-6, 1e-7][..]), (2.0, &[1e-3, 1e-4, 1e-5])] {
            let end = state_at(&case, duration);
            let ways = Method::ALL.into_iter().filter(|method| method.estimates_errors()).flat_map(|method| {
                let policies =
                    if method.takes_stiffness() { policies().to_vec() } else { vec![Stiffness::Full.into()] };
                policies.into_iter().map(move |policy| (method, policy))
            });
            for (method, policy) in ways {
                let ratio = |&rtol: &f64| {
                    let how = AdaptiveOptions { first_step: None, ..adaptivity(duration, rtol) };
                    let (state, ..) = run_by(method, &system, &start, &with(policy), &how);
                    distance(&state.positions, &end.positions) / norm(&end.positions) / rtol
                };
                let ratios: Vec<f64> = tolerances.iter().map(ratio).collect();
                let name = format!("{name}, {}, {}, {duration} s", method.name(), policy.name());
                println!("{name}: {ratios:.3?}");
                assert!(ratios.iter().all(|&ratio| ratio <= 5.0), "{name}: {ratios:?}");
                // Proportional: over four decades of rtol the ratio changes little. Of few long steps it depends on chance.
                let (least, most) = ratios.iter().fold((f64::MAX, 0.0f64), |(a, b), &r| (a.min(r), b.max(r)));
                assert!(most < 5.0 * least || method.order() > 2, "{name}: {ratios:?}");
            }
        }
    }
}

/// A rod of 10⁴ N/m or more that swings down from the horizontal, and the same damped along the rod; at the end of a pendulum
/// of two such rods. Its fast vibration along the rod displaces little, but it carries speed.
fn stiff(stiffness: f64, damping: f64, links: usize) -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -9.81, 0.0);
    let particles: Vec<usize> = (0..=links).map(|p| builder.particle([p as f64, 0.0, 0.0], 1.0)).collect();
    for pair in particles.windows(2) {
        builder.spring(pair[0], pair[1], Spring { stiffness, rest_length: 1.0, damping });
    }
    builder.hold(particles[0]);
    builder.build().unwrap()
}

#[test]
fn stiff_rods_and_pendulums_keep_the_tolerance() {
    let mut worst = Vec::new();
    for (stiffness, damping, links) in
        [(2e7, 0.0, 1), (2e7, 100.0, 1), (1e5, 0.0, 1), (1e4, 0.0, 1), (1e5, 30.0, 2), (1e5, 0.0, 2), (1e3, 0.0, 3)]
    {
        let (system, start) = stiff(stiffness, damping, links);
        let deadline = Instant::now() + Duration::from_secs(600);
        let end = dop853(&system, &start, 1.0, 1e-12, deadline).unwrap();
        let centroid = end.positions.iter().sum::<Vector3<f64>>() / end.positions.len() as f64;
        let spread = norm(&end.positions.iter().map(|x| x - centroid).collect::<Vec<_>>());
        for method in Method::ALL.into_iter().filter(|method| method.estimates_errors()) {
            for rtol in [1e-2, 1e-3, 1e-4] {
                let how = AdaptiveOptions { first_step: None, ..adaptivity(1.0, rtol) };
                let (state, outcome, statistics) = run_by(method, &system, &start, &with(Stiffness::Full), &how);
                let ratio = distance(&state.positions, &end.positions) / spread / rtol;
                println!(
                    "{}, k = {stiffness:e}, b = {damping}, {links} links, rtol {rtol:e}: {ratio:.3} rtol, {} steps, {} rejected, \
                     {} forces",
                    method.name(),
                    outcome.steps,
                    statistics.rejected_steps,
                    statistics.work.force_evaluations
                );
                worst.push(ratio);
            }
        }
    }
    assert!(worst.iter().all(|&ratio| ratio <= 5.0), "{worst:.2?}");
}

/// A pendulum on a stiff damped link that hangs still but for a slow swing, until its anchor is flicked aside.
fn flicked_pendulum() -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -9.81, 0.0);
    let anchor = builder.particle([0.0, 0.0, 0.0], 1.0);
    let bob = builder.particle([0.1, -1.0, 0.0], 0.7);
    let tail = builder.particle([0.15, -2.1, 0.05], 0.4);
    builder.spring(anchor, bob, Spring { stiffness: 9000.0, rest_length: 1.004, damping: 20.0 });
    builder.spring(bob, tail, Spring { stiffness: 4000.0, rest_length: 1.1, damping: 15.0 });
    let offsets = vec![Vector3::zeros(), Vector3::zeros(), Vector3::new(0.15, 0.05, 0.1)];
    let motion = Motion::Path { times: vec![0.0, 1.0, 1.01], offsets };
    builder.constrain(Constraint { particles: vec![anchor], axes: Axes::ALL, motion });
    builder.build().unwrap()
}

#[test]
fn a_stiff_transient_costs_fewer_solves_than_any_fixed_step() {
    let (system, start) = flicked_pendulum();
    let duration = 3.0;
    let options = with(Stiffness::Full);
    let reference = after(&system, &start, Method::W2, &options, duration, 300_000);
    let error = |state: &State| distance(&state.positions, &reference.positions) / norm(&reference.positions);
    let fixed: Vec<(u64, f64)> = (0..9)
        .map(|power| 150 << power)
        .map(|steps| (2 * steps, error(&after(&system, &start, Method::W2, &options, duration, steps))))
        .collect();
    println!("fixed {fixed:.2?}");
    for rtol in [1e-3, 1e-4, 1e-5] {
        let (state, outcome, statistics) = run(&system, &start, &options, &adaptivity(duration, rtol));
        let mine = error(&state);
        let solves = statistics.work.solves;
        let best = fixed.iter().filter(|(_, error)| *error <= mine).map(|(solves, _)| *solves).min();
        println!(
            "rtol {rtol:e}: error {mine:.2e}, {solves} solves, {} steps, {} rejected, {} factorizations; best fixed {best:?}",
            outcome.steps, statistics.rejected_steps, statistics.work.factorizations
        );
        assert!(best.is_none_or(|best| solves < best), "rtol {rtol:e}: {solves} solves, fixed {best:?}");
        assert!(statistics.rejected_steps > 0);
        assert_eq!(statistics.work.force_evaluations, 1 + 3 * (outcome.steps + statistics.rejected_steps));
        assert!(statistics.work.factorizations < outcome.steps);
    }
}

#[test]
fn steps_land_on_kinks_and_on_the_end() {
    let (system, start) = flicked_pendulum();
    let mut state = start.clone();
    let mut times = Vec::new();
    let mut stepper = Method::W2.adaptive_stepper(&system, &state, &with(Stiffness::Tension)).unwrap().unwrap();
    let outcome = run_adaptive(&mut *stepper, &system, &mut state, &adaptivity(1.7, 1e-3), |count, state| {
        times.push(state.time);
        assert_eq!(count as usize, times.len());
        ControlFlow::Continue(())
    });
    assert_eq!(outcome.steps as usize, times.len());
    assert!(times.is_sorted_by(|a, b| a < b));
    assert!(times.contains(&1.0) && times.contains(&1.01));
    assert_eq!(times.last(), Some(&1.7));
    assert_eq!(state.positions[0], Vector3::new(0.15, 0.05, 0.1));
}

#[test]
fn samples_between_steps_are_as_good_as_the_steps() {
    let case = case("trajectories", "damped tetrahedron");
    let (system, start) = build(&case);
    let mut state = start.clone();
    let mut stepper = Method::W2.adaptive_stepper(&system, &state, &with(Stiffness::Full)).unwrap().unwrap();
    let how = AdaptiveOptions { sampling: OutputTimes::Every(0.1), ..adaptivity(0.55, 1e-4) };
    let mut times = Vec::new();
    run_adaptive(&mut *stepper, &system, &mut state, &how, |_, sample| {
        times.push(sample.time);
        for known in [0.1, 0.5] {
            if (sample.time - known).abs() < 1e-12 {
                let known = state_at(&case, known);
                assert!(distance(&sample.positions, &known.positions) < 1e-4 * norm(&known.positions));
                assert!(distance(&sample.velocities, &known.velocities) < 1e-3 * norm(&known.velocities));
            }
        }
        ControlFlow::Continue(())
    });
    let expected = [0.1, 0.2, 0.3, 0.4, 0.5, 0.55];
    assert_eq!(times.len(), expected.len(), "{times:?}");
    assert!(times.iter().zip(expected).all(|(time, expected)| (time - expected).abs() < 1e-12), "{times:?}");
    // A whole number of intervals: the end is seen once.
    let mut count = 0;
    let mut state = start.clone();
    let how = AdaptiveOptions { sampling: OutputTimes::Every(0.1), ..adaptivity(0.3, 1e-4) };
    run_adaptive(&mut *stepper, &system, &mut state, &how, |_, _| {
        count += 1;
        ControlFlow::Continue(())
    });
    assert_eq!((count, state.time), (3, 0.3));
}

#[test]
fn an_indefinite_first_step_is_tried_again_shorter() {
    let mut builder = SystemBuilder::new();
    let particles = [[0.0, 0.0, 0.0], [0.5, 0.02, 0.0], [1.0, 0.0, 0.01]].map(|x| builder.particle(x, 1.0));
    for pair in particles.windows(2) {
        builder.spring(pair[0], pair[1], Spring { stiffness: 100.0, rest_length: 0.9, damping: 0.1 });
    }
    let (system, start) = builder.build().unwrap();
    let mut options = with(Stiffness::Full);
    options.linear.solver = SolverChoice::Llt;
    let how = AdaptiveOptions { first_step: Some(1.0), ..adaptivity(1.0, 1e-3) };
    let (_, _, statistics) = run(&system, &start, &options, &how);
    assert!(statistics.rejected_steps > 0);
}

#[test]
fn an_unreachable_tolerance_is_an_outcome() {
    let (system, start) = build(&case("trajectories", "elastic pendulum"));
    let mut state = start.clone();
    let mut stepper = Method::W2.adaptive_stepper(&system, &state, &with(Stiffness::Full)).unwrap().unwrap();
    let outcome =
        run_adaptive(&mut *stepper, &system, &mut state, &adaptivity(1.0, 1e-40), |_, _| ControlFlow::Continue(()));
    assert_eq!(outcome.status(), Status::NotConverged);
    assert_eq!(outcome.steps, 0);
    assert_eq!(state, start);
}

#[test]
fn a_run_can_be_stopped() {
    let (system, start) = build(&case("trajectories", "elastic pendulum"));
    let mut state = start.clone();
    let mut stepper = Method::W2.adaptive_stepper(&system, &state, &with(Stiffness::Full)).unwrap().unwrap();
    let outcome =
        run_adaptive(&mut *stepper, &system, &mut state, &adaptivity(1.0, 1e-3), |_, _| ControlFlow::Break(()));
    assert_eq!((outcome.status(), outcome.steps), (Status::Interrupted, 1));
}

fn methods() -> impl Iterator<Item = Method> {
    Method::ALL.into_iter().filter(|method| method.estimates_errors())
}

/// One particle has no extent, and at rest no speed: errors are relative to the way that it is about to fall.
#[test]
fn a_particle_falls_from_rest() {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, 0.0, -9.81);
    builder.particle([3.0, 4.0, 5.0], 2.0);
    let (system, start) = builder.build().unwrap();
    for method in methods() {
        let how = AdaptiveOptions { first_step: None, ..adaptivity(1.0, 1e-3) };
        let (state, ..) = run_by(method, &system, &start, &ImplicitOptions::default(), &how);
        let error = (state.positions[0].z - (5.0 - 4.905)).abs() / 4.905;
        assert!(error < 1e-3, "{}: {error:e}", method.name());
    }
}

/// A particle of 1 kg flies at 4 m/s through the end that holds its spring of 1 N/m, of a rest length of 1 m: at that moment the scene has no extent.
/// With u its distance less 1 m, `ü = −u` on either side. From u = 1, u̇ = −4 it is `u = cos t − 4 sin t` up to u = −1, and from
/// there, mirrored, `u = −cos s + w sin s` with `w² = 16 + 1 − 1`.
#[test]
fn two_particles_may_pass_each_other() {
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    builder.particle([0.0; 3], 1.0);
    builder.particle([2.0, 0.0, 0.0], 1.0);
    builder.spring(0, 1, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
    builder.hold(0);
    builder.velocities[1].x = -4.0;
    let (system, start) = builder.build().unwrap();
    let meeting = {
        let (mut low, mut high) = (0.0f64, 1.0f64);
        for _ in 0..60 {
            let t = 0.5 * (low + high);
            if t.cos() - 4.0 * t.sin() > -1.0 { low = t } else { high = t }
        }
        low
    };
    let s = 1.0 - meeting;
    let exact = -(1.0 - s.cos() + 4.0 * s.sin());
    for method in methods() {
        for rtol in [1e-2, 1e-4] {
            let how = AdaptiveOptions { first_step: None, ..adaptivity(1.0, rtol) };
            let (state, ..) = run_by(method, &system, &start, &ImplicitOptions::default(), &how);
            let error = (state.positions[1].x / exact - 1.0).abs();
            assert!(error < rtol, "{}, {rtol:e}: {error:e}", method.name());
        }
    }
}

/// After steps whose estimates nobody asked for, and a step that was rejected, the next one is what it would be without that.
#[test]
fn a_rejected_step_leaves_no_trace() {
    let (system, start) = stiff(1e4, 0.0, 2);
    for method in methods() {
        let [plain, rejected] = [false, true].map(|rejects| {
            let mut state = start.clone();
            let mut stepper = method.adaptive_stepper(&system, &state, &ImplicitOptions::default()).unwrap().unwrap();
            for _ in 0..3 {
                stepper.step(&mut state, 1e-3).unwrap();
            }
            if rejects {
                stepper.try_step(&state, 2e-3).unwrap();
                stepper.reject();
            }
            // Another length than the steps before: w2 keeps the matrix of equal ones.
            let estimate = stepper.try_step(&state, 0.7e-3).unwrap();
            (estimate.positions.to_vec(), estimate.velocities.to_vec())
        });
        assert!(plain.1.iter().any(|e| e.norm() > 0.0));
        let apart = |a: &[Vector3<f64>], b: &[Vector3<f64>]| distance(a, b) / norm(a);
        let apart = [apart(&plain.0, &rejected.0), apart(&plain.1, &rejected.1)];
        assert!(apart.iter().all(|&apart| apart < 1e-6), "{}: {apart:?}", method.name());
    }
}

/// 1566 intervals of a sixtieth of a second are 26.1 s up to rounding, in one run and in parts.
#[test]
fn the_end_is_one_sample() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    let (system, start) = builder.build().unwrap();
    let interval = 1.0 / 60.0;
    for (from, duration, samples) in [(0.0, 26.1, 1566), (30.0, 10.0, 600), (50.0, 10.0, 600), (1000.0, 0.35, 21)] {
        let mut state = State { time: from, ..start.clone() };
        let mut stepper =
            Method::Rodas4.adaptive_stepper(&system, &state, &ImplicitOptions::default()).unwrap().unwrap();
        let how = AdaptiveOptions::new(duration, 1e-2).unwrap().sampled_every(interval).unwrap();
        let mut count = 0;
        run_adaptive(&mut *stepper, &system, &mut state, &how, |number, _| {
            count = number;
            ControlFlow::Continue(())
        });
        assert_eq!(count, samples, "{from} {duration}");
    }
}
