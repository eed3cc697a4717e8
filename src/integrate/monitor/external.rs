//! The work of external forces.
//!
//! Over a step from x to x' it is `Σ (f + f')·(x' − x)/2`, right to the second order in the step.

use crate::force::add_external_forces;
use crate::system::{State, System};
use nalgebra::Vector3;

/// External forces and positions at the last state.
pub(super) struct External {
    force: Vec<Vector3<f64>>,
    positions: Vec<Vector3<f64>>,
    scratch: Vec<Vector3<f64>>,
}

impl External {
    /// `None` for a system without external forces.
    pub fn new(system: &System, state: &State) -> Option<Self> {
        system.has_external_forces().then(|| {
            let zeros = || vec![Vector3::zeros(); system.particles()];
            let mut external = Self { force: zeros(), positions: state.positions.clone(), scratch: zeros() };
            add_external_forces(system, &state.moment(), &mut external.force);
            external
        })
    }

    /// Goes on to a state; the work since the last one on coordinates that are free, in J. (What moves a prescribed one does work on
    /// it whatever else pulls there.)
    pub fn pass(&mut self, system: &System, state: &State) -> f64 {
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

#[cfg(test)]
mod tests;
