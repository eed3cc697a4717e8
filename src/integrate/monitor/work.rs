//! The work of moving constraints, of springs that change their rest lengths, and of loads (`load_work`).
//!
//! A prescribed coordinate c that moves has an equation of its own: `f_c = m a_c − F_c` is the force that makes it move, F_c those of springs and
//! weight. Its work `∫ f_c v_c dt` is the change of `½ m v_c² − m g_c x_c`, which is known exactly, less the work that the springs do on it,
//! `∫ F_s·v_c dt`.
//!
//! Within a step of h seconds it counts as moving at its mean velocity `Δx_c/h`. A spring pulls its ends together with `T = k (l/l0 − 1) + b r`; with
//! u the velocity of its prescribed coordinates, i's less j's, it takes the power `T g`, `g = n·u`, from the constraint. Over the step, ′ being d/dt
//! and `n′ = (Δv − n r)/l`,
//!
//! ```text
//! ∫ k (l/l0 − 1) g dt = h (f₀ + f₁)/2 + h² (f₀′ − f₁′)/12,
//! ∫ b r g dt = b h (r̄ ḡ + slope·slope_g/12 + c·c_g/5),
//! ```
//!
//! in the terms of `force::spring_energies`, both to fourth order. Where a step does not resolve a spring's own motion the corrections are left out:
//! `b h r̄ ḡ` goes with the dissipation `b h r̄²`.
//!
//! A spring with the elastic energy U(l, t) whose rest length changes takes up `∫ ∂U/∂t dt`; with the mean of both ends
//!
//! ```text
//! W(t, t') = ½ (U(l, t') − U(l, t) + U(l', t') − U(l', t))
//! ```
//!
//! is right to second order, and exactly while the length stays. With the length l_m in the middle, by the cubic Hermite polynomial where the step
//! resolves the spring, `(4 (W(t, t_m) + W(t_m, t')) − W(t, t'))/3` is right to fourth.

use super::load_work::LoadWork;
use crate::force::{RateParabola, SpringSums, resolved_step};
use crate::spring::{Extension, LawValues};
use crate::system::{Dof, Motion, State, System};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Kinetic and gravitational energy of a part of a scene, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct BodyEnergy {
    pub kinetic: f64,
    pub gravitational: f64,
}

impl BodyEnergy {
    pub fn total(&self) -> f64 {
        self.kinetic + self.gravitational
    }
}

/// All moving prescribed coordinates and their springs, the loads and the actuated springs.
pub(super) struct Work<'s> {
    system: &'s System,
    /// The moving prescribed coordinates.
    moving: Vec<Dof>,
    /// Their mean velocities in the step, by particle and axis; empty where none moves.
    velocities: Vec<[Option<f64>; 3]>,
    /// The springs that end in one, ascending, each with the longest step that resolves it, in s.
    driven: Vec<(usize, f64)>,
    /// The values of the law at the last state, where it gives those of all springs at once.
    law: LawValues,
    loads: LoadWork<'s>,
    /// The springs whose rest lengths change, each with the longest step that resolves it, in s.
    actuated: Vec<(usize, f64)>,
}

impl<'s> Work<'s> {
    pub fn new(system: &'s System, state: &State) -> Self {
        let motions = system.prescribed().motions();
        let is_moving = |&(_, _, motion): &(Dof, f64, usize)| motions[motion] != Motion::Held;
        let moving: Vec<Dof> = system.prescribed().iter().filter(is_moving).map(|(dof, ..)| dof).collect();
        let mut velocities = vec![[None; 3]; if moving.is_empty() { 0 } else { system.particles() }];
        moving.iter().for_each(|dof| velocities[dof.particle][dof.axis] = Some(0.0));
        let moves = |p: usize| velocities.get(p).is_some_and(|axes| axes.iter().any(Option::is_some));
        let springs = |counts: &dyn Fn(usize) -> bool| -> Vec<(usize, f64)> {
            let own = (0..system.pairs().len()).filter(|&spring| system.owns_spring(spring) && counts(spring));
            own.map(|spring| (spring, resolved_step(system, spring))).collect()
        };
        let driven = springs(&|spring| system.pair(spring).into_iter().any(moves));
        let actuated = springs(&|spring| system.actuation(spring, 0.0).is_some());
        let loads = LoadWork::new(system, state);
        let mut work = Self { system, moving, velocities, driven, law: LawValues::default(), loads, actuated };
        work.law = work.law_at(state);
        work
    }

    fn law_at(&self, state: &State) -> LawValues {
        if self.driven.is_empty() { LawValues::default() } else { self.system.law_values(&state.positions, state.time) }
    }

    pub fn driven(&self) -> impl Iterator<Item = usize> + '_ {
        self.driven.iter().map(|&(spring, _)| spring)
    }

    /// `Σ ½ m v²` and `−Σ m g x` over the moving coordinates.
    pub fn energy(&self, state: &State) -> BodyEnergy {
        let gravity = self.system.gravity();
        let mut energy = BodyEnergy::default();
        let own = self.system.own_particles();
        for &Dof { particle, axis } in self.moving.iter().filter(|dof| dof.particle < own) {
            let (x, v) = (state.positions[particle][axis], state.velocities[particle][axis]);
            let mass = self.system.masses()[particle];
            energy.kinetic += 0.5 * mass * v * v;
            energy.gravitational -= mass * gravity[axis] * x;
        }
        let [kinetic, gravitational] = self.system.total([energy.kinetic, energy.gravitational]);
        BodyEnergy { kinetic, gravitational }
    }

    /// Moves on from a state to another after a step of dt seconds: the work in the step, and the dissipation of driven springs and of drag. The
    /// states of a run with error control are accurate: they count as resolved.
    pub fn enter(&mut self, before: &State, after: &State, dt: f64, is_accurate: bool) -> SpringSums {
        let states = [before, after];
        for &Dof { particle, axis } in &self.moving {
            let [from, to] = states.map(|state| state.positions[particle][axis]);
            self.velocities[particle][axis] = Some((to - from) / dt);
        }
        let mut sums = self.constraints(states, dt).add(&self.loads.enter(states, dt, is_accurate));
        sums.work += self.actuation(states, dt, is_accurate);
        sums
    }

    /// The velocity of a particle with those of its moving coordinates in the step in place of their own.
    fn within(&self, p: usize, v: &Vector3<f64>) -> Vector3<f64> {
        self.velocities.get(p).map_or(*v, |known| Vector3::from_fn(|axis, _| known[axis].unwrap_or(v[axis])))
    }

    fn ends(&self, number: usize, states: [&State; 2]) -> [End; 2] {
        let [i, j] = self.system.pair(number);
        states.map(|State { positions: x, velocities: v, .. }| {
            End::new(&(x[i] - x[j]), &(self.within(i, &v[i]) - self.within(j, &v[j])))
        })
    }

    fn constraints(&mut self, states: [&State; 2], dt: f64) -> SpringSums {
        let law = self.law_at(states[1]);
        let before = std::mem::replace(&mut self.law, law);
        let (system, laws) = (self.system, [&before, &self.law]);
        let zero = Vector3::zeros();
        let mut sums = SpringSums::default();
        for &(number, resolved) in &self.driven {
            let [i, j] = system.pair(number);
            let ends = self.ends(number, states);
            let at = |end: usize| system.spring_with(laws[end], number, ends[end].length, states[end].time);
            let springs = [at(0), at(1)];
            let factors = states.map(|state| system.actuation(number, state.time).map_or(1.0, |[factor, _]| factor));
            let force = [0, 1].map(|end: usize| {
                let (stiffness, End { length, rate, .. }) = (springs[end].axial_stiffness(), ends[end]);
                let lengthened = length * (factors[1] - factors[0]) / (dt * factors[end]);
                (stiffness * (length - springs[end].rest_length), stiffness * (rate - lengthened))
            });
            let u = self.within(i, &zero) - self.within(j, &zero);
            sums = sums.add(&exchange([dt, resolved], &ends, force, springs[1].damping, &u));
        }
        sums
    }

    /// The energy that springs take up because their rest lengths change, in J.
    fn actuation(&self, states: [&State; 2], dt: f64, is_accurate: bool) -> f64 {
        if self.actuated.is_empty() {
            return 0.0;
        }
        let [start, end] = states.map(|state| state.time);
        let times = [start, 0.5 * (start + end), end];
        let lengths = |number: usize, resolved: f64| {
            let [first, last] = self.ends(number, states);
            let bent = if is_accurate || dt <= resolved { dt / 8.0 * (first.rate - last.rate) } else { 0.0 };
            [first.length, 0.5 * (first.length + last.length) + bent, last.length]
        };
        let length = |number: usize, at: usize| lengths(number, resolved_step(self.system, number))[at];
        let laws = [0, 1, 2].map(|at| times.map(|time| self.system.law_values_of(|number| length(number, at), time)));
        let work = |&(number, resolved): &(usize, f64)| {
            let springs = times.map(|time| self.system.spring_then(number, time));
            if springs[0] == springs[1] && springs[1] == springs[2] {
                return 0.0;
            }
            let lengths = lengths(number, resolved);
            let energy = |at: usize, then: usize| {
                let extension = Extension { direction: Vector3::zeros(), length: lengths[at] };
                self.system.elastic_energy_of(&laws[at][then], number, &springs[then], &extension)
            };
            let taken = |from: usize, to: usize| {
                0.5 * ((energy(from, to) - energy(from, from)) + (energy(to, to) - energy(to, from)))
            };
            (4.0 * (taken(0, 1) + taken(1, 2)) - taken(0, 2)) / 3.0
        };
        self.actuated.iter().map(work).sum()
    }
}

/// A driven spring at one end of a step.
#[derive(Clone, Copy)]
struct End {
    n: Vector3<f64>,
    /// n′, in 1/s.
    turning: Vector3<f64>,
    length: f64,
    rate: f64,
}

impl End {
    /// A spring whose ends are d apart and move at the relative velocity v; without length it has no direction.
    fn new(d: &Vector3<f64>, v: &Vector3<f64>) -> Self {
        let length = d.norm();
        let n = if length > 0.0 { d / length } else { Vector3::zeros() };
        let rate = n.dot(v);
        let turning = if length > 0.0 { (v - n * rate) / length } else { Vector3::zeros() };
        Self { n, turning, length, rate }
    }
}

/// Work and dissipation of a driven spring in a step of dt seconds. `force` is its elastic tension with its derivative at both ends of the step,
/// `resolved` the longest step that resolves it; its prescribed coordinates move at u.
fn exchange(
    [dt, resolved]: [f64; 2],
    ends: &[End; 2],
    force: [(f64, f64); 2],
    damping: f64,
    u: &Vector3<f64>,
) -> SpringSums {
    let is_resolved = dt <= resolved;
    let correction = if is_resolved { dt / 12.0 } else { 0.0 };
    let [first, last] = ends;
    let (g, slope) = ([first.n.dot(u), last.n.dot(u)], [first.turning.dot(u), last.turning.dot(u)]);
    let power = |end: usize| force[end].0 * g[end];
    let change = |end: usize| force[end].1 * g[end] + force[end].0 * slope[end];
    let elastic = dt * (0.5 * (power(0) + power(1)) + correction * (change(0) - change(1)));

    let rate = RateParabola::new([first.length, last.length], [first.rate, last.rate], 1.0 / dt);
    let middle = 0.5 * (g[0] + g[1]);
    let mean = middle + correction * (slope[0] - slope[1]);
    let ends = RateParabola { mean, slope: g[1] - g[0], second_difference: middle - mean };
    let product = |other: &RateParabola| {
        let certain = rate.mean * other.mean;
        let resolved = rate.slope * other.slope / 12.0 + rate.second_difference * other.second_difference / 5.0;
        (damping * dt * certain, damping * dt * if is_resolved { resolved } else { 0.0 })
    };
    let (certain, resolved) = product(&rate);
    let (pull, pull_resolved) = product(&ends);
    SpringSums { elastic: 0.0, work: elastic + pull + pull_resolved, dissipated: certain + resolved, certain }
}
