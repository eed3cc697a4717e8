//! The force laws once more, in scalars that carry their own derivatives, and the forces held to them.
//!
//! A dual number `a + b ε`, `ε² = 0`, goes through a formula and comes out with the derivative of the result beside it,
//! exact but for rounding: no step h, no truncation. Hyper-dual numbers carry second derivatives.

use super::reference::{self, active_links, sizes};
use super::{Check, Claim, Link, TestCase, U, WorstEntries, random_vector, ratio, worst};
use crate::error::{Result, check_length};
use crate::force::{SpringGeometry, add_damping_differential};
use nalgebra::{Matrix3, Vector3};
use num_dual::{Dual64, DualNum, HyperDual64};

/// `f = −k (l/l0 − 1) d/l` on the first end, or `f = −k d` without a rest length.
fn force<D: DualNum<Primitive = f64> + Copy>(link: &Link, d: [D; 3]) -> [D; 3] {
    let [x, y, z] = d;
    let l = (x * x + y * y + z * z).sqrt();
    d.map(|component| -(l - link.rest_length) * link.axial * component / l)
}

/// `U = ½ k (l − l0)²/l0`, or `U = ½ k l²` without a rest length.
fn energy<D: DualNum<Primitive = f64> + Copy>(link: &Link, [x, y, z]: [D; 3]) -> D {
    let stretch = (x * x + y * y + z * z).sqrt() - link.rest_length;
    stretch * stretch * (0.5 * link.axial)
}

/// `f_d = −b (d·v) d/(d·d)` on the first end.
fn damping_force<D: DualNum<Primitive = f64> + Copy>(link: &Link, [x, y, z]: [D; 3], v: &Vector3<f64>) -> [D; 3] {
    let rate = (x * v.x + y * v.y + z * v.z) / (x * x + y * y + z * z) * -link.damping;
    [x * rate, y * rate, z * rate]
}

fn seeded(d: &Vector3<f64>, axis: usize) -> [Dual64; 3] {
    [0, 1, 2].map(|a| Dual64::new(d[a], if a == axis { 1.0 } else { 0.0 }))
}

/// `−∂f/∂d` by dual numbers: the true `K^s`, in N/m.
pub(super) fn stiffness_block(link: &Link) -> Matrix3<f64> {
    let column = |axis| Vector3::from(force(link, seeded(&link.separation, axis)).map(|f| -f.eps));
    Matrix3::from_columns(&[0, 1, 2].map(column))
}

/// `∂²U/∂d²` by hyper-dual numbers: once more the true `K^s`, in N/m.
pub(super) fn energy_block(link: &Link) -> Matrix3<f64> {
    let seed = |a: usize, axis: usize| if a == axis { 1.0 } else { 0.0 };
    let d = &link.separation;
    Matrix3::from_fn(|r, c| {
        energy(link, [0, 1, 2].map(|a| HyperDual64::new(d[a], seed(a, r), seed(a, c), 0.0))).eps1eps2
    })
}

/// Compares a force with `−∇U` by dual numbers, component by component.
///
/// `force` is f_el under test over the free coordinates, in N. Value: the largest error as a multiple of
/// rounding, `2 · 15 u k max(1, l/l0)` for every spring of a particle and u of their sum for each. Sees any force that
/// does not derive from `½ k (l − l0)²/l0`; is blind to forces along prescribed coordinates.
///
/// # Errors
/// A force of another length.
pub fn force_against_energy(case: &TestCase, force: &[f64]) -> Result<Check> {
    let TestCase { name, system, state, .. } = case;
    check_length("force", force.len(), system.dofs().len())?;
    let links = active_links(system, &state.positions);
    let of_energy =
        |link: &Link| Vector3::from([0, 1, 2].map(|axis| -energy(link, seeded(&link.separation, axis)).eps));
    let exact = reference::sum(&links, system.particles(), of_energy);
    let rounding = |link: &Link| 2.0 * link.force_rounding() + 32.0 * U * of_energy(link).norm();
    let allowed = sizes(&links, system.particles(), rounding);
    let mut entries = WorstEntries::new();
    for (row, (dof, &f)) in system.dofs().iter().zip(force).enumerate() {
        entries.compare(row, None, f, exact[dof.particle][dof.axis], allowed[dof.particle]);
    }
    let why =
        "1 is the rounding of both sides: 15 u k max(1, l/l0) for each spring of a particle, and u of the sum for each";
    let check = Check::new(Claim::Consistency, "f against −∇U by dual numbers", name, entries.worst, 1.0, why);
    Ok(check.with_table(entries.into_table(|entry| entry)))
}

/// Compares [`add_damping_differential`], `δf_d = (∂f_d/∂x) δx` at fixed velocities, with dual numbers, for random velocities and displacements.
pub(super) fn damping_turns(case: &TestCase) -> Result<Check> {
    let TestCase { name, system, state, .. } = case;
    let geometry = SpringGeometry::at(system, &state.positions)?;
    let random = |seed| -> Vec<Vector3<f64>> {
        random_vector(3 * system.particles(), seed).chunks_exact(3).map(Vector3::from_column_slice).collect()
    };
    let (velocities, displacement) = (random(1), random(2));
    let mut change = vec![Vector3::zeros(); system.particles()];
    add_damping_differential(system, &geometry, &velocities, &displacement, &mut change);
    let links = active_links(system, &state.positions);
    let expected = reference::sum(&links, system.particles(), |link| {
        let [v, moved] = [&velocities, &displacement].map(|vectors| link.difference(vectors));
        let dual = [0, 1, 2].map(|axis| Dual64::new(link.separation[axis], moved[axis]));
        Vector3::from(damping_force(link, dual, &v).map(|f| f.eps))
    });
    let units = turning_rounding(&links, &velocities, &displacement);
    let errors = change.iter().zip(&expected).map(|(change, expected): (&Vector3<f64>, _)| (change - expected).amax());
    let value = worst(errors.zip(&units).map(|(error, &unit)| ratio(error, unit)));
    let why = "1 is rounding: 80 u b ‖δv‖‖δx‖/l for every damper of a particle and u of each sum, as dual numbers leave no truncation";
    Ok(Check::new(Claim::Consistency, "change of f_d by turning springs", name, value, 1.0, why))
}

/// `80 u b ‖δv‖‖δx‖/l` of every damper of a particle, and u of each sum.
fn turning_rounding(links: &[Link], velocities: &[Vector3<f64>], moved: &[Vector3<f64>]) -> Vec<f64> {
    let size =
        |link: &Link| link.damping * link.difference(velocities).norm() * link.difference(moved).norm() / link.length;
    let springs = sizes(links, moved.len(), |_| 2.0);
    sizes(links, moved.len(), size)
        .into_iter()
        .zip(springs)
        .map(|(size, springs)| U * (80.0 + springs) * size)
        .collect()
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
        let links = active_links(&system, &state.positions);
        let units = turning_rounding(&links, &across([1.0, -2.0, 0.0]), &across([0.0, 4.0, 5.0]));
        let (first, second) = (0.5 * 3.0 * 4.0 / 3.0, 2.0 * 1.0 / 5.0);
        assert_eq!(units, [U * 82.0 * first, U * 84.0 * (first + second), U * 82.0 * second]);
    }
}
