//! A mass–spring system as a first-order system of equations, with its exact Jacobian.

use nalgebra::Vector3;
use sprung::force::{SpringGeometry, add_damping_differential, set_total_force};
use sprung::operator::{Combination, LinearOperator, SystemOperator};
use sprung::{State, Stiffness, System};
use std::cell::RefCell;

/// The unknowns y are the free coordinates and their velocities; nothing is allocated where they are evaluated. It holds between two
/// kinks of prescribed paths, where prescribed velocities are constant.
pub struct Motion<'s> {
    system: &'s System,
    /// A time between the kinks.
    middle: f64,
    scratch: RefCell<Scratch>,
    /// Made when it is asked for: explicit methods need none.
    linearised: RefCell<Option<Linearised<'s>>>,
}

struct Scratch {
    state: State,
    force: Vec<Vector3<f64>>,
}

/// The times from one to another that a run is cut at: kinks of prescribed paths, and both ends.
pub fn pieces(system: &System, [start, end]: [f64; 2]) -> Vec<[f64; 2]> {
    let mut pieces = Vec::new();
    let mut from = start;
    while from < end {
        let to = system.prescribed().next_kink(from).map_or(end, |kink| kink.min(end));
        pieces.push([from, to]);
        from = to;
    }
    pieces
}

/// The derivatives of forces.
struct Linearised<'s> {
    extensions: SpringGeometry,
    full: Vec<Vector3<f64>>,
    reduced: Vec<f64>,
    stiffness: SystemOperator<'s>,
    damping: SystemOperator<'s>,
    /// Where they were set up.
    at: (f64, Vec<f64>),
}

impl<'s> Linearised<'s> {
    /// `None` where the ends of a spring coincide.
    fn new(system: &'s System, state: &State) -> Option<Self> {
        let extensions = SpringGeometry::at(system, &state.positions).ok()?;
        let operator = |combination| SystemOperator::new(system, &extensions, Stiffness::Full, combination);
        Some(Self {
            full: vec![Vector3::zeros(); system.particles()],
            reduced: vec![0.0; system.dofs().len()],
            stiffness: operator(Combination::STIFFNESS),
            damping: operator(Combination::DAMPING),
            at: (f64::NAN, Vec::new()),
            extensions,
        })
    }

    /// Sets it up where it is not; `None` where the ends of a spring coincide.
    fn update(&mut self, system: &System, state: &State, t: f64, y: &[f64]) -> Option<()> {
        if self.at.0 != t || self.at.1 != y {
            self.extensions.update(system, &state.positions).ok()?;
            self.stiffness.update(&self.extensions, Stiffness::Full, Combination::STIFFNESS);
            self.damping.update(&self.extensions, Stiffness::Full, Combination::DAMPING);
            self.at.0 = t;
            self.at.1.clear();
            self.at.1.extend_from_slice(y);
        }
        Some(())
    }
}

impl<'s> Motion<'s> {
    /// Of a piece of time without a kink.
    pub fn new(system: &'s System, start: &State, [from, to]: [f64; 2]) -> Self {
        let scratch = Scratch { state: start.clone(), force: vec![Vector3::zeros(); system.particles()] };
        Self { system, middle: 0.5 * (from + to), scratch: RefCell::new(scratch), linearised: RefCell::new(None) }
    }

    /// Number of unknowns.
    pub fn order(&self) -> usize {
        2 * self.system.dofs().len()
    }

    /// Sets the scratch state to the one that y stands for.
    fn set(&self, t: f64, y: &[f64], state: &mut State) {
        set(self.system, t, y, state);
        self.system.prescribed().set_velocities(self.middle, &mut state.velocities);
    }

    /// Whether forces depend on time beside the unknowns.
    pub fn depends_on_time(&self) -> bool {
        self.system.prescribed().moves()
    }

    /// `(x, v)' = (v, M⁻¹ f)`.
    pub fn rate(&self, t: f64, y: &[f64], rate: &mut [f64]) {
        let Scratch { state, force } = &mut *self.scratch.borrow_mut();
        let system = self.system;
        let n = system.dofs().len();
        self.set(t, y, state);
        if set_total_force(system, &state.moment(), force).is_err() {
            return rate.fill(f64::NAN);
        }
        accelerate(system, force);
        rate[..n].copy_from_slice(&y[n..]);
        system.dofs().gather(force, &mut rate[n..]);
    }

    /// `(w_v, M⁻¹ (K w_x + ∂f_d/∂x w_x + G w_v))`.
    pub fn jacobian_product(&self, t: f64, y: &[f64], w: &[f64], out: &mut [f64]) {
        let Scratch { state, force } = &mut *self.scratch.borrow_mut();
        let system = self.system;
        let n = system.dofs().len();
        self.set(t, y, state);
        let linearised = &mut *self.linearised.borrow_mut();
        if linearised.is_none() {
            *linearised = Linearised::new(system, state);
        }
        let Some(linearised) = linearised else { return out.fill(f64::NAN) };
        if linearised.update(system, state, t, y).is_none() {
            return out.fill(f64::NAN);
        }
        let Linearised { extensions, full, reduced, stiffness, damping, .. } = linearised;
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

/// y of a state.
pub fn unknowns(system: &System, state: &State) -> Vec<f64> {
    let n = system.dofs().len();
    let mut y = vec![0.0; 2 * n];
    let (x, v) = y.split_at_mut(n);
    system.dofs().gather(&state.positions, x);
    system.dofs().gather(&state.velocities, v);
    y
}

/// The state that y stands for, of a motion that began at `start`.
pub fn state(system: &System, start: &State, t: f64, y: &[f64]) -> State {
    let mut state = start.clone();
    set(system, t, y, &mut state);
    state
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
        let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../src/verify/scenes");
        let (system, start) = Scene::load(scenes.join("tetrahedron.toml")).unwrap().build().unwrap();
        assert!(system.is_damped());
        let motion = Motion::new(&system, &start, [0.0, 1.0]);
        let wave = |seed: f64| (0..motion.order()).map(move |i| (seed * (i + 1) as f64).sin()).collect::<Vec<_>>();
        let mut y = unknowns(&system, &start);
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
