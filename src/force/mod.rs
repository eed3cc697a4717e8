//! Forces, energies and momenta of a system.
//!
//! Forces are full-length vectors, in N, and are *added* to the argument. Springs between two wholly prescribed particles are excluded from forces
//! but included in the elastic energy.

mod batch;
mod energy;
mod geometry;
mod spring_energies;
mod total;

pub use crate::error::DegenerateSpring;
pub use energy::{Energy, Reactions, angular_momentum, linear_momentum};
pub use geometry::{Configuration, SpringGeometry};
pub(crate) use spring_energies::{BLOCK, RateParabola, SpringEnergies, SpringSums, resolved_step};
use total::add_pair_forces;
pub(crate) use total::set_other_forces;
pub use total::set_total_force;

use crate::spring::{Extension, Spring, Stiffness};
use crate::system::{StateView, System};
use nalgebra::Vector3;

/// Adds the elastic force f_el: `−k (l/l0 − 1) n` on end i of every spring and the opposite on end j.
///
/// # Examples
/// ```
/// use nalgebra::Vector3;
/// use sprung::force::{SpringGeometry, add_elastic_force};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// let extensions = SpringGeometry::at(&system, &state.positions)?;
/// let mut force = vec![Vector3::zeros(); system.particles()];
/// add_elastic_force(&system, &extensions, &mut force);
/// // k (1 − l/l0) pushes the free end away.
/// assert_eq!(force[1], Vector3::new(10.0, 0.0, 0.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn add_elastic_force(system: &System, extensions: &SpringGeometry, force: &mut [Vector3<f64>]) {
    add_pair_forces(system, extensions, force, &|spring: &Spring, _: [usize; 2], at: &Extension| {
        Some(spring.elastic_force(at))
    });
}

/// Adds the damping force f_d: `−b n nᵀ (v_i − v_j)` on end i of every damped spring and the opposite on end j.
pub fn add_damping_force(
    system: &System,
    extensions: &SpringGeometry,
    velocities: &[Vector3<f64>],
    force: &mut [Vector3<f64>],
) {
    add_pair_forces(system, extensions, force, &|spring: &Spring, [i, j]: [usize; 2], at: &Extension| {
        (spring.damping > 0.0).then(|| spring.damping_force(at, &(velocities[i] - velocities[j])))
    });
}

/// Adds K δx for a `displacement` δx, in m: `−K^s (δx_i − δx_j)` on end i of every spring, the opposite on end j, and external forces.
pub fn add_elastic_differential(
    system: &System,
    extensions: &SpringGeometry,
    displacement: &[Vector3<f64>],
    force: &mut [Vector3<f64>],
) {
    add_pair_forces(system, extensions, force, &|spring: &Spring, [i, j]: [usize; 2], at: &Extension| {
        let d = displacement[i] - displacement[j];
        Some(-spring.stiffness_block(at, Stiffness::Full).apply(&d))
    });
    for ((force, derivatives), d) in force.iter_mut().zip(extensions.external()).zip(displacement) {
        *force += derivatives.stiffness * d;
    }
}

/// Adds ∂f_d/∂x δx for a `displacement` δx, in m, at fixed velocities. This matrix results from the rotation of springs and is not symmetric.
pub fn add_damping_differential(
    system: &System,
    extensions: &SpringGeometry,
    velocities: &[Vector3<f64>],
    displacement: &[Vector3<f64>],
    force: &mut [Vector3<f64>],
) {
    add_pair_forces(system, extensions, force, &|spring: &Spring, [i, j]: [usize; 2], at: &Extension| {
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

/// Adds external forces minus `D v`, their part that is linear in velocities and enters the matrix.
pub(crate) fn add_undamped_external_forces(
    system: &System,
    extensions: &SpringGeometry,
    at: &StateView<'_>,
    force: &mut [Vector3<f64>],
) {
    add_external_forces(system, at, force);
    for ((force, derivatives), v) in force.iter_mut().zip(extensions.external()).zip(at.velocities) {
        *force -= derivatives.damping * v;
    }
}

/// Adds `G w` of springs and external forces; that of the latter is `D w`, D the symmetric part of their ∂f/∂v.
pub(crate) fn add_damping_product(
    system: &System,
    extensions: &SpringGeometry,
    velocities: &[Vector3<f64>],
    force: &mut [Vector3<f64>],
) {
    add_damping_force(system, extensions, velocities, force);
    for ((force, derivatives), v) in force.iter_mut().zip(extensions.external()).zip(velocities) {
        *force += derivatives.damping * v;
    }
}

/// Adds ∂f/∂t at fixed positions and velocities, in N/s, of gravity, rest lengths and external forces.
pub fn add_force_rate(system: &System, extensions: &SpringGeometry, at: &StateView<'_>, rate: &mut [Vector3<f64>]) {
    system.loads().add_rate(system.masses(), at.time, rate);
    system.external_forces().for_each(|external| external.add_rate(at, rate));
    if system.behaviour().actuation.is_empty() || !system.has_spring_law() {
        return;
    }
    for ((number, [i, j], spring), extension) in extensions.springs(system) {
        // The stiffness of a slack tension-only spring is zero.
        if let Some([factor, slope]) = system.actuation(number, at.time) {
            // T = k (l/l0 − 1) and l0' = l0 s'/s, so T' = −k l/l0 · s'/s.
            let lost = spring.stiffness * extension.length / spring.rest_length * slope / factor;
            let f = extension.direction * lost;
            rate[i] += f;
            rate[j] -= f;
        }
    }
}

/// Adds all external forces, [loads](crate::system::Loads) included.
pub fn add_external_forces(system: &System, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
    system.loads().add(system.masses(), at, force);
    for external in system.external_forces() {
        external.add(at, force);
    }
}

/// Adds all forces, `f_el + f_d + m g + f_ext`, at the positions of `extensions`.
pub fn add_all_forces(system: &System, extensions: &SpringGeometry, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
    add_elastic_force(system, extensions, force);
    add_damping_force(system, extensions, at.velocities, force);
    add_weight(system, force);
    add_external_forces(system, at, force);
}

/// Sets `accelerations`, in m/s², to `M⁻¹ f` for free coordinates and to zero for prescribed ones.
pub fn set_accelerations(
    system: &System,
    extensions: &SpringGeometry,
    at: &StateView<'_>,
    accelerations: &mut [Vector3<f64>],
) {
    accelerations.fill(Vector3::zeros());
    add_all_forces(system, extensions, at, accelerations);
    for (p, (a, mass)) in accelerations.iter_mut().zip(system.masses()).enumerate() {
        *a = system.dofs().free_axes(p).project(&(*a / *mass));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::{SystemBuilder, fixtures::row};

    /// Infinite velocities must not be multiplied by zero.
    #[test]
    fn springs_without_damping_add_nothing() {
        let (system, state) = row(2);
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let fast = [Vector3::zeros(), Vector3::x() * f64::INFINITY];
        let mut force = [Vector3::zeros(); 2];
        add_damping_force(&system, &extensions, &fast, &mut force);
        add_damping_differential(&system, &extensions, &fast, &[Vector3::zeros(), Vector3::x()], &mut force);
        assert_eq!(force, [Vector3::zeros(); 2]);
    }

    /// Two particles at (1, 2, 0) and (1, 5, 0), and a system without particles, whose energies are +0.
    #[test]
    fn energies_and_momenta_are_sums() {
        let mut builder = SystemBuilder::new();
        builder.gravity(0.0, -10.0, 0.0);
        builder.particle([1.0, 2.0, 0.0], 2.0);
        builder.particle([1.0, 5.0, 0.0], 4.0);
        builder.velocities[0] = Vector3::new(3.0, 0.0, 0.0);
        builder.velocities[1] = Vector3::new(0.0, 0.0, 1.0);
        builder.spring(0, 1, Spring { stiffness: 6.0, rest_length: 1.0, damping: 0.0 });
        let (system, mut state) = builder.build().unwrap();
        let energy = Energy::of(&system, &state);
        assert_eq!((energy.kinetic, energy.elastic, energy.gravitational), (11.0, 12.0, 240.0));
        assert_eq!(energy.total(), 263.0);
        assert_eq!(linear_momentum(&system, &state), Vector3::new(6.0, 0.0, 4.0));
        assert_eq!(angular_momentum(&system, &state), Vector3::new(20.0, -4.0, -12.0));
        // A spring with coincident ends.
        state.positions[1] = state.positions[0];
        assert_eq!(Energy::of(&system, &state).elastic, 3.0);
        let (system, state) = SystemBuilder::new().build().unwrap();
        let Energy { kinetic, elastic, gravitational } = Energy::of(&system, &state);
        assert_eq!([kinetic, elastic, gravitational].map(f64::to_bits), [0; 3]);
    }
}
