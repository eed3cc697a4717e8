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
//! in the terms of `springs`, both to fourth order. Where a step does not resolve a spring's own motion the corrections are left
//! out: `b h r̄ ḡ` goes with the dissipation `b h r̄²`.
//!
//! External forces do the work `Σ (f + f')·(x' − x)/2` in a step from x to x', to second order; the power that actuated springs
//! take up is integrated by the trapezoidal rule.

use super::springs::{RateParabola, Sums, resolved_step};
use crate::force::{actuation_power, add_external_forces};
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
struct DrivenSpring {
    spring: usize,
    /// x_i − x_j.
    d: Vector3<f64>,
    velocities: [Vector3<f64>; 2],
    /// The longest step that resolves it, in s.
    resolved: f64,
}

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
    coordinates: Vec<Coordinate>,
    /// The mean velocities in the step of the coordinates that are prescribed, by particle; empty where none is.
    prescribed: Vec<[Option<f64>; 3]>,
    driven: Vec<DrivenSpring>,
    /// The values of the law at the last state, where it gives those of all springs at once.
    law: LawValues,
    external: Option<External>,
    /// The power that actuated springs take up, in W.
    actuation: f64,
}

/// External forces and positions at the last state.
pub(super) struct External {
    force: Vec<Vector3<f64>>,
    positions: Vec<Vector3<f64>>,
    scratch: Vec<Vector3<f64>>,
}

impl<'s> Work<'s> {
    pub fn new(system: &'s System, state: &State) -> Self {
        let motions = system.prescribed().motions();
        let moving = system.prescribed().iter().filter(|&(_, _, motion)| motions[motion] != Motion::Held);
        let coordinate =
            |particle: usize, axis: usize| Coordinate { particle, axis, position: state.positions[particle][axis] };
        let coordinates: Vec<_> = moving.map(|(dof, ..)| coordinate(dof.particle, dof.axis)).collect();
        let mut prescribed = vec![[None; 3]; if coordinates.is_empty() { 0 } else { system.particles() }];
        coordinates.iter().for_each(|c| prescribed[c.particle][c.axis] = Some(0.0));
        let is_prescribed = |p: usize| prescribed.get(p).is_some_and(|axes| axes.iter().any(Option::is_some));
        let driven = (0..system.pairs().len())
            .filter(|&spring| system.owns_spring(spring) && system.pair(spring).into_iter().any(is_prescribed))
            .map(|spring| {
                let [i, j] = system.pair(spring);
                let d = state.positions[i] - state.positions[j];
                let velocities = [state.velocities[i], state.velocities[j]];
                DrivenSpring { spring, d, velocities, resolved: resolved_step(system, spring) }
            })
            .collect();
        let external = system.has_external_forces().then(|| External::at(system, state));
        let actuation = actuation_power(system, &state.moment());
        let mut work = Self { system, coordinates, prescribed, driven, law: LawValues::default(), external, actuation };
        work.law = work.law_at(state);
        work
    }

    fn law_at(&self, state: &State) -> LawValues {
        if self.driven.is_empty() { LawValues::default() } else { self.system.law_values(&state.positions, state.time) }
    }

    /// The springs that end in a moving coordinate, ascending.
    pub fn driven(&self) -> impl Iterator<Item = usize> + '_ {
        self.driven.iter().map(|driven| driven.spring)
    }

    /// `Σ ½ m v²` and `−Σ m g x` over the moving coordinates.
    pub fn energy(&self, state: &State) -> BodyEnergy {
        let gravity = self.system.gravity();
        let mut prescribed = BodyEnergy::default();
        let own = self.system.own_particles();
        for c in self.coordinates.iter().filter(|c| c.particle < own) {
            let (x, v) = (state.positions[c.particle][c.axis], state.velocities[c.particle][c.axis]);
            let mass = self.system.masses()[c.particle];
            prescribed.kinetic += 0.5 * mass * v * v;
            prescribed.gravitational -= mass * gravity[c.axis] * x;
        }
        let [kinetic, gravitational] = self.system.total([prescribed.kinetic, prescribed.gravitational]);
        BodyEnergy { kinetic, gravitational }
    }

    /// Moves on to a state that a step of dt seconds led to: the work in the step, and the dissipation of driven springs.
    pub fn enter(&mut self, state: &State, dt: f64) -> Sums {
        let mut sums = self.constraints(state, dt);
        sums.work += self.external.as_mut().map_or(0.0, |external| external.enter(self.system, state));
        let power = actuation_power(self.system, &state.moment());
        sums.work += 0.5 * (self.actuation + power) * dt;
        self.actuation = power;
        sums
    }

    fn constraints(&mut self, state: &State, dt: f64) -> Sums {
        let law = self.law_at(state);
        let before = std::mem::replace(&mut self.law, law);
        let Self { system, coordinates, prescribed, driven, law, .. } = self;
        let laws = [&before, law];
        for c in coordinates {
            let position = state.positions[c.particle][c.axis];
            prescribed[c.particle][c.axis] = Some((position - c.position) / dt);
            c.position = position;
        }
        let within = |p: usize, v: &Vector3<f64>| Vector3::from_fn(|axis, _| prescribed[p][axis].unwrap_or(v[axis]));
        let mut sums = Sums::default();
        for driven in driven {
            let [i, j] = system.pair(driven.spring);
            let (d, velocities) = (state.positions[i] - state.positions[j], [state.velocities[i], state.velocities[j]]);
            let relative = |[vi, vj]: &[Vector3<f64>; 2]| within(i, vi) - within(j, vj);
            let ends = [End::new(&driven.d, &relative(&driven.velocities)), End::new(&d, &relative(&velocities))];
            let force = [0, 1].map(|end: usize| {
                let End { length, rate, .. } = ends[end];
                let spring = system.spring_with(laws[end], driven.spring, length, state.time);
                let stiffness = spring.axial_stiffness();
                (stiffness * (length - spring.rest_length), stiffness * rate)
            });
            let damping = system.spring_with(laws[1], driven.spring, d.norm(), state.time).damping;
            let u = relative(&[Vector3::zeros(); 2]);
            sums = sums.add(&exchange([dt, driven.resolved], &ends, force, damping, &u));
            (driven.d, driven.velocities) = (d, velocities);
        }
        sums.of_all_parts(system)
    }
}

/// A driven spring at one end of a step.
pub(super) struct End {
    pub n: Vector3<f64>,
    /// n′, in 1/s.
    pub turning: Vector3<f64>,
    pub length: f64,
    pub rate: f64,
}

impl End {
    /// A spring whose ends are d apart and move at the relative velocity v; without length it has no direction.
    pub fn new(d: &Vector3<f64>, v: &Vector3<f64>) -> Self {
        let length = d.norm();
        let n = if length > 0.0 { d / length } else { Vector3::zeros() };
        let rate = n.dot(v);
        let turning = if length > 0.0 { (v - n * rate) / length } else { Vector3::zeros() };
        Self { n, turning, length, rate }
    }
}

/// Work and dissipation of a driven spring in a step of dt seconds. `force` is its elastic tension with its derivative at both
/// ends of the step, `resolved` the longest step that resolves it; its prescribed coordinates move at u.
pub(super) fn exchange(
    [dt, resolved]: [f64; 2],
    ends: &[End; 2],
    force: [(f64, f64); 2],
    damping: f64,
    u: &Vector3<f64>,
) -> Sums {
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
    Sums { elastic: 0.0, work: elastic + pull + pull_resolved, dissipated: certain + resolved, certain }
}

impl External {
    pub fn at(system: &System, state: &State) -> Self {
        let zeros = || vec![Vector3::zeros(); system.particles()];
        let mut external = Self { force: zeros(), positions: state.positions.clone(), scratch: zeros() };
        add_external_forces(system, &state.moment(), &mut external.force);
        external
    }

    /// The work since the last state on free coordinates, in J.
    pub fn enter(&mut self, system: &System, state: &State) -> f64 {
        self.scratch.fill(Vector3::zeros());
        add_external_forces(system, &state.moment(), &mut self.scratch);
        let mut work = 0.0;
        for (p, (x, f)) in state.positions.iter().zip(&self.scratch).enumerate().take(system.own_particles()) {
            let (moved, sum) = (x - self.positions[p], f + self.force[p]);
            work += system.dofs().free_axes(p).iter().map(|axis| 0.5 * sum[axis] * moved[axis]).sum::<f64>();
        }
        std::mem::swap(&mut self.force, &mut self.scratch);
        self.positions.copy_from_slice(&state.positions);
        let [work] = system.total([work]);
        work
    }
}
