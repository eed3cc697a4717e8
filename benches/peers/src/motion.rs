//! A mass–spring system as a first-order system of equations, with its exact Jacobian.

use nalgebra::Vector3;
use sprung::force::{Extensions, add_damping_differential, add_damping_force, add_elastic_force, add_weight};
use sprung::operator::{Combination, LinearOperator, SystemOperator};
use sprung::{State, Stiffness, System};
use std::cell::RefCell;

/// The unknowns y are the free coordinates and their velocities; nothing is allocated where they are evaluated.
pub struct Motion<'s> {
    system: &'s System,
    start: &'s State,
    scratch: RefCell<Scratch<'s>>,
}

struct Scratch<'s> {
    state: State,
    extensions: Extensions,
    force: Vec<Vector3<f64>>,
    full: Vec<Vector3<f64>>,
    reduced: Vec<f64>,
    stiffness: SystemOperator<'s>,
    damping: SystemOperator<'s>,
    /// Where the operators were set up.
    at: (f64, Vec<f64>),
}

impl<'s> Motion<'s> {
    pub fn new(system: &'s System, start: &'s State) -> sprung::Result<Self> {
        let extensions = Extensions::at(system, &start.positions)?;
        let operator = |combination| SystemOperator::new(system, &extensions, Stiffness::Full, combination);
        let scratch = Scratch {
            state: start.clone(),
            force: vec![Vector3::zeros(); system.particles()],
            full: vec![Vector3::zeros(); system.particles()],
            reduced: vec![0.0; system.dofs().len()],
            stiffness: operator(Combination::STIFFNESS),
            damping: operator(Combination::DAMPING),
            at: (f64::NAN, Vec::new()),
            extensions,
        };
        Ok(Self { system, start, scratch: RefCell::new(scratch) })
    }

    /// Number of unknowns.
    pub fn order(&self) -> usize {
        2 * self.system.dofs().len()
    }

    /// y at the start.
    pub fn first(&self) -> Vec<f64> {
        let mut y = vec![0.0; self.order()];
        let (x, v) = y.split_at_mut(self.system.dofs().len());
        self.system.dofs().gather(&self.start.positions, x);
        self.system.dofs().gather(&self.start.velocities, v);
        y
    }

    /// The state that y stands for.
    pub fn state(&self, t: f64, y: &[f64]) -> State {
        let mut state = self.start.clone();
        set(self.system, t, y, &mut state);
        state
    }

    /// `(x, v)' = (v, M⁻¹ f)`.
    pub fn rate(&self, t: f64, y: &[f64], rate: &mut [f64]) {
        let Scratch { state, extensions, force, .. } = &mut *self.scratch.borrow_mut();
        let system = self.system;
        let n = system.dofs().len();
        set(system, t, y, state);
        if extensions.update(system, &state.positions).is_err() {
            return rate.fill(f64::NAN);
        }
        force.fill(Vector3::zeros());
        add_elastic_force(system, extensions, force);
        add_damping_force(system, extensions, &state.velocities, force);
        add_weight(system, force);
        accelerate(system, force);
        rate[..n].copy_from_slice(&y[n..]);
        system.dofs().gather(force, &mut rate[n..]);
    }

    /// `(w_v, M⁻¹ (K w_x + ∂f_d/∂x w_x + G w_v))`.
    pub fn jacobian_product(&self, t: f64, y: &[f64], w: &[f64], out: &mut [f64]) {
        let Scratch { state, extensions, force, full, reduced, stiffness, damping, at } =
            &mut *self.scratch.borrow_mut();
        let system = self.system;
        let n = system.dofs().len();
        set(system, t, y, state);
        if extensions.update(system, &state.positions).is_err() {
            return out.fill(f64::NAN);
        }
        if at.0 != t || at.1 != y {
            stiffness.update(extensions, Stiffness::Full, Combination::STIFFNESS);
            damping.update(extensions, Stiffness::Full, Combination::DAMPING);
            *at = (t, y.to_vec());
        }
        full.fill(Vector3::zeros());
        force.fill(Vector3::zeros());
        system.dofs().scatter(&w[..n], full);
        add_damping_differential(system, extensions, &state.velocities, full, force);
        out[..n].copy_from_slice(&w[n..]);
        system.dofs().gather(force, &mut out[n..]);
        for (operator, w) in [(stiffness, &w[..n]), (damping, &w[n..])] {
            operator.apply(w, reduced);
            out[n..].iter_mut().zip(&*reduced).for_each(|(out, part)| *out += part);
        }
        for (out, dof) in out[n..].iter_mut().zip(system.dofs().iter()) {
            *out /= system.masses()[dof.particle];
        }
    }
}

fn set(system: &System, t: f64, y: &[f64], state: &mut State) {
    let (x, v) = y.split_at(system.dofs().len());
    state.time = t;
    state.prescribe(system);
    system.dofs().scatter(x, &mut state.positions);
    system.dofs().scatter(v, &mut state.velocities);
}

fn accelerate(system: &System, force: &mut [Vector3<f64>]) {
    for (f, mass) in force.iter_mut().zip(system.masses()) {
        *f /= *mass;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sprung::scene::Scene;
    use std::path::Path;

    #[test]
    fn the_jacobian_is_the_derivative_of_the_rate() {
        let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../verification/scenes");
        let (system, start) = Scene::load(scenes.join("tetrahedron.toml")).unwrap().build().unwrap();
        assert!(system.is_damped());
        let motion = Motion::new(&system, &start).unwrap();
        let wave = |seed: f64| (0..motion.order()).map(move |i| (seed * (i + 1) as f64).sin()).collect::<Vec<_>>();
        let mut y = motion.first();
        y.iter_mut().zip(wave(1.7)).for_each(|(y, noise)| *y += 0.1 * noise);
        let w = wave(2.3);
        let rate = |h: f64| {
            let moved: Vec<f64> = y.iter().zip(&w).map(|(y, w)| y + h * w).collect();
            let mut rate = vec![0.0; y.len()];
            motion.rate(0.0, &moved, &mut rate);
            rate
        };
        let h = 1e-5;
        let mut product = vec![0.0; y.len()];
        motion.jacobian_product(0.0, &y, &w, &mut product);
        for ((ahead, behind), product) in rate(h).iter().zip(rate(-h)).zip(product) {
            let difference = (ahead - behind) / (2.0 * h);
            assert!((difference - product).abs() < 1e-6 * (1.0 + product.abs()), "{difference} {product}");
        }
    }
}
