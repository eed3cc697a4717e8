//! Sums over springs: the forces, energies and momenta of a whole system.
//!
//! Forces are full-length vectors, in N, and are *added* to what the caller passes in. Springs between two wholly
//! prescribed particles are left out of forces (they move nothing) but count in the elastic energy.

mod energy;
mod extensions;
mod pairs;
mod total;

pub use crate::error::DegenerateSpring;
pub use energy::{Energy, angular_momentum, linear_momentum};
pub use extensions::Extensions;
pub use total::set_total_force;

use crate::spring::{Extension, Spring};
use crate::system::{Moment, System};
use nalgebra::Vector3;

/// Adds the elastic force f_el: `−k (l/l0 − 1) n` on end i of every spring and the opposite on end j.
///
/// # Examples
/// ```
/// use nalgebra::Vector3;
/// use sprung::force::{Extensions, add_elastic_force};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// let extensions = Extensions::at(&system, &state.positions)?;
/// let mut force = vec![Vector3::zeros(); system.particles()];
/// add_elastic_force(&system, &extensions, &mut force);
/// // k (1 − l/l0) pushes the free end away; what acts on held particles is a reaction, and counted too.
/// assert_eq!(force[1], Vector3::new(10.0, 0.0, 0.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn add_elastic_force(system: &System, extensions: &Extensions, force: &mut [Vector3<f64>]) {
    pairs::add(system, extensions, force, &|spring: &Spring, _: [usize; 2], at: &Extension| {
        Some(spring.elastic_force(at))
    });
}

/// Adds the damping force f_d: `−b n nᵀ (v_i − v_j)` on end i of every damped spring and the opposite on end j.
pub fn add_damping_force(
    system: &System,
    extensions: &Extensions,
    velocities: &[Vector3<f64>],
    force: &mut [Vector3<f64>],
) {
    pairs::add(system, extensions, force, &|spring: &Spring, [i, j]: [usize; 2], at: &Extension| {
        (spring.damping > 0.0).then(|| spring.damping_force(at, &(velocities[i] - velocities[j])))
    });
}

/// Adds the change of the damping force when all particles move by `displacement`, in m, at fixed velocities: the product
/// with ∂f_d/∂x, which comes from springs that turn and is not symmetric.
pub fn add_damping_differential(
    system: &System,
    extensions: &Extensions,
    velocities: &[Vector3<f64>],
    displacement: &[Vector3<f64>],
    force: &mut [Vector3<f64>],
) {
    pairs::add(system, extensions, force, &|spring: &Spring, [i, j]: [usize; 2], at: &Extension| {
        (spring.damping > 0.0).then(|| {
            let (v, d) = (velocities[i] - velocities[j], displacement[i] - displacement[j]);
            spring.damping_differential(at, &v, &d)
        })
    });
}

/// Adds the weight `m_i · gravity` of every particle.
pub fn add_weight(system: &System, force: &mut [Vector3<f64>]) {
    let gravity = system.gravity();
    for (f, mass) in force.iter_mut().zip(system.masses()) {
        *f += gravity * *mass;
    }
}

/// Adds all external forces of a system.
pub fn add_external_forces(system: &System, at: &Moment<'_>, force: &mut [Vector3<f64>]) {
    for external in system.external_forces() {
        external.add(at, force);
    }
}

#[cfg(test)]
mod tests {
    use super::{Extensions, add_damping_differential, add_damping_force};
    use crate::spring::Spring;
    use crate::system::SystemBuilder;
    use nalgebra::Vector3;

    /// However fast its ends are: no zero is multiplied by what overflows.
    #[test]
    fn springs_without_damping_add_nothing() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.0, 1.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        let (system, state) = builder.build().unwrap();
        let extensions = Extensions::at(&system, &state.positions).unwrap();
        let fast = [Vector3::zeros(), Vector3::new(1.5e308, 1.5e308, 0.0)];
        let mut force = [Vector3::zeros(); 2];
        add_damping_force(&system, &extensions, &fast, &mut force);
        add_damping_differential(&system, &extensions, &fast, &[Vector3::zeros(), Vector3::x()], &mut force);
        assert_eq!(force, [Vector3::zeros(); 2]);
    }
}
