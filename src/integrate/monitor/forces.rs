//! The forces at new states, for what linearising leaves out.

use crate::force::{DegenerateSpring, Extensions, add_all_forces};
use crate::system::{State, System};
use nalgebra::Vector3;

/// Forces at a state.
pub(super) struct Forces {
    extensions: Extensions,
    force: Vec<Vector3<f64>>,
}

impl Forces {
    pub fn new(system: &System, state: &State) -> Result<Self, DegenerateSpring> {
        let extensions = Extensions::at(system, &state.positions)?;
        Ok(Self { extensions, force: vec![Vector3::zeros(); system.particles()] })
    }

    /// `f_el + f_d + g` at a state; nothing where the ends of a spring coincide.
    pub fn at(&mut self, system: &System, state: &State) -> Option<&[Vector3<f64>]> {
        let Self { extensions, force } = self;
        extensions.update(system, &state.positions).ok()?;
        force.fill(Vector3::zeros());
        add_all_forces(system, extensions, &state.moment(), force);
        Some(force)
    }
}
