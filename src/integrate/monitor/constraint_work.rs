//! The work of moving constraints.
//!
//! A prescribed coordinate c that moves has equations of its own, the rows that the system leaves out: `f_c = m a_c − F_c` is
//! the force that makes it move, F_c those of springs and weight. Its work `∫ f_c v_c dt` is the change of `½ m v_c² − m g_c x_c`,
//! which is known exactly whatever kinks the path has, less the work that the springs do on it, `∫ F_s·v_c dt`.
//!
//! Within a step of h seconds a prescribed coordinate counts as moving at its mean velocity `Δx_c/h`, which is what it does
//! between kinks; so the rates of its springs are taken anew at both ends of every step. A spring pulls its ends together
//! with `T = k (l/l0 − 1) + b r`; with u the velocity of its prescribed coordinates, i's less j's, it takes the power
//! `T g`, `g = n·u`, from the constraint. Over the step, ′ being d/dt and `n′ = (Δv − n r)/l`,
//!
//! ```text
//! ∫ k (l/l0 − 1) g dt = h (f₀ + f₁)/2 + h² (f₀′ − f₁′)/12,      ∫ b r g dt = b h (r̄ ḡ + slope·slope_g/12 + bend·bend_g/5),
//! ```
//!
//! in the terms of `springs`. Both are right to the fourth order. Where a step does not resolve a spring's own motion, the
//! corrections are left out as they are there: `b h r̄ ḡ` goes with the dissipation `b h r̄²`.

use super::Sides;
use super::springs::{resolved_step, span};
use super::sums::Span;
use crate::spring::LawValues;
use crate::system::{Motion, State, System};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// A moving prescribed coordinate at the last state.
struct Coordinate {
    particle: usize,
    axis: usize,
    position: f64,
}

/// A spring that ends in one, at the last state.
struct Driven {
    spring: usize,
    /// x_i − x_j.
    d: Vector3<f64>,
    velocities: [Vector3<f64>; 2],
    /// The longest step that resolves it, in s.
    resolved: f64,
}

/// The motion of prescribed coordinates over a step, for every particle; empty where nothing is driven.
struct Lead {
    moving: Vec<[bool; 3]>,
    mean: Vec<Vector3<f64>>,
}

impl Lead {
    /// The velocity of a particle within the step, from the one that its state has.
    fn during(&self, particle: usize, v: &Vector3<f64>) -> Vector3<f64> {
        let (moving, mean) = (&self.moving[particle], &self.mean[particle]);
        Vector3::from_fn(|axis, _| if moving[axis] { mean[axis] } else { v[axis] })
    }
}

/// All moving prescribed coordinates and their springs.
pub(super) struct ConstraintWork<'s> {
    system: &'s System,
    coordinates: Vec<Coordinate>,
    lead: Lead,
    springs: Vec<Driven>,
    /// What a law that is asked for all springs at once said at the last state.
    law: LawValues,
}

/// Energy of the moving coordinates themselves, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct DrivenEnergy {
    pub kinetic: f64,
    pub gravitational: f64,
}

impl DrivenEnergy {
    pub fn total(&self) -> f64 {
        self.kinetic + self.gravitational
    }
}

/// What went through the driven springs in a step, in J.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Exchange {
    /// What constraints put into them.
    pub work: f64,
    /// What their damping took.
    pub dissipated: f64,
    /// The least that it can have taken.
    pub certain: f64,
}

impl<'s> ConstraintWork<'s> {
    pub fn new(system: &'s System, state: &State) -> Self {
        let motions = system.prescribed().motions();
        let moving = system.prescribed().iter().filter(|&(_, _, motion)| motions[motion] != Motion::Held);
        let coordinates: Vec<Coordinate> = moving
            .map(|(dof, ..)| {
                let position = state.positions[dof.particle][dof.axis];
                Coordinate { particle: dof.particle, axis: dof.axis, position }
            })
            .collect();
        let particles = if coordinates.is_empty() { 0 } else { system.particles() };
        let mut moving = vec![[false; 3]; particles];
        coordinates.iter().for_each(|c| moving[c.particle][c.axis] = true);
        let is_driven = |p: usize| moving.get(p).is_some_and(|axes| axes.contains(&true));
        let springs = (0..system.pairs().len())
            .filter(|&spring| system.owns_spring(spring) && system.pair(spring).into_iter().any(is_driven))
            .map(|spring| {
                let [i, j] = system.pair(spring);
                let d = state.positions[i] - state.positions[j];
                let velocities = [state.velocities[i], state.velocities[j]];
                Driven { spring, d, velocities, resolved: resolved_step(system, spring) }
            })
            .collect();
        let lead = Lead { moving, mean: vec![Vector3::zeros(); particles] };
        let mut drive = Self { system, coordinates, lead, springs, law: LawValues::default() };
        drive.law = drive.law_at(state);
        drive
    }

    /// What such a law says at a state, where springs are driven.
    fn law_at(&self, state: &State) -> LawValues {
        if self.springs.is_empty() {
            LawValues::default()
        } else {
            self.system.law_values(&state.positions, state.time)
        }
    }

    /// The springs that end in a moving coordinate.
    pub fn springs(&self) -> impl Iterator<Item = usize> + '_ {
        self.springs.iter().map(|driven| driven.spring)
    }

    /// `Σ ½ m v²` and `−Σ m g x` over the moving coordinates, in J.
    pub fn energy(&self, state: &State) -> DrivenEnergy {
        let gravity = self.system.gravity();
        let mut led = DrivenEnergy::default();
        let own = self.system.own_particles();
        for c in self.coordinates.iter().filter(|c| c.particle < own) {
            let (x, v) = (state.positions[c.particle][c.axis], state.velocities[c.particle][c.axis]);
            let mass = self.system.masses()[c.particle];
            led.kinetic += 0.5 * mass * v * v;
            led.gravitational -= mass * gravity[c.axis] * x;
        }
        let [kinetic, gravitational] = self.system.total([led.kinetic, led.gravitational]);
        DrivenEnergy { kinetic, gravitational }
    }

    /// Goes on to a state that a step of dt seconds led to.
    pub fn pass(&mut self, state: &State, dt: f64) -> Exchange {
        let now = self.law_at(state);
        let before = std::mem::replace(&mut self.law, now);
        let Self { system, coordinates, lead, springs, law } = self;
        let laws = [&before, law];
        for c in coordinates {
            let position = state.positions[c.particle][c.axis];
            lead.mean[c.particle][c.axis] = (position - c.position) / dt;
            c.position = position;
        }
        let mut exchange = Exchange::default();
        for driven in springs {
            let [i, j] = system.pair(driven.spring);
            let (d, velocities) = (state.positions[i] - state.positions[j], [state.velocities[i], state.velocities[j]]);
            let relative = |[vi, vj]: &[Vector3<f64>; 2]| lead.during(i, vi) - lead.during(j, vj);
            let only = |p: usize| lead.during(p, &Vector3::zeros());
            let ends = [End::of(&driven.d, &relative(&driven.velocities)), End::of(&d, &relative(&velocities))];
            let force = [0, 1].map(|end: usize| {
                let Span { length, rate } = ends[end].span;
                let spring = system.spring_with(laws[end], driven.spring, length, state.time);
                let stiffness = spring.axial_stiffness();
                (stiffness * (length - spring.rest_length), stiffness * rate)
            });
            let step = Step { dt, is_resolved: dt <= driven.resolved };
            let damping = system.spring_with(laws[1], driven.spring, d.norm(), state.time).damping;
            exchange.add(&step.exchange(&ends, force, damping, &(only(i) - only(j))));
            (driven.d, driven.velocities) = (d, velocities);
        }
        let Exchange { work, dissipated, certain } = exchange;
        let [work, dissipated, certain] = system.total([work, dissipated, certain]);
        Exchange { work, dissipated, certain }
    }
}

impl Exchange {
    fn add(&mut self, other: &Self) {
        self.work += other.work;
        self.dissipated += other.dissipated;
        self.certain += other.certain;
    }
}

/// A spring at one end of a step.
struct End {
    n: Vector3<f64>,
    /// n′, in 1/s.
    turn: Vector3<f64>,
    span: Span,
}

impl End {
    fn of(d: &Vector3<f64>, v: &Vector3<f64>) -> Self {
        let (n, span) = span(d, v);
        let turn = if span.length > 0.0 { (v - n * span.rate) / span.length } else { Vector3::zeros() };
        Self { n, turn, span }
    }
}

struct Step {
    dt: f64,
    is_resolved: bool,
}

impl Step {
    /// Of a spring whose elastic tension and its derivative at both ends are `force`, its prescribed coordinates moving at u.
    fn exchange(&self, ends: &[End; 2], force: [(f64, f64); 2], damping: f64, u: &Vector3<f64>) -> Exchange {
        let Self { dt, is_resolved } = *self;
        let correction = if is_resolved { dt / 12.0 } else { 0.0 };
        let [first, last] = ends;
        let (g, slope) = ([first.n.dot(u), last.n.dot(u)], [first.turn.dot(u), last.turn.dot(u)]);
        let power = |end: usize| force[end].0 * g[end];
        let change = |end: usize| force[end].1 * g[end] + force[end].0 * slope[end];
        let elastic = dt * (0.5 * (power(0) + power(1)) + correction * (change(0) - change(1)));

        let rate = Sides::of(&first.span, last.span.length, last.span.rate, 1.0 / dt);
        let middle = 0.5 * (g[0] + g[1]);
        let along = Sides { mean: middle + correction * (slope[0] - slope[1]), slope: g[1] - g[0], bend: 0.0 };
        let along = Sides { bend: middle - along.mean, ..along };
        let product = |other: &Sides| {
            let certain = rate.mean * other.mean;
            let resolved = rate.slope * other.slope / 12.0 + rate.bend * other.bend / 5.0;
            (damping * dt * certain, damping * dt * if is_resolved { resolved } else { 0.0 })
        };
        let (certain, resolved) = product(&rate);
        let (pull, pull_resolved) = product(&along);
        Exchange { work: elastic + pull + pull_resolved, dissipated: certain + resolved, certain }
    }
}

#[cfg(test)]
mod tests;
