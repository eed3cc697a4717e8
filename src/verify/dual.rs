//! The force laws once more, in scalars that carry their own derivatives, and the forces held to them.
//!
//! A dual number `a + b ε`, `ε² = 0`, goes through a formula and comes out with the derivative of the result beside it,
//! exact but for rounding: no step h, no truncation. Hyper-dual numbers carry second derivatives. Everything here is
//! written from `f = −k (l/l0 − 1) n`, `U = ½ k (l − l0)²/l0` and `f_d = −b (n·v) n`, and shares no line with the formulas of blocks.

use super::check::{Check, Claim, ratio, worst};
use super::comparison::WorstEntries;
use super::force_error::{U, force_rounding};
use super::free_coordinates::random_vector;
use crate::force::{SpringGeometry, add_damping_differential};
use crate::spring::{Extension, Spring};
use crate::system::{State, System};
use nalgebra::{Matrix3, Vector3};
use num_dual::{Dual64, DualNum, HyperDual64};

/// `f = −k (l/l0 − 1) d/l` on end i for `d = x_i − x_j`.
fn force<D: DualNum<Primitive = f64> + Copy>(spring: &Spring, d: [D; 3]) -> [D; 3] {
    let [x, y, z] = d;
    let l = (x * x + y * y + z * z).sqrt();
    d.map(|component| -(l / spring.rest_length - 1.0) * spring.stiffness * component / l)
}

/// `U = ½ k (l − l0)²/l0`.
fn energy<D: DualNum<Primitive = f64> + Copy>(spring: &Spring, [x, y, z]: [D; 3]) -> D {
    let stretch = (x * x + y * y + z * z).sqrt() - spring.rest_length;
    stretch * stretch * (0.5 * spring.stiffness / spring.rest_length)
}

/// `f_d = −b (d·v) d/(d·d)` on end i for `d = x_i − x_j`, `v = v_i − v_j`.
fn damping_force<D: DualNum<Primitive = f64> + Copy>(spring: &Spring, [x, y, z]: [D; 3], v: &Vector3<f64>) -> [D; 3] {
    let rate = (x * v.x + y * v.y + z * v.z) / (x * x + y * y + z * z) * -spring.damping;
    [x * rate, y * rate, z * rate]
}

/// d with a unit dual part along an axis.
fn seeded(d: &Vector3<f64>, axis: usize) -> [Dual64; 3] {
    [0, 1, 2].map(|a| Dual64::new(d[a], if a == axis { 1.0 } else { 0.0 }))
}

/// `−∂f_i/∂x_i` by dual numbers: the true `K^s`, in N/m.
///
/// # Examples
/// ```
/// use nalgebra::Vector3;
/// use sprung::spring::Extension;
/// use sprung::verify::dual_stiffness_block;
/// use sprung::{Spring, Stiffness};
///
/// let spring = Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 };
/// let d = Vector3::new(1.0, 2.0, -0.5);
/// let extension = Extension::between(&d, &Vector3::zeros()).ok_or("coincident ends")?;
/// let formula = spring.stiffness_block(&extension, Stiffness::Full).matrix();
/// assert!((dual_stiffness_block(&spring, &d) - formula).norm() < 1e-13);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn dual_stiffness_block(spring: &Spring, d: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_columns(&[0, 1, 2].map(|axis| Vector3::from(force(spring, seeded(d, axis)).map(|f| -f.eps))))
}

/// `−∂U/∂x_i` by dual numbers: the true elastic force on end i, in N.
pub fn dual_force(spring: &Spring, d: &Vector3<f64>) -> Vector3<f64> {
    Vector3::from([0, 1, 2].map(|axis| -energy(spring, seeded(d, axis)).eps))
}

/// `∂²U/∂x_i²` by hyper-dual numbers: once more the true `K^s`, in N/m.
pub fn hyper_dual_stiffness_block(spring: &Spring, d: &Vector3<f64>) -> Matrix3<f64> {
    let seed = |a: usize, axis: usize| if a == axis { 1.0 } else { 0.0 };
    Matrix3::from_fn(|r, c| {
        energy(spring, [0, 1, 2].map(|a| HyperDual64::new(d[a], seed(a, r), seed(a, c), 0.0))).eps1eps2
    })
}

/// Compares a force with `−∇U` by dual numbers, component by component.
///
/// `force` is f_el under test over the free coordinates at `state`, in N. Value: the largest error as a multiple of
/// rounding, `2 · 15 u k max(1, l/l0)` for every spring of a particle and u of their sum for each. Sees any force that
/// does not derive from `½ k (l − l0)²/l0`; is blind to forces along prescribed coordinates.
pub fn force_against_energy(system: &System, state: &State, force: &[f64], scene: &str) -> Check {
    let why =
        "1 is the rounding of both sides: 15 u k max(1, l/l0) for each spring of a particle, and u of the sum for each";
    let check =
        |value, why: &str| Check::new(Claim::Consistency, "f against −∇U by dual numbers", scene, value, 1.0, why);
    if force.len() != system.dofs().len() {
        return check(f64::NAN, "the force does not have one component for each free coordinate");
    }
    let mut exact = vec![Vector3::<f64>::zeros(); system.particles()];
    let mut allowed = vec![0.0; system.particles()];
    for (_, [i, j], spring) in system.active() {
        let d = state.positions[i] - state.positions[j];
        let f = dual_force(spring, &d);
        exact[i] += f;
        exact[j] -= f;
        let at = Extension { direction: Vector3::zeros(), length: d.norm() };
        for end in [i, j] {
            allowed[end] += 2.0 * force_rounding(spring, &at) + 32.0 * U * f.norm();
        }
    }
    let mut entries = WorstEntries::new();
    for (row, (dof, &f)) in system.dofs().iter().zip(force).enumerate() {
        entries.compare(row, None, f, exact[dof.particle][dof.axis], allowed[dof.particle]);
    }
    check(entries.worst, why).with_table(entries.into_table(|entry| entry))
}

/// Compares [`add_damping_differential`], `δf_d = (∂f_d/∂x) δx` at fixed velocities, with dual numbers, for random
/// velocities and displacements.
///
/// Value: the largest error of a component as a multiple of rounding. Sees every fault of a term above 1e-14 of the
/// dampers at its particle; is blind to a damping law that is wrong here and there alike.
pub fn damping_turns(system: &System, state: &State, scene: &str) -> Check {
    let why = "1 is rounding: 80 u b ‖δv‖‖δx‖/l for every damper of a particle and u of each sum, as dual numbers leave no \
        truncation";
    let check =
        |value, why: &str| Check::new(Claim::Consistency, "change of f_d by turning springs", scene, value, 1.0, why);
    let geometry = match SpringGeometry::at(system, &state.positions) {
        Ok(geometry) => geometry,
        Err(degenerate) => return check(f64::NAN, &degenerate.to_string()),
    };
    let random = |seed| -> Vec<Vector3<f64>> {
        random_vector(3 * system.particles(), seed).chunks_exact(3).map(Vector3::from_column_slice).collect()
    };
    let (velocities, displacement) = (random(1), random(2));
    let zeros = || vec![Vector3::zeros(); system.particles()];
    let (mut change, mut expected) = (zeros(), zeros());
    add_damping_differential(system, &geometry, &velocities, &displacement, &mut change);
    for (_, [i, j], spring) in system.active() {
        let [d, v, moved] = [&state.positions, &velocities, &displacement].map(|vectors| vectors[i] - vectors[j]);
        let dual = [0, 1, 2].map(|axis| Dual64::new(d[axis], moved[axis]));
        let f = Vector3::from(damping_force(spring, dual, &v).map(|f| f.eps));
        expected[i] += f;
        expected[j] -= f;
    }
    let units = turning_rounding(system, state, &velocities, &displacement);
    let errors = change.iter().zip(&expected).map(|(change, expected): (&Vector3<f64>, _)| (change - expected).amax());
    check(worst(errors.zip(&units).map(|(error, &unit)| ratio(error, unit))), why)
}

/// `80 u b ‖δv‖‖δx‖/l` of every damper of a particle, and u of each sum.
fn turning_rounding(system: &System, state: &State, velocities: &[Vector3<f64>], moved: &[Vector3<f64>]) -> Vec<f64> {
    let mut sizes = vec![(0.0, 0.0); system.particles()];
    for (_, [i, j], spring) in system.active() {
        let norm = |vectors: &[Vector3<f64>]| (vectors[i] - vectors[j]).norm();
        for end in [i, j] {
            sizes[end].0 += spring.damping * norm(velocities) * norm(moved) / norm(&state.positions);
            sizes[end].1 += 2.0;
        }
    }
    sizes.into_iter().map(|(size, springs)| U * (80.0 + springs) * size).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::fixtures;

    /// Dampers of 1/2 and 1 N·s/m, 3 and 5 m long, whose ends part at 3 and 2 m/s while they are moved apart by 4 and 1 m.
    #[test]
    fn units_of_rounding_by_hand() {
        let (system, state) = fixtures::line().build().unwrap();
        let across = |y: [f64; 3]| y.map(|y| Vector3::new(0.0, y, 0.0));
        let units = turning_rounding(&system, &state, &across([1.0, -2.0, 0.0]), &across([0.0, 4.0, 5.0]));
        let (first, second) = (0.5 * 3.0 * 4.0 / 3.0, 2.0 * 1.0 / 5.0);
        assert_eq!(units, [U * 82.0 * first, U * 84.0 * (first + second), U * 82.0 * second]);
    }

    /// Both formulas are rounded, in another way: the error is small, and not zero.
    #[test]
    fn a_bent_chain_differs_by_rounding() {
        let case = fixtures::chain(6, 0.1);
        let check = damping_turns(&case.system, &case.state, "chain");
        assert!(check.passed() && check.value > 1e-4, "{:e}", check.value);
    }
}
