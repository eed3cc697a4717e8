//! The work of moving constraints, of external forces, and of springs that change their rest lengths.
//!
//! A prescribed coordinate c that moves has an equation of its own, the row that the system leaves out: `f_c = m a_c − F_c` is
//! the force that makes it move, F_c those of springs and weight. Its work `∫ f_c v_c dt` is the change of
//! `½ m v_c² − m g_c x_c`, which is known exactly, less the work that the springs do on it, `∫ F_s·v_c dt`.
//!
//! Within a step of h seconds a prescribed coordinate counts as moving at its mean velocity `Δx_c/h`, as it does between kinks;
//! the rates of its springs are taken anew at both ends of every step. A spring pulls its ends together with
//! `T = k (l/l0 − 1) + b r`; with u the velocity of its prescribed coordinates, i's less j's, it takes the power `T g`,
//! `g = n·u`, from the constraint. Over the step, ′ being d/dt and `n′ = (Δv − n r)/l`,
//!
//! ```text
//! ∫ k (l/l0 − 1) g dt = h (f₀ + f₁)/2 + h² (f₀′ − f₁′)/12,
//! ∫ b r g dt = b h (r̄ ḡ + slope·slope_g/12 + c·c_g/5),
//! ```
//!
//! in the terms of `force::spring_energies`, both to fourth order. Where a step does not resolve a spring's own motion the corrections are left
//! out: `b h r̄ ḡ` goes with the dissipation `b h r̄²`.
//!
//! External forces do the work `Σ (f + f')·(x' − x)/2` in a step from x to x', to second order; the power that actuated springs
//! take up is integrated by the trapezoidal rule.

use crate::force::{RateParabola, SpringSums, actuation_power, add_external_forces, resolved_step};
use crate::spring::LawValues;
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

/// All moving prescribed coordinates and their springs, the external forces and the actuation.
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
    /// External forces at the last state, and room for those at the next.
    external: Option<[Vec<Vector3<f64>>; 2]>,
    /// The power that actuated springs take up, in W.
    actuation: f64,
}

impl<'s> Work<'s> {
    pub fn new(system: &'s System, state: &State) -> Self {
        let motions = system.prescribed().motions();
        let is_moving = |&(_, _, motion): &(Dof, f64, usize)| motions[motion] != Motion::Held;
        let moving: Vec<Dof> = system.prescribed().iter().filter(is_moving).map(|(dof, ..)| dof).collect();
        let mut velocities = vec![[None; 3]; if moving.is_empty() { 0 } else { system.particles() }];
        moving.iter().for_each(|dof| velocities[dof.particle][dof.axis] = Some(0.0));
        let moves = |p: usize| velocities.get(p).is_some_and(|axes| axes.iter().any(Option::is_some));
        let driven: Vec<_> = (0..system.pairs().len())
            .filter(|&spring| system.owns_spring(spring) && system.pair(spring).into_iter().any(moves))
            .map(|spring| (spring, resolved_step(system, spring)))
            .collect();
        let external = system.has_external_forces().then(|| {
            let mut force = vec![Vector3::zeros(); system.particles()];
            let room = force.clone();
            add_external_forces(system, &state.moment(), &mut force);
            [force, room]
        });
        let actuation = actuation_power(system, &state.moment());
        let mut work = Self { system, moving, velocities, driven, law: LawValues::default(), external, actuation };
        work.law = work.law_at(state);
        work
    }

    fn law_at(&self, state: &State) -> LawValues {
        if self.driven.is_empty() { LawValues::default() } else { self.system.law_values(&state.positions, state.time) }
    }

    /// The springs that end in a moving coordinate, ascending.
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

    /// Moves on from a state to another after a step of dt seconds: the work in the step, and the dissipation of driven springs.
    pub fn enter(&mut self, before: &State, after: &State, dt: f64) -> SpringSums {
        let mut sums = self.constraints([before, after], dt);
        sums.work += self.external_forces([before, after]);
        let power = actuation_power(self.system, &after.moment());
        sums.work += 0.5 * (self.actuation + power) * dt;
        self.actuation = power;
        sums
    }

    fn constraints(&mut self, states: [&State; 2], dt: f64) -> SpringSums {
        let law = self.law_at(states[1]);
        let before = std::mem::replace(&mut self.law, law);
        let Self { system, moving, velocities, driven, law, .. } = self;
        let (laws, time) = ([&before, law], states[1].time);
        for &Dof { particle, axis } in &*moving {
            let [from, to] = states.map(|state| state.positions[particle][axis]);
            velocities[particle][axis] = Some((to - from) / dt);
        }
        let within = |p: usize, v: &Vector3<f64>| Vector3::from_fn(|axis, _| velocities[p][axis].unwrap_or(v[axis]));
        let mut sums = SpringSums::default();
        for &(number, resolved) in &*driven {
            let [i, j] = system.pair(number);
            let relative = |vi: &Vector3<f64>, vj: &Vector3<f64>| within(i, vi) - within(j, vj);
            let ends = states
                .map(|State { positions: x, velocities: v, .. }| End::new(&(x[i] - x[j]), &relative(&v[i], &v[j])));
            let springs = [0, 1].map(|end: usize| system.spring_with(laws[end], number, ends[end].length, time));
            let force = [0, 1].map(|end: usize| {
                let (stiffness, End { length, rate, .. }) = (springs[end].axial_stiffness(), ends[end]);
                (stiffness * (length - springs[end].rest_length), stiffness * rate)
            });
            let u = relative(&Vector3::zeros(), &Vector3::zeros());
            sums = sums.add(&exchange([dt, resolved], &ends, force, springs[1].damping, &u));
        }
        sums
    }

    /// The work of external forces on free coordinates, in J.
    fn external_forces(&mut self, [before, after]: [&State; 2]) -> f64 {
        let Self { system, external: Some([last, next]), .. } = self else { return 0.0 };
        next.fill(Vector3::zeros());
        add_external_forces(system, &after.moment(), next);
        let mut work = 0.0;
        for p in 0..system.own_particles() {
            let moved = after.positions[p] - before.positions[p];
            work += 0.5 * system.dofs().free_axes(p).project(&(next[p] + last[p])).dot(&moved);
        }
        std::mem::swap(last, next);
        work
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

/// Work and dissipation of a driven spring in a step of dt seconds. `force` is its elastic tension with its derivative at both
/// ends of the step, `resolved` the longest step that resolves it; its prescribed coordinates move at u.
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
