//! The limit that no linearisation sees: how far a step may turn springs, against closed forms and against runs; and what a run
//! loses first.

use approx::assert_relative_eq;
use faer::Par;
use nalgebra::Vector3;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use sprung::inspect::{Follower, LargestStep, MOST_BRAKED, MOST_STRETCHED, RotationLimit};
use sprung::integrate::{ImplicitOptions, Method};
use sprung::scene::{Kind, builtin};
use sprung::system::Axes;
use sprung::{Constraint, Motion, Spring, State, Stiffness, System, SystemBuilder};

const MASS: f64 = 0.4;
const SPRING: Spring = Spring { stiffness: 900.0, rest_length: 1.3, damping: 0.0 };
const SPEED: f64 = 0.7;

/// A particle on a spring at its rest length to a fixed point, moving across it.
fn swinger() -> (System, State) {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    let centre = builder.particle([0.3, -0.2, 0.0], 1.0);
    let particle = builder.particle([0.3 + 1.3, -0.2, 0.0], MASS);
    builder.spring(particle, centre, SPRING);
    builder.hold(centre);
    let (system, mut state) = builder.build().expect("a valid scene");
    state.velocities[particle].y = SPEED;
    (system, state)
}

/// The angle of a step, and the ρ by which the next one is braked: `z² (1 − 1/√(1 + θ²))`.
fn closed_form(dt: f64) -> (f64, f64) {
    let theta = SPEED * dt / SPRING.rest_length;
    let z_squared = SPRING.stiffness / (SPRING.rest_length * MASS) * dt * dt;
    (theta, z_squared * (1.0 - 1.0 / (1.0 + theta * theta).sqrt()))
}

fn turning(system: &System, state: &State, option: Stiffness, dt: f64) -> LargestStep {
    RotationLimit::new(system, state, Par::Seq).expect("a small system").largest_step(option, dt)
}

#[test]
fn a_lone_spring_is_judged_by_the_closed_form() {
    let (system, state) = swinger();
    for option in Stiffness::ALL {
        for dt in [0.003, 0.05, 1.0] {
            let turn = RotationLimit::new(&system, &state, Par::Seq).unwrap().worst(option, dt).expect("it turns");
            let (theta, rho) = closed_form(dt);
            assert_relative_eq!(turn.angle, theta.atan(), max_relative = 1e-9);
            assert_relative_eq!(turn.stretch, (1.0 + theta * theta).sqrt() - 1.0, max_relative = 1e-9);
            let rho = if option == Stiffness::Axial { 0.0 } else { rho };
            assert_relative_eq!(turn.brake, rho, max_relative = 1e-9);
        }
    }
    // Wherever the search starts it ends at the same limit, on the side that is kept.
    for start in [1e-5, 0.02, 3.0] {
        let LargestStep::UpTo { dt, refused } = turning(&system, &state, Stiffness::Full, start) else { panic!() };
        assert!(refused > dt && refused < 1.02 * dt);
        let lost = |dt: f64| {
            let (theta, rho) = closed_form(dt);
            1.0 - (1.0 + rho).powf(-1.0 / theta.atan())
        };
        assert!(lost(dt) <= MOST_BRAKED && lost(refused) >= MOST_BRAKED, "{} {}", lost(dt), lost(refused));
        let dt = turning(&system, &state, Stiffness::Axial, start).dt().expect("a limit");
        let stretched = closed_form(dt).0.hypot(1.0) - 1.0;
        assert!((0.95 * MOST_STRETCHED..=MOST_STRETCHED).contains(&stretched), "{stretched}");
    }
}

/// Angular momentum about the centre after a turn by one radian, as a part of what it was; the exact motion keeps it.
fn kept(option: Stiffness, dt: f64) -> f64 {
    let (system, mut state) = swinger();
    let options = ImplicitOptions { stiffness: option.into(), ..ImplicitOptions::default() };
    let mut stepper = Method::LinearBackwardEuler.stepper(&system, &state, &options).unwrap();
    let momentum = |state: &State| (state.positions[1] - state.positions[0]).cross(&state.velocities[1]).z;
    let before = momentum(&state);
    for _ in 0..(1.0 / closed_form(dt).0).round() as usize {
        stepper.step(&mut state, dt).unwrap();
    }
    momentum(&state) / before
}

#[test]
fn a_run_at_the_limit_loses_a_tenth_and_one_beyond_it_more() {
    let (system, state) = swinger();
    for option in [Stiffness::Full, Stiffness::Tension] {
        let limit = turning(&system, &state, option, 0.01).dt().expect("a limit");
        let loss = 1.0 - kept(option, limit);
        // The rest is what backward Euler damps of every turning: θ a radian.
        assert!((0.05..0.2).contains(&loss), "{loss}");
        assert!(1.0 - kept(option, 0.25 * limit) < 0.05);
        assert!(1.0 - kept(option, 4.0 * limit) > 0.7);
    }
    assert_relative_eq!(kept(Stiffness::Axial, 0.1), 1.0, max_relative = 1e-9);
}

/// A braced sheet that shakes but does not turn: its springs' elasticity decides, not their inertia.
#[test]
fn what_only_shakes_is_not_called_turned() {
    let side = 6;
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    for k in 0..side * side {
        builder.particle([(k % side) as f64, (k / side) as f64, 0.0], 0.1);
    }
    for k in 0..side * side {
        let (x, y) = (k % side, k / side);
        for (dx, dy) in [(1, 0), (0, 1), (1, 1)] {
            if x + dx < side && y + dy < side {
                let length = if dx + dy == 2 { 2f64.sqrt() } else { 1.0 };
                let spring = Spring { stiffness: 1000.0, rest_length: length, damping: 0.0 };
                builder.spring(k, k + dx + side * dy, spring);
            }
        }
    }
    let (system, mut state) = builder.build().expect("a valid scene");
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for velocity in &mut state.velocities {
        (velocity.x, velocity.y) = (random.random_range(-3.0..3.0), random.random_range(-3.0..3.0));
    }
    let turn =
        RotationLimit::new(&system, &state, Par::Seq).unwrap().worst(Stiffness::Full, 0.2).expect("it turns a little");
    // (ω dt)² = 800 along a spring: a lone one that turned so far would be braked beyond the limit.
    assert!(0.5 * 800.0 * turn.angle > 2.0 * MOST_BRAKED, "{turn:?}");
    assert!(turn.excess() < 1.0, "{turn:?}");
}

fn follow(system: &System, start: &State, option: Stiffness, dt: f64, steps: u64) -> sprung::inspect::FirstLosses {
    let mut follower = Follower::new(system, start, option, dt, Par::Seq).unwrap();
    let mut state = start.clone();
    let options = ImplicitOptions { stiffness: option.into(), ..ImplicitOptions::default() };
    let mut stepper = Method::LinearBackwardEuler.stepper(system, &state, &options).unwrap();
    for step in 1..=steps {
        if stepper.step(&mut state, dt).is_err() {
            break;
        }
        follower.look(step, &state).unwrap();
    }
    follower.first_losses().clone()
}

/// At rest every step of this cloth is definite and stable; a run with steps of 0.05 s breaks down in its third.
#[test]
fn the_turning_is_lost_before_what_it_leads_to() {
    let (system, start) = builtin(Kind::Cloth, 10).unwrap().build().unwrap();
    let losses = follow(&system, &start, Stiffness::Full, 0.05, 10);
    let (turning, energy) = (losses.turning.expect("turned").0.step, losses.energy.expect("gained").0.step);
    let definite = losses.definite.as_ref().expect("lost").step;
    assert_eq!((turning, definite), (1, 2));
    assert!(energy <= definite);
    assert_eq!(losses.first(), Some(1));
    // A step that is short enough from rest is too long where the cloth swings.
    let limit = turning_at(&system, &start);
    let short = follow(&system, &start, Stiffness::Full, 0.7 * limit, 150);
    assert!(short.turning.expect("too fast for it").0.step > 1 && short.definite.is_none());
}

fn turning_at(system: &System, state: &State) -> f64 {
    turning(system, state, Stiffness::Full, 0.01).dt().expect("gravity turns the springs at the corners")
}

/// Walls draw two springs apart with a mass between them, l/l0 = 1 + t: across them ω² = 4000 (1 − l0/l), and 2/ω falls below the
/// step of 0.05 s at l/l0 = 5/3, between t = 0.65 s and 0.7 s.
#[test]
fn stability_is_lost_where_springs_become_taut_enough() {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    let particle = builder.particle([0.0; 3], 0.1);
    for side in [-1.0, 1.0] {
        let wall = builder.particle([side, 0.0, 0.0], 1.0);
        builder.spring(particle, wall, Spring { stiffness: 200.0, rest_length: 1.0, damping: 0.0 });
        builder.constrain(moved(wall, Vector3::new(side, 0.0, 0.0)));
    }
    let (system, start) = builder.build().expect("a valid scene");
    let losses = follow(&system, &start, Stiffness::Axial, 0.05, 30);
    assert_eq!(losses.stable.expect("the step becomes too long").step, 14);
    // The walls do work.
    assert!(losses.definite.is_none() && losses.energy.is_none());
    for option in [Stiffness::Full, Stiffness::Tension] {
        assert_eq!(follow(&system, &start, option, 0.05, 30).stable, None);
    }
}

fn moved(particle: usize, velocity: Vector3<f64>) -> Constraint {
    Constraint { particles: vec![particle], axes: Axes::ALL, motion: Motion::Velocity(velocity) }
}

#[test]
fn energy_that_comes_from_work_is_no_gain() {
    let (system, mut state) = swinger();
    let mut follower = Follower::new(&system, &state, Stiffness::Tension, 0.001, Par::Seq).unwrap();
    state.velocities[1] *= 1.04;
    follower.look(1, &state).unwrap();
    assert_eq!(follower.first_losses().energy, None, "8 % of the energy in play");
    state.velocities[1] *= 1.04;
    follower.look(2, &state).unwrap();
    let (at, gain) = follower.first_losses().energy.expect("17 % more");
    assert_eq!(at.step, 2);
    let initial = 0.5 * MASS * SPEED * SPEED;
    assert_relative_eq!(gain.gained, initial * (1.04f64.powi(4) - 1.0), max_relative = 1e-9);

    let mut builder = SystemBuilder::new();
    let end = builder.particle([0.0; 3], 1.0);
    let bob = builder.particle([1.0, 0.0, 0.0], 1.0);
    builder.spring(end, bob, SPRING);
    builder.constrain(moved(end, Vector3::y()));
    let (system, mut state) = builder.build().unwrap();
    let mut follower = Follower::new(&system, &state, Stiffness::Tension, 0.001, Par::Seq).unwrap();
    let mut stepper = Method::LinearBackwardEuler.stepper(&system, &state, &ImplicitOptions::default()).unwrap();
    for step in 1..=50 {
        stepper.step(&mut state, 0.001).unwrap();
        follower.look(step, &state).unwrap();
    }
    assert_eq!(follower.first_losses().energy, None, "the end that moves does work");
    state.velocities[bob].x += 100.0;
    follower.look(51, &state).unwrap();
    assert!(follower.first_losses().energy.is_some());
}
