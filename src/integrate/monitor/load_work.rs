//! The work of loads and external forces on free coordinates, and the dissipation of drag.
//!
//! In a step of h seconds from x to x' the constant loads do the work `f·(x' − x)`. Gravity that changes in time acts as `m (g(t) − g(0))`, which is
//! linear in time between its kinks. With the parabola of the velocity through its mean and both ends, and ḡ the mean of g − g(0),
//!
//! ```text
//! ∫ m (g − g(0))·v dt = m (ḡ·(x' − x) + h (g' − g)·(v' − v)/12).
//! ```
//!
//! Other external forces do the work `(f + f')·(x' − x)/2`, to second order.
//!
//! Drag takes `∫ c v² dt = c h (v̄² + (v' − v)²/12 + d²/5)` with `v̄ = (x' − x)/h` and `d = (v + v')/2 − v̄`, as a damper does
//! (`force::spring_energies`): the first term is certain, and the others count only where the step resolves the motion of the particle. What drag
//! takes from a prescribed coordinate its constraint replaces: that counts as dissipated and as work. Other work of loads on prescribed coordinates
//! is replaced too, and counts as neither.

use crate::force::{SpringSums, resolved_step};
use crate::system::{State, StateView, System};
use nalgebra::Vector3;

/// Loads and external forces, and what they were at the last state.
pub(super) struct LoadWork<'s> {
    system: &'s System,
    /// External forces other than loads at the last state, and room for those at the next.
    external: Option<[Vec<Vector3<f64>>; 2]>,
    /// The longest step that resolves the motion of each particle, in s; empty without drag.
    resolved: Vec<f64>,
}

impl<'s> LoadWork<'s> {
    pub fn new(system: &'s System, state: &State) -> Self {
        let external = system.external_forces().next().is_some().then(|| {
            let mut force = vec![Vector3::zeros(); system.particles()];
            let room = force.clone();
            set_external(system, &state.moment(), &mut force);
            [force, room]
        });
        let mut resolved: Vec<f64> = Vec::new();
        if system.loads().has_drag() {
            resolved = system.masses().iter().zip(&system.loads().drag).map(|(mass, drag)| mass / drag).collect();
            for (number, ends, _) in system.active() {
                let longest = resolved_step(system, number);
                ends.into_iter().for_each(|p| resolved[p] = resolved[p].min(longest));
            }
        }
        Self { system, external, resolved }
    }

    /// Moves on from a state to another after a step of dt seconds: the work in the step, and the dissipation of drag.
    pub fn enter(&mut self, states: [&State; 2], dt: f64, is_accurate: bool) -> SpringSums {
        let mut sums = self.drag(states, dt, is_accurate);
        sums.work += self.loads(states, dt) + self.external(states);
        sums
    }

    fn free_part(&self, particle: usize, force: &Vector3<f64>) -> Vector3<f64> {
        self.system.dofs().free_axes(particle).project(force)
    }

    fn loads(&self, [before, after]: [&State; 2], dt: f64) -> f64 {
        let (system, loads) = (self.system, self.system.loads());
        let change = loads.gravity.as_ref().map(|gravity| {
            let [start, end] = [before, after].map(|state| gravity.at(state.time) - gravity.at(0.0));
            ((start + end) * 0.5, (end - start) * (dt / 12.0))
        });
        if loads.forces.is_empty() && change.is_none() {
            return 0.0;
        }
        let mut work = 0.0;
        for p in 0..system.own_particles() {
            let moved = self.free_part(p, &(after.positions[p] - before.positions[p]));
            work += loads.forces.get(p).map_or(0.0, |force| force.dot(&moved));
            if let Some((mean, slope)) = change {
                let gained = self.free_part(p, &(after.velocities[p] - before.velocities[p]));
                work += system.masses()[p] * (mean.dot(&moved) + slope.dot(&gained));
            }
        }
        work
    }

    fn external(&mut self, [before, after]: [&State; 2]) -> f64 {
        let system = self.system;
        let Some([last, next]) = &mut self.external else { return 0.0 };
        set_external(system, &after.moment(), next);
        let mut work = 0.0;
        for p in 0..system.own_particles() {
            let moved = after.positions[p] - before.positions[p];
            work += 0.5 * system.dofs().free_axes(p).project(&(next[p] + last[p])).dot(&moved);
        }
        std::mem::swap(last, next);
        work
    }

    /// What drag dissipates, and the work of constraints against it.
    fn drag(&self, [before, after]: [&State; 2], dt: f64, is_accurate: bool) -> SpringSums {
        let mut sums = SpringSums::default();
        if self.resolved.is_empty() {
            return sums;
        }
        for (p, (resolved, drag)) in self.resolved.iter().zip(&self.system.loads().drag).enumerate() {
            if p >= self.system.own_particles() || *drag == 0.0 {
                continue;
            }
            let mean = (after.positions[p] - before.positions[p]) / dt;
            let free = self.free_part(p, &mean);
            let certain = drag * dt * mean.norm_squared();
            sums.certain += certain;
            sums.dissipated += certain;
            sums.work += drag * dt * (mean - free).norm_squared();
            if is_accurate || dt <= *resolved {
                let [start, end] = [before, after].map(|state| self.free_part(p, &state.velocities[p]));
                let (slope, second) = (end - start, (start + end) * 0.5 - free);
                sums.dissipated += drag * dt * (slope.norm_squared() / 12.0 + second.norm_squared() / 5.0);
            }
        }
        sums
    }
}

fn set_external(system: &System, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
    force.fill(Vector3::zeros());
    system.external_forces().for_each(|external| external.add(at, force));
}
