//! A second oracle: the force law once more, in scalars that carry their own derivatives.
//!
//! A dual number `a + b ε`, `ε² = 0`, goes through a formula and comes out with the derivative of the result beside it,
//! exact but for rounding: no step h, no truncation. Hyper-dual numbers carry second derivatives. Everything here is
//! written from `f = −k (l/l0 − 1) n` and `U = ½ k (l − l0)²/l0` and shares no line with the formulas of blocks.

use super::assembled::against_blocks;
use super::check::Check;
use super::claim::Claim;
use super::force_error::{U, block_rounding, force_rounding};
use super::verdict::{TABLE_ROWS, WorstEntries};
use crate::spring::{Extension, Spring};
use crate::system::{State, System};
use nalgebra::{Matrix3, Vector3};
use nalgebra_sparse::CscMatrix;
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

/// `−∂f_i/∂x_i` by dual numbers: what `K^s` must be, in N/m.
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
    let column = |axis: usize| {
        let seeded = [0, 1, 2].map(|a| Dual64::new(d[a], if a == axis { 1.0 } else { 0.0 }));
        Vector3::from(force(spring, seeded).map(|f| -f.eps))
    };
    Matrix3::from_columns(&[0, 1, 2].map(column))
}

/// `−∂U/∂x_i` by dual numbers: what the elastic force on end i must be, in N.
pub fn dual_force(spring: &Spring, d: &Vector3<f64>) -> Vector3<f64> {
    let component = |axis: usize| {
        let seeded = [0, 1, 2].map(|a| Dual64::new(d[a], if a == axis { 1.0 } else { 0.0 }));
        -energy(spring, seeded).eps
    };
    Vector3::from([0, 1, 2].map(component))
}

/// `∂²U/∂x_i²` by hyper-dual numbers: once more what `K^s` must be, in N/m.
pub fn hyper_dual_stiffness_block(spring: &Spring, d: &Vector3<f64>) -> Matrix3<f64> {
    let seed = |a: usize, axis: usize| if a == axis { 1.0 } else { 0.0 };
    Matrix3::from_fn(|r, c| {
        energy(spring, [0, 1, 2].map(|a| HyperDual64::new(d[a], seed(a, r), seed(a, c), 0.0))).eps1eps2
    })
}

/// A block as a function of the spring and `d = x_i − x_j`.
type Oracle = fn(&Spring, &Vector3<f64>) -> Matrix3<f64>;

/// Compares a block function with dual numbers, `K^s = −∂f/∂x`, and with hyper-dual numbers, `K^s = ∂²U/∂x²`, for every
/// spring.
///
/// Value: the largest error of an entry as a multiple of `2 · 12 u k (1/l0 + 1/l)`, the roundings of the block and of
/// the oracle. Sees every fault of a block above rounding, such as a 32-bit k; is blind to where blocks are put, and to
/// a force law that is wrong here and there alike.
pub fn blocks_against_duals(
    system: &System,
    state: &State,
    block: impl Fn(&Spring, &Extension) -> Matrix3<f64>,
    scene: &str,
) -> Vec<Check> {
    let oracles: [(&str, Oracle); 2] = [
        ("K^s of each spring against dual numbers", dual_stiffness_block),
        ("K^s of each spring against the energy's second derivative", hyper_dual_stiffness_block),
    ];
    let why =
        "1 is the rounding of both sides, each 12 u k (1/l0 + 1/l): derivatives by dual numbers have no truncation";
    let compare = |oracle: Oracle| {
        let mut entries = WorstEntries::new(TABLE_ROWS);
        for (index, [i, j], spring) in system.active() {
            let d = state.positions[i] - state.positions[j];
            let exact = oracle(spring, &d);
            let at = Extension::between(&state.positions[i], &state.positions[j]);
            let analytic = at.map_or(Matrix3::repeat(f64::NAN), |at| block(spring, &at));
            let allowed = at.map_or(f64::NAN, |at| 2.0 * block_rounding(spring, &at));
            for (r, c) in (0..system.dimension()).flat_map(|c| (0..system.dimension()).map(move |r| (r, c))) {
                entries.compare_spring(index, (r, Some(c)), analytic[(r, c)], exact[(r, c)], allowed);
            }
        }
        entries
    };
    let check = |(name, oracle)| {
        let entries = compare(oracle);
        let value = if system.active_springs().is_empty() { 0.0 } else { entries.worst() };
        Check::new(Claim::Jacobian, name, scene, value, 1.0, why).with_table(entries.into_table(|entry| entry))
    };
    oracles.map(check).into()
}

/// Compares every entry of the assembled K with the sum of dual-number blocks.
///
/// `stiffness` is the whole K under test for [`Stiffness::Full`](crate::Stiffness::Full), both triangles. Value: the
/// largest error of an entry as a multiple of rounding. Sees missing, extra, doubled and misplaced blocks and any fault
/// above rounding; is blind to a wrong force law.
pub fn stiffness_against_duals(system: &System, state: &State, stiffness: &CscMatrix<f64>, scene: &str) -> Check {
    against_blocks(system, state, stiffness, "K against dual numbers", scene, dual_stiffness_block)
}

/// Compares a force with `−∇U` by dual numbers, component by component.
///
/// `force` is f_el under test over the free coordinates at `state`, in N. Value: the largest error as a multiple of
/// rounding, `2 · 15 u k max(1, l/l0)` for every spring of a particle and u of their sum for each. Sees any force that
/// does not derive from `½ k (l − l0)²/l0`; is blind to forces along prescribed coordinates.
pub fn force_against_energy(system: &System, state: &State, force: &[f64], scene: &str) -> Check {
    let name = "f against −∇U by dual numbers";
    let why =
        "1 is the rounding of both sides: 15 u k max(1, l/l0) for each spring of a particle, and u of the sum for each";
    let check = |value, why: &str| Check::new(Claim::Consistency, name, scene, value, 1.0, why);
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
    let mut entries = WorstEntries::new(TABLE_ROWS);
    for (row, (dof, &f)) in system.dofs().iter().zip(force).enumerate() {
        entries.compare(row, None, f, exact[dof.particle][dof.axis], allowed[dof.particle]);
    }
    check(entries.worst(), why).with_table(entries.into_table(|entry| entry))
}
