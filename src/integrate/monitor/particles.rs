//! One pass over the particles after every step: what they carry, and how their motion bends.
//!
//! The figures are norms over the free coordinates, each free at this point of a run:
//!
//! ```text
//! change  ‖v' − v‖                          h² ẍ/h: what a method of first order neglects, h/2 of it in the positions
//! bend    ‖(v' − v) − (h/h₋)(v − v₋)‖       h² v̈: what one of second order neglects
//! third   ‖δx' − 2r δx + r² δx₋‖ᵃ           h³ x⃛: the same from the positions alone, r = h/h₋
//! slip    ‖x' − x − h (v + v')/2‖           how far positions are from the trapezoidal rule of their own velocities
//! defect  ‖M (v' − v)/h − F(x', v')‖        the residual of backward Euler, where the forces are known
//! ```
//!
//! A scene that nothing holds flies and falls as a whole, which no spring sees. What its centre of mass carries is known by itself, and
//! speeds are those about it: how far it flies says nothing about how its parts move.

use crate::system::{Axes, State, System};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Particles of a block.
const BLOCK: usize = 4096;

/// Sums over particles at a state, and over the step that led to it: energies in J, squares of the figures above.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Sums {
    /// `Σ ½ m v²`.
    pub kinetic: f64,
    /// `Σ m gravity·x`.
    pub weight: f64,
    pub change: f64,
    pub bend: f64,
    pub third: f64,
    pub slip: f64,
    pub defect: f64,
    /// `‖M (v' − v)/h‖²`, what the defect is a part of.
    pub inertia: f64,
    /// `‖v'‖²`, of a scene that nothing holds about its centre of mass.
    pub speed: f64,
    /// What the centre of mass of a scene that nothing holds has of `kinetic` and `weight`.
    pub carried: Carried,
    /// `Σ m`, `Σ m v`, the number of particles and `Σ v` where nothing is held.
    whole: Whole,
}

/// Energy of the centre of mass: kinetic, and `Σ m gravity·x`, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Carried {
    pub kinetic: f64,
    pub weight: f64,
}

#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Whole {
    mass: f64,
    momentum: Vector3<f64>,
    count: f64,
    velocity: Vector3<f64>,
}

impl Whole {
    fn enter(&mut self, mass: f64, v: &Vector3<f64>) {
        self.mass += mass;
        self.momentum += v * mass;
        self.count += 1.0;
        self.velocity += v;
    }

    fn add(&mut self, other: &Self) {
        self.mass += other.mass;
        self.momentum += other.momentum;
        self.count += other.count;
        self.velocity += other.velocity;
    }

    /// With those of all other parts of a system.
    fn of_all(self, system: &System) -> Self {
        let Self { mass, momentum, count, velocity } = self;
        let [mass, count] = system.total([mass, count]);
        let [momentum, velocity] = [momentum, velocity].map(|sum| Vector3::from(system.total(sum.into())));
        Self { mass, momentum, count, velocity }
    }
}

impl Sums {
    fn add(mut self, other: &Self) -> Self {
        self.whole.add(&other.whole);
        self.kinetic += other.kinetic;
        self.weight += other.weight;
        self.change += other.change;
        self.bend += other.bend;
        self.third += other.third;
        self.slip += other.slip;
        self.defect += other.defect;
        self.inertia += other.inertia;
        self.speed += other.speed;
        self
    }

    /// With those of all other parts of a system.
    fn of_all(self, system: &System) -> Self {
        let Self { kinetic, weight, change, bend, third, slip, defect, inertia, speed, carried, whole } = self;
        let [kinetic, weight, change, bend, third, slip, defect, inertia, speed] =
            system.total([kinetic, weight, change, bend, third, slip, defect, inertia, speed]);
        let whole = whole.of_all(system);
        Self { kinetic, weight, change, bend, third, slip, defect, inertia, speed, carried, whole }
    }

    /// As seen from the centre of mass of a scene that nothing holds.
    fn about_the_centre(self) -> Self {
        let Whole { mass, momentum, count, velocity } = self.whole;
        if mass == 0.0 {
            return self;
        }
        let centre = momentum / mass;
        let carried = Carried { kinetic: 0.5 * mass * centre.norm_squared(), weight: self.weight };
        let speed = self.speed - 2.0 * centre.dot(&velocity) + count * centre.norm_squared();
        Self { speed: speed.max(0.0), carried, ..self }
    }
}

/// A particle at the last state.
#[derive(Debug, Clone, Copy)]
struct Trace {
    velocity: Vector3<f64>,
    /// By which the last step changed it.
    change: Vector3<f64>,
}

/// Where a particle has come from.
#[derive(Debug, Clone, Copy)]
struct Path {
    position: Vector3<f64>,
    /// By which the last step changed the position, and by how much more than the one before.
    step: Vector3<f64>,
    more: Vector3<f64>,
}

/// Particles that one thread treats at a stretch, at the last state. Sums are made block by block, whatever the number of threads.
struct Block {
    traces: Vec<Trace>,
    /// Empty where they are not asked for.
    paths: Vec<Path>,
    sums: Sums,
}

/// All particles at the last state.
pub(super) struct Particles<'s> {
    system: &'s System,
    blocks: Vec<Block>,
    /// Whether nothing is held, so that the centre of mass goes its own way.
    is_loose: bool,
    /// Length of the last step, in s; zero before the first.
    last: f64,
    steps: u64,
}

impl<'s> Particles<'s> {
    /// At a state; `follows` says whether paths are looked at.
    pub fn new(system: &'s System, state: &State, follows: bool) -> Self {
        let (zero, own) = (Vector3::zeros(), system.own_particles());
        let block = |(positions, velocities): (&[Vector3<f64>], &[Vector3<f64>])| {
            let positions = if follows { positions } else { &[] };
            Block {
                traces: velocities.iter().map(|&velocity| Trace { velocity, change: zero }).collect(),
                paths: positions.iter().map(|&position| Path { position, step: zero, more: zero }).collect(),
                sums: Sums::default(),
            }
        };
        let positions = state.positions[..own].chunks(BLOCK);
        let blocks = positions.zip(state.velocities[..own].chunks(BLOCK)).map(block).collect();
        let [prescribed] = system.total([system.prescribed().iter().count() as f64]);
        let is_loose = prescribed == 0.0 && !system.has_external_forces();
        Self { system, blocks, is_loose, last: 0.0, steps: 0 }
    }

    /// Goes on to a state that a step of dt seconds led to; `force` is the one there, where it is known.
    pub fn pass(&mut self, state: &State, dt: f64, force: Option<&[Vector3<f64>]>) -> Sums {
        let Self { system, blocks, is_loose, last, steps } = self;
        let step = Step { system, state, force, is_loose: *is_loose, dt, last: *last, steps: *steps };
        let pass = |(number, block): (usize, &mut Block)| step.pass(number * BLOCK, block);
        if blocks.len() > 1 {
            blocks.par_iter_mut().enumerate().for_each(pass);
        } else {
            blocks.iter_mut().enumerate().for_each(pass);
        }
        *last = dt;
        *steps += u64::from(dt > 0.0);
        let sums = blocks.iter().map(|block| &block.sums);
        sums.fold(Sums::default(), Sums::add).of_all(system).about_the_centre()
    }
}

/// What all blocks of a pass see.
struct Step<'a> {
    system: &'a System,
    state: &'a State,
    force: Option<&'a [Vector3<f64>]>,
    is_loose: bool,
    dt: f64,
    last: f64,
    /// Before this one.
    steps: u64,
}

impl Step<'_> {
    /// Goes over the particles of a block, which begins with `first`.
    fn pass(&self, first: usize, block: &mut Block) {
        let Self { system, state, force, is_loose, dt, last, steps } = *self;
        let (gravity, masses) = (system.gravity(), system.masses());
        let ratio = if last > 0.0 { dt / last } else { 0.0 };
        let mut sums = Sums::default();
        let mut paths = block.paths.iter_mut();
        for (p, trace) in (first..).zip(&mut block.traces) {
            let (x, v, mass) = (state.positions[p], state.velocities[p], masses[p]);
            sums.kinetic += 0.5 * mass * v.norm_squared();
            sums.weight += mass * gravity.dot(&x);
            if is_loose {
                sums.whole.enter(mass, &v);
            }
            let before = std::mem::replace(&mut trace.velocity, v);
            if dt > 0.0 {
                let change = v - before;
                let bend = if last > 0.0 { change - trace.change * ratio } else { Vector3::zeros() };
                let free = system.dofs().free_axes(p);
                let square = |vector: &Vector3<f64>| norm_squared(vector, free);
                sums.change += square(&change);
                sums.bend += square(&bend);
                if let Some(path) = paths.next() {
                    let way = x - path.position;
                    let slip = way - (v + before) * (0.5 * dt);
                    let more = if steps > 0 { way - path.step * ratio } else { Vector3::zeros() };
                    let third = if steps > 1 { more - path.more * (ratio * ratio) } else { Vector3::zeros() };
                    sums.third += square(&third);
                    sums.slip += square(&slip);
                    *path = Path { position: x, step: way, more };
                }
                if let Some(force) = force {
                    let inertia = change * (mass / dt);
                    sums.defect += square(&(inertia - force[p]));
                    sums.inertia += square(&inertia);
                }
                sums.speed += square(&v);
                trace.change = change;
            }
        }
        block.sums = sums;
    }
}

/// Over some of the axes.
#[inline(always)]
fn norm_squared(v: &Vector3<f64>, axes: Axes) -> f64 {
    if axes == Axes::ALL {
        return v.norm_squared();
    }
    let square = |axis: usize| if axes.contains(axis) { v[axis] * v[axis] } else { 0.0 };
    square(0) + square(1) + square(2)
}

#[cfg(test)]
mod tests;
