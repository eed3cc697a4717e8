//! Forces and energy as functions of the free coordinates, of which derivatives are taken.
//!
//! Where the ends of a spring coincide the force does not exist: all of its components are NaN, and no comparison passes.

use crate::force::{Energy, SpringGeometry, add_damping_force, add_elastic_force};
use crate::system::{State, System};
use nalgebra::Vector3;
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};

/// The free coordinates of full-length vectors.
pub fn reduce(system: &System, full: &[Vector3<f64>]) -> Vec<f64> {
    let mut reduced = vec![0.0; system.dofs().len()];
    system.dofs().gather(full, &mut reduced);
    reduced
}

/// Free coordinates as full-length vectors, zero along all other axes.
pub(super) fn expand(system: &System, reduced: &[f64]) -> Vec<Vector3<f64>> {
    (0..system.particles()).map(|particle| system.dofs().get(reduced, particle)).collect()
}

/// f_el as a function of the free coordinates, in N; prescribed coordinates stay as in `state`.
pub fn elastic_force<'s>(system: &'s System, state: &State) -> impl FnMut(&[f64], &mut [f64]) + use<'s> {
    let mut positions = state.positions.clone();
    let mut force = vec![Vector3::zeros(); system.particles()];
    move |x, f| {
        system.dofs().scatter(x, &mut positions);
        let Ok(geometry) = SpringGeometry::at(system, &positions) else { return f.fill(f64::NAN) };
        force.fill(Vector3::zeros());
        add_elastic_force(system, &geometry, &mut force);
        system.dofs().gather(&force, f);
    }
}

/// f_d at the positions of `state` as a function of the free velocities, in N.
pub fn damping_force<'s>(system: &'s System, state: &State) -> impl FnMut(&[f64], &mut [f64]) + use<'s> {
    let geometry = SpringGeometry::at(system, &state.positions);
    let mut velocities = state.velocities.clone();
    let mut force = vec![Vector3::zeros(); system.particles()];
    move |v, f| {
        let Ok(geometry) = &geometry else { return f.fill(f64::NAN) };
        system.dofs().scatter(v, &mut velocities);
        force.fill(Vector3::zeros());
        add_damping_force(system, geometry, &velocities, &mut force);
        system.dofs().gather(&force, f);
    }
}

/// The elastic energy as a function of the free coordinates, in J.
pub fn elastic_energy<'s>(system: &'s System, state: &State) -> impl FnMut(&[f64]) -> f64 + use<'s> {
    let mut state = state.clone();
    move |x| {
        system.dofs().scatter(x, &mut state.positions);
        Energy::of(system, &state).elastic
    }
}

pub(super) fn moved(x: &[f64], w: &[f64], h: f64) -> Vec<f64> {
    x.iter().zip(w).map(|(x, w)| x + h * w).collect()
}

/// The random vectors that a product or a slope is tried on.
pub(super) const VECTORS: u64 = 4;

/// A vector of numbers between −1 and 1, the same for the same seed on every machine.
pub(super) fn random_vector(length: usize, seed: u64) -> Vec<f64> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    (0..length).map(|_| random.random_range(-1.0..1.0)).collect()
}
