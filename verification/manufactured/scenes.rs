//! Scenes that turn and stretch along chosen motions.

use super::jet::{Jet, piecewise};
use nalgebra::Vector3;
use sprung::spring::{SpringLaw, Tension};
use sprung::system::{Actuation, Axes, Behaviour, Curve, Loads};
use sprung::{Constraint, Motion, Result, Spring, State, System, SystemBuilder};
use std::sync::Arc;

/// Tension over k, as a function of strain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Law {
    /// `ε`.
    Linear,
    /// `ε + ε³`.
    Cubic,
}

/// A scene with the motion that it is to make.
#[derive(Debug)]
pub struct Scene {
    pub name: &'static str,
    /// What makes it difficult.
    pub holds: &'static str,
    pub dimension: usize,
    /// In s.
    pub duration: f64,
    /// Places before anything turns or stretches.
    places: Vec<Vector3<f64>>,
    /// Coordinates at time t of a particle from its place.
    path: fn(Vector3<f64>, f64) -> [Jet; 3],
    pub masses: Vec<f64>,
    pub drag: Vec<f64>,
    pub forces: Vec<Vector3<f64>>,
    pub gravity: Curve<Vector3<f64>>,
    pub pairs: Vec<[usize; 2]>,
    pub springs: Vec<Spring>,
    pub law: Law,
    pub actuation: Vec<Actuation>,
    constraints: Vec<Constraint>,
}

impl Scene {
    /// The library's system, without the force that makes the motion exact, and its start.
    pub fn unforced(&self) -> Result<(System, State)> {
        let mut builder = SystemBuilder { dimension: self.dimension, ..SystemBuilder::new() };
        let start = self.state(0.0);
        for ((x, v), &mass) in start.positions.iter().zip(&start.velocities).zip(&self.masses) {
            let particle = builder.particle([x.x, x.y, x.z], mass);
            builder.velocities[particle] = *v;
        }
        for (&[i, j], &spring) in self.pairs.iter().zip(&self.springs) {
            builder.spring(i, j, spring);
        }
        builder.constraints = self.constraints.clone();
        let (system, state) = builder.build()?;
        let loads = Loads { forces: self.forces.clone(), drag: self.drag.clone(), gravity: Some(self.gravity.clone()) };
        let mut system = system.with_loads(loads)?;
        match self.law {
            Law::Cubic => system = system.with_spring_law(Cubic),
            Law::Linear => {
                system =
                    system.with_behaviour(Behaviour { actuation: self.actuation.clone(), ..Behaviour::default() })?
            }
        }
        Ok((system, state))
    }

    /// Position, velocity, acceleration and jerk of every particle; prescribed coordinates follow their constraints.
    pub fn motion(&self, t: f64) -> Vec<[Vector3<f64>; 4]> {
        let at = |t: f64, place: &Vector3<f64>| {
            let jets = (self.path)(*place, t);
            [0, 1, 2, 3].map(|order| Vector3::from_fn(|axis, _| jets[axis].0[order]))
        };
        let mut motion: Vec<_> = self.places.iter().map(|place| at(t, place)).collect();
        for constraint in &self.constraints {
            let (offset, velocity) = match &constraint.motion {
                Motion::Held => (Vector3::zeros(), Vector3::zeros()),
                Motion::Velocity(v) => (v * t, *v),
                Motion::Path { times, offsets } => piecewise(times, offsets, t),
            };
            for &p in &constraint.particles {
                let start = at(0.0, &self.places[p])[0];
                for axis in constraint.axes.iter() {
                    motion[p][0][axis] = start[axis] + offset[axis];
                    motion[p][1][axis] = velocity[axis];
                    motion[p][2][axis] = 0.0;
                    motion[p][3][axis] = 0.0;
                }
            }
        }
        motion
    }

    /// The state at time t.
    pub fn state(&self, t: f64) -> State {
        let (positions, velocities) = self.motion(t).into_iter().map(|[x, v, ..]| (x, v)).unzip();
        State { time: t, positions, velocities }
    }

    /// Masses, springs, drag and loads that differ from particle to particle.
    fn of(name: &'static str, holds: &'static str, places: Vec<Vector3<f64>>, pairs: Vec<[usize; 2]>) -> Self {
        let differs = |number: usize, step: f64| 0.7 + 0.6 * (step * number as f64).fract();
        let spring = |(number, &[i, j]): (usize, &[usize; 2])| Spring {
            stiffness: 20.0 * differs(number, 0.618),
            rest_length: (places[i] - places[j]).norm() * differs(number, 0.414),
            damping: 0.8 * differs(number, 0.303),
        };
        let count = places.len();
        let load = |p: usize| Vector3::new(0.3, -0.2, 0.1) * differs(p, 0.532);
        Self {
            name,
            holds,
            dimension: 3,
            duration: 1.0,
            springs: pairs.iter().enumerate().map(spring).collect(),
            masses: (0..count).map(|p| differs(p, 0.732)).collect(),
            drag: (0..count).map(|p| 0.2 * differs(p, 0.236)).collect(),
            forces: (0..count).map(load).collect(),
            gravity: Curve { times: vec![0.0], values: vec![Vector3::new(0.5, -9.81, 1.0)] },
            places,
            path: tumble,
            pairs,
            law: Law::Linear,
            actuation: Vec::new(),
            constraints: Vec::new(),
        }
    }
}

/// A turn by 2 rad about z and 1.2 rad about x in a second, after a stretch by up to 30 % along each axis and a drift.
fn tumble(place: Vector3<f64>, t: f64) -> [Jet; 3] {
    let stretch = |axis: usize, rate: f64, phase: f64| {
        Jet::constant(place[axis]) * (Jet::constant(1.0) + Jet::wave(0.3, rate, phase, t))
    };
    let own = Jet::wave(0.1, 3.0, 5.0 * place.x + 2.0 * place.y + place.z, t);
    let (x, y, z) = (stretch(0, 2.5, 0.3) + own, stretch(1, 3.1, 1.0), stretch(2, 1.9, 2.0) + own);
    let (y, z) = turned(y, z, 1.2, t);
    let (x, y) = turned(x, y, 2.0, t);
    [x + Jet([0.4 * t, 0.4, 0.0, 0.0]), y, z + Jet::wave(0.2, 1.7, 0.5, t)]
}

/// The same in a plane.
fn roll(place: Vector3<f64>, t: f64) -> [Jet; 3] {
    let [x, y, _] = tumble(place, t);
    let (x, y) = turned(x, y, 0.5, t);
    [x, y, Jet::constant(0.0)]
}

/// Pressed to six tenths, and turned.
fn press(place: Vector3<f64>, t: f64) -> [Jet; 3] {
    let pressed = Jet::constant(0.75) + Jet::wave(0.15, 4.0, 1.0, t);
    let [x, y, z] = [0, 1, 2].map(|axis| Jet::constant(place[axis]) * pressed);
    let own = Jet::wave(0.05, 4.0, 7.0 * place.x - 3.0 * place.y + 2.0 * place.z, t);
    let (x, z) = turned(x + own, z, 2.2, t);
    [x, y + own, z]
}

/// A turn of (a, b) by the angle `rate · t`.
fn turned(a: Jet, b: Jet, rate: f64, t: f64) -> (Jet, Jet) {
    let (cos, sin, minus) =
        (Jet::wave(1.0, rate, std::f64::consts::FRAC_PI_2, t), Jet::wave(1.0, rate, 0.0, t), Jet::constant(-1.0));
    (a * cos + minus * b * sin, a * sin + b * cos)
}

/// The law `T = k (ε + ε³)` as the library takes it.
#[derive(Debug)]
struct Cubic;

impl SpringLaw for Cubic {
    fn tension(&self, _: usize, spring: &Spring, length: f64) -> Tension {
        let (k, strain) = (spring.stiffness, length / spring.rest_length - 1.0);
        Tension { force: k * (strain + strain.powi(3)), slope: k * (1.0 + 3.0 * strain * strain) / spring.rest_length }
    }

    fn energy(&self, _: usize, spring: &Spring, length: f64) -> f64 {
        let strain = length / spring.rest_length - 1.0;
        spring.stiffness * spring.rest_length * (strain.powi(2) / 2.0 + strain.powi(4) / 4.0)
    }
}

/// The corners of a box of two by one by one, and springs between all pairs nearer than the long diagonals.
fn block() -> (Vec<Vector3<f64>>, Vec<[usize; 2]>) {
    let places: Vec<_> = (0..8)
        .map(|p| Vector3::new((p & 1) as f64 * 1.5, (p >> 1 & 1) as f64, (p >> 2) as f64) - Vector3::new(0.7, 0.4, 0.6))
        .collect();
    let near = |&[i, j]: &[usize; 2]| i < j && (places[i] - places[j]).norm() < 1.9;
    let pairs = (0..64).map(|n| [n / 8, n % 8]).filter(near).collect();
    (places, pairs)
}

/// A triangulated strip in a plane.
fn strip() -> (Vec<Vector3<f64>>, Vec<[usize; 2]>) {
    let places = (0..7).map(|p| Vector3::new(0.5 * p as f64, (p % 2) as f64 * 0.9, 0.0)).collect();
    (places, (0..6).map(|p| [p, p + 1]).chain((0..5).map(|p| [p, p + 2])).collect())
}

/// All scenes.
pub fn all() -> Vec<Arc<Scene>> {
    let (places, pairs) = block();
    let free = Scene::of("tumbling block", "free, damped, with drag, weight and loads", places, pairs);

    let (places, pairs) = block();
    let mut driven =
        Scene::of("driven block", "held, guided and moving particles, one on a path with a corner", places, pairs);
    let constraint = |particle: usize, axes: &[usize], motion: Motion| Constraint {
        particles: vec![particle],
        axes: Axes::of(axes),
        motion,
    };
    let offsets = [Vector3::zeros(), Vector3::new(0.15, -0.1, 0.2), Vector3::new(-0.1, 0.1, 0.3)];
    driven.constraints = vec![
        constraint(0, &[0, 1, 2], Motion::Held),
        constraint(3, &[1], Motion::Held),
        constraint(5, &[0, 1, 2], Motion::Velocity(Vector3::new(0.4, -0.3, 0.2))),
        constraint(6, &[0, 2], Motion::Velocity(Vector3::new(-0.2, 0.0, 0.3))),
        constraint(7, &[0, 1, 2], Motion::Path { times: vec![0.0, 0.5, 1.5], offsets: offsets.to_vec() }),
    ];
    // A damper at the corner of a path would make the force jump.
    for (spring, pair) in driven.springs.iter_mut().zip(&driven.pairs) {
        spring.damping *= f64::from(u8::from(!pair.contains(&7)));
    }

    let (places, pairs) = strip();
    let mut actuated =
        Scene::of("actuated strip", "planar, with gravity and rest lengths that change in time", places, pairs);
    actuated.dimension = 2;
    actuated.path = roll;
    actuated.forces.iter_mut().for_each(|f| f.z = 0.0);
    let values = [[0.0, -9.81], [4.0, -5.0], [-3.0, -8.0]].map(|[x, y]| Vector3::new(x, y, 0.0));
    actuated.gravity = Curve { times: vec![0.0, 0.5, 1.0], values: values.to_vec() };
    actuated.actuation = vec![
        Actuation { springs: vec![0, 3, 7], factors: Curve { times: vec![0.0, 1.0], values: vec![1.0, 1.3] } },
        Actuation { springs: vec![2, 8], factors: Curve { times: vec![0.0, 0.5, 1.0], values: vec![1.1, 0.8, 1.0] } },
    ];

    let (places, pairs) = block();
    let mut pressed = Scene::of("pressed block", "springs of T = k (ε + ε³), all of them compressed", places, pairs);
    pressed.path = press;
    pressed.law = Law::Cubic;
    // Errors grow with the buckling of the block.
    pressed.duration = 0.5;
    for (spring, &[i, j]) in pressed.springs.iter_mut().zip(&pressed.pairs) {
        spring.rest_length = 1.05 * (pressed.places[i] - pressed.places[j]).norm();
    }

    let (places, pairs) = block();
    let mut slack = Scene::of("block without rest lengths", "half of the springs pull with k l", places, pairs);
    for spring in slack.springs.iter_mut().step_by(2) {
        spring.rest_length = 0.0;
    }
    [free, driven, actuated, pressed, slack].map(Arc::new).to_vec()
}
