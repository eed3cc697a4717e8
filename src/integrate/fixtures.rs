//! Motions for tests: of a particle whose steps are known by hand, whatever the method, and of one on a path with kinks.
//!
//! A spring draws the first behind a particle that is moved along x, faster, back and faster again between kinks a second apart. Seen from there
//! it swings about the place where the spring carries its weight, along the spring as a damped oscillator and, by as little as makes no
//! difference along it, across the spring as an undamped one. With λ the eigenvalue and `y = Re(a)`, `y' = Re(λ a)`, a method with
//! the stability function R makes `R(hλ) a` of a.

use crate::spring::Spring;
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
use nalgebra::{Complex, Vector3};

/// m, in kg; k/l0, in N/m; l0, in m; gravity along x, in m/s².
const MASS: f64 = 2.0;
const STIFFNESS: f64 = 12.0;
const REST_LENGTH: f64 = 0.5;
const GRAVITY: f64 = 0.9;

/// When the path has kinks, and where it is then.
const PATH: [(f64, f64); 4] = [(0.0, 0.0), (1.0, 0.5), (2.0, 0.2), (3.0, 1.0)];

/// The direction in which it swings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum OscillationAxis {
    Along,
    Across,
}

pub(super) struct Oscillator {
    pub system: System,
    pub start: State,
    pub lambda: Complex<f64>,
    axis: OscillationAxis,
}

impl Oscillator {
    /// At a time between 1 s and 2 s, off its place and in motion.
    pub fn new(axis: OscillationAxis, damping: f64, time: f64) -> Self {
        let mut builder = SystemBuilder::new();
        builder.gravity(GRAVITY, 0.0, 0.0);
        builder.particle([0.0; 3], 7.0);
        builder.particle([1.0, 0.0, 0.0], MASS);
        builder.spring(0, 1, Spring { stiffness: STIFFNESS * REST_LENGTH, rest_length: REST_LENGTH, damping });
        let (times, offsets) = PATH.map(|(time, x)| (time, Vector3::new(x, 0.0, 0.0))).into_iter().unzip();
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion: Motion::Path { times, offsets } });
        let (system, mut start) = builder.build().unwrap();
        start.time = time;
        start.prescribe(&system);
        start.positions[1] = start.positions[0] + Vector3::new(REST_LENGTH + MASS * GRAVITY / STIFFNESS, 0.0, 0.0);
        start.velocities[1] = start.velocities[0];
        let (rate, omega) = match axis {
            OscillationAxis::Along => {
                start.positions[1].x += 0.25;
                start.velocities[1].x += 0.5;
                let rate = 0.5 * damping / MASS;
                (rate, (STIFFNESS / MASS - rate * rate).sqrt())
            }
            OscillationAxis::Across => {
                start.positions[1].y += 1e-6;
                start.velocities[1].y += 2e-6;
                // T/l, of T = m g.
                (0.0, (GRAVITY / (REST_LENGTH + MASS * GRAVITY / STIFFNESS)).sqrt())
            }
        };
        Self { system, start, lambda: Complex::new(-rate, omega), axis }
    }

    /// The displacement from equilibrium and the velocity, relative to the led particle.
    pub fn seen(&self, state: &State) -> [f64; 2] {
        let mut there = State { time: state.time, ..self.start.clone() };
        there.prescribe(&self.system);
        let (x, v) = (state.positions[1] - there.positions[0], state.velocities[1] - there.velocities[0]);
        match self.axis {
            OscillationAxis::Along => [x.x - (REST_LENGTH + MASS * GRAVITY / STIFFNESS), v.x],
            OscillationAxis::Across => [x.y, v.y],
        }
    }

    /// a.
    pub fn amplitude(&self, state: &State) -> Complex<f64> {
        let ([y, v], lambda) = (self.seen(state), self.lambda);
        Complex::new(y, (lambda.re * y - v) / lambda.im)
    }

    /// `Re(a)` and `Re(λ a)`.
    pub fn motion(&self, amplitude: Complex<f64>) -> [f64; 2] {
        [amplitude.re, (self.lambda * amplitude).re]
    }

    /// A state has a multiple of the amplitude at the start.
    pub fn is_at(&self, state: &State, multiple: Complex<f64>, tolerance: f64) -> bool {
        let (found, expected) = (self.seen(state), self.motion(self.amplitude(&self.start) * multiple));
        let size = self.amplitude(&self.start).norm();
        let is_along = state.positions.iter().all(|x| x.z == 0.0) && state.velocities.iter().all(|v| v.z == 0.0);
        is_along && found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() <= tolerance * size)
    }
}

/// A damped particle on a spring to another that starts, turns and stops suddenly, a quarter of a second each.
pub(super) fn pulled_with_kinks() -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([2.1, 0.0, 0.0], 1.0);
    let offsets = [[0.0, 0.0, 0.0], [0.5, 0.1, 0.0], [0.25, 0.0, 0.0]].map(Vector3::from).to_vec();
    let motion = Motion::Path { times: vec![0.25, 0.5, 0.75], offsets };
    builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
    builder.spring(0, 1, Spring { stiffness: 30.0, rest_length: 2.0, damping: 3.0 });
    builder.build().unwrap()
}
