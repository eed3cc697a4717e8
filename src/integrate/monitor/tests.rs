//! The formulas of the ledger against integrals by hand.

use super::constraint_work::ConstraintWork;
use super::springs::{Springs, resolved_step};
use super::{Monitor, MonitorOptions};
use crate::spring::Spring;
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
use nalgebra::Vector3;

/// Two particles on the x axis, joined by a spring of given damping.
pub(super) fn pair(damping: f64) -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 2.0);
    builder.particle([1.0, 0.0, 0.0], 3.0);
    builder.spring(0, 1, Spring { stiffness: 6.0, rest_length: 0.5, damping });
    builder.build().unwrap()
}

fn at(start: &State, x: f64, v: f64) -> State {
    let mut state = start.clone();
    state.positions[1].x = x;
    state.velocities[1].x = v;
    state
}

/// l = 1 + r₀t + r₁t²/2 + r₂t³/3: its rate is a parabola, and the integral of its square is exact.
#[test]
fn a_rate_that_is_a_parabola_is_integrated_exactly() {
    let (system, start) = pair(0.7);
    let [r0, r1, r2, h] = [0.3, -2.0, 5.0, 0.02];
    let rate = |t: f64| r0 + r1 * t + r2 * t * t;
    let mut springs = Springs::new(&system, &at(&start, 1.0, r0), std::iter::empty());
    let sums = springs.enter(&at(&start, 1.0 + h * (r0 + h * (r1 / 2.0 + h * r2 / 3.0)), rate(h)), h);
    // ∫ (r₀ + r₁t + r₂t²)² dt.
    let integral =
        h * (r0 * r0 + h * (r0 * r1 + h * ((r1 * r1 + 2.0 * r0 * r2) / 3.0 + h * (r1 * r2 / 2.0 + h * r2 * r2 / 5.0))));
    approx::assert_relative_eq!(sums.dissipated, 0.7 * integral, max_relative = 1e-9);
    let mean = r0 + h * (r1 / 2.0 + h * r2 / 3.0);
    approx::assert_relative_eq!(sums.certain, 0.7 * h * mean * mean, max_relative = 1e-9);
    assert!(sums.certain < sums.dissipated);
}

/// Where steps do not resolve a spring only what is certain counts. Its own times: 1/sqrt(k/(l0 μ)) and μ/b, μ = 6/5 kg.
#[test]
fn unresolved_springs_dissipate_what_is_certain() {
    let (system, start) = pair(0.7);
    let longest = resolved_step(&system, 0);
    approx::assert_relative_eq!(longest, (0.5 * 1.2 / 6.0f64).sqrt(), max_relative = 1e-14);
    approx::assert_relative_eq!(resolved_step(&pair(70.0).0, 0), 1.2 / 70.0, max_relative = 1e-14);
    for (h, is_resolved) in [(0.999 * longest, true), (1.001 * longest, false)] {
        let mut springs = Springs::new(&system, &at(&start, 1.0, 0.3), std::iter::empty());
        let sums = springs.enter(&at(&start, 1.05, -0.2), h);
        assert_eq!(sums.dissipated > sums.certain, is_resolved, "{h}");
    }
}

/// A spring between a held particle and one that is led straight away from it: T = κ(l − l0) + b u, and the work is
/// `∫ T u dt`, elastic energy gained and dissipation.
#[test]
fn a_led_particle_does_the_work_that_its_spring_takes() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 2.0);
    builder.particle([1.0, 0.0, 0.0], 3.0);
    builder.spring(0, 1, Spring { stiffness: 6.0, rest_length: 0.5, damping: 0.7 });
    builder.hold(0);
    let motion = Motion::Velocity(Vector3::new(0.3, 0.0, 0.0));
    builder.constrain(Constraint { particles: vec![1], axes: Axes::of(&[0]), motion });
    let (system, mut state) = builder.build().unwrap();
    state.prescribe(&system);
    let mut drive = ConstraintWork::new(&system, &state);
    assert_eq!(drive.springs().collect::<Vec<_>>(), [0]);
    approx::assert_relative_eq!(drive.energy(&state).kinetic, 0.5 * 3.0 * 0.09, max_relative = 1e-14);
    let h = 0.05;
    state.time = h;
    // What the state says of the velocity after the step is another matter.
    state.prescribe(&system);
    state.velocities[1].x = 99.0;
    let exchange = drive.pass(&state, h);
    let elastic = |l: f64| 0.5 * 12.0 * (l - 0.5) * (l - 0.5);
    let dissipated = 0.7 * 0.09 * h;
    approx::assert_relative_eq!(exchange.dissipated, dissipated, max_relative = 1e-12);
    approx::assert_relative_eq!(exchange.certain, dissipated, max_relative = 1e-12);
    approx::assert_relative_eq!(exchange.work, elastic(1.015) - elastic(1.0) + dissipated, max_relative = 1e-12);
}

/// A hundred bytes for each of two springs, four hundred and fifty for each of three particles.
#[test]
fn memory_is_asked_for_springs_and_particles() {
    let (system, state) = crate::system::fixtures::row(3);
    let new = || Monitor::new(&system, &state, MonitorOptions::default()).unwrap();
    assert_eq!(crate::memory::watch::asked("what accompanies a run", new).1, 2 * 100 + 3 * 450);
}
