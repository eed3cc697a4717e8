//! K and the blocks of springs, entry by entry, against central differences of the force and against dual numbers.

use super::check::{Check, Claim, worst};
use super::coloring::{ColumnGroups, evaluate_moved};
use super::comparison::{WorstEntries, explain_by_spring, wrong_size};
use super::dual::{dual_stiffness_block, hyper_dual_stiffness_block};
use super::force_error::{ForceError, Step, block_rounding, curvature, force_rounding, spring_error};
use super::free_coordinates::reduce;
use crate::figure::Drawing;
use crate::force::SpringGeometry;
use crate::spring::{Extension, Spring};
use crate::system::{Dof, State, System};
use nalgebra::{Matrix3, Vector3};
use nalgebra_sparse::CscMatrix;

/// Compares every entry of K with the central difference of `force`, columns that share no row at once.
///
/// `force` is f_el over the free coordinates, in N; `stiffness` is the whole K under test, both triangles, in N/m.
/// Value: the largest error as a multiple of truncation and rounding of its entry. Sees any entry that is wrong by more
/// than about 1e-9 of the stiffest spring at its particles; is blind to smaller faults, to those of weak springs beside
/// springs 10⁹ times stiffer, and to a force law that is wrong in both.
pub fn stiffness_entries(
    system: &System,
    state: &State,
    mut force: impl FnMut(&[f64], &mut [f64]),
    stiffness: &CscMatrix<f64>,
    scene: &str,
) -> Check {
    let check =
        |value, why: String| Check::new(Claim::Jacobian, "K against central differences", scene, value, 1.0, why);
    if let Some(why) = wrong_size("K", stiffness, system.dofs().len()) {
        return check(f64::NAN, why);
    }
    let geometry = match SpringGeometry::at(system, &state.positions) {
        Ok(geometry) => geometry,
        Err(degenerate) => return check(f64::NAN, degenerate.to_string()),
    };
    let dofs: Vec<Dof> = system.dofs().iter().collect();
    let error = ForceError::new(system, &geometry);
    let mut x = reduce(system, &state.positions);
    // The steps of a group of columns, and the differences of the force over them.
    let mut differences = |group: &[usize]| -> (Vec<Step>, Vec<f64>) {
        let steps: Vec<_> = group.iter().map(|&column| error.step(dofs[column].particle, x[column])).collect();
        let after = evaluate_moved(&mut force, &mut x, group, |place, _| steps[place].forward);
        let before = evaluate_moved(&mut force, &mut x, group, |place, _| steps[place].backward);
        (steps, after.iter().zip(&before).map(|(after, before)| after - before).collect())
    };
    let groups = ColumnGroups::of_system(system);
    let mut entries = WorstEntries::new();
    for group in groups.groups() {
        let (steps, differences) = differences(group);
        for (&column, &step) in group.iter().zip(&steps) {
            entries.compare_column(stiffness, column, groups.rows(column), |row| {
                let allowed = error.allowed(dofs[row].particle, dofs[column].particle, step);
                (differences[row] / step.width(), allowed)
            });
        }
    }
    let why = format!(
        "1 is what analysis allows for an entry: truncation k h²/(2(l − h)³) of each spring between the two particles, rounding \
         15 u k max(1, l/l0) of each force divided by h, h = (rounding/truncation)^(1/3) where both are least; {} entries with {} pairs \
         of force evaluations",
        entries.compared,
        groups.groups().len()
    );
    let check = check(entries.worst, why);
    let mut measured_block = |i: usize, j: usize| {
        let (mut block, mut tolerance) = (Matrix3::zeros(), 0.0);
        for (c, column) in system.dofs().rows(j).enumerate() {
            let (steps, differences) = differences(&[column]);
            for (r, row) in system.dofs().rows(i).enumerate() {
                block[(r, c)] = differences[row] / steps[0].width();
            }
            tolerance = worst([tolerance, 4.0 * error.allowed(i, j, steps[0])]);
        }
        (block, tolerance)
    };
    let table = entries.into_table(|entry| explain_by_spring(entry, &error, stiffness, &mut measured_block));
    with_wrong_springs(check.with_table(table), system, state)
}

/// Compares every entry of the assembled K with the sum of dual-number blocks.
///
/// `stiffness` is the whole K under test for [`Stiffness::Full`](crate::Stiffness::Full), both triangles. Value: the
/// largest error of an entry as a multiple of rounding. Sees missing, extra, doubled and misplaced blocks and any fault
/// above rounding; is blind to a wrong force law.
pub fn stiffness_against_duals(system: &System, state: &State, stiffness: &CscMatrix<f64>, scene: &str) -> Check {
    against_blocks(system, state, stiffness, "K against dual numbers", scene, dual_stiffness_block)
}

/// Compares `matrix` with the sum of blocks `expected(spring, x_i − x_j)`: minus on the diagonal, plus off it.
pub(super) fn against_blocks(
    system: &System,
    state: &State,
    matrix: &CscMatrix<f64>,
    name: &str,
    scene: &str,
    expected: impl Fn(&Spring, &Vector3<f64>) -> Matrix3<f64>,
) -> Check {
    let check = |value, why: String| Check::new(Claim::Jacobian, name, scene, value, 1.0, why);
    let n = system.dofs().len();
    if let Some(why) = wrong_size("the matrix", matrix, n) {
        return check(f64::NAN, why);
    }
    let geometry = match SpringGeometry::at(system, &state.positions) {
        Ok(geometry) => geometry,
        Err(degenerate) => return check(f64::NAN, degenerate.to_string()),
    };
    let error = ForceError::new(system, &geometry);
    // The block at the rows of one particle and the columns of another, and the allowed error of an entry.
    let block = |row: usize, column: usize| {
        let sign = if row == column { -1.0 } else { 1.0 };
        let (mut sum, mut allowed, mut count) = (Matrix3::zeros(), 0.0, 0.0);
        for link in error.links_between(row, column) {
            let [xi, xj] = link.ends.map(|end| state.positions[end]);
            sum += expected(link.spring, &(xi - xj)) * sign;
            count += 1.0;
            allowed += 2.0 * block_rounding(link.spring, link.at);
        }
        // Each of the sums adds u of the terms so far; a term is below a twelfth of its allowance over u.
        (sum, allowed * (1.0 + count / 12.0))
    };
    let dofs: Vec<Dof> = system.dofs().iter().collect();
    let groups = ColumnGroups::of_system(system);
    let mut entries = WorstEntries::new();
    for column in 0..n {
        let mut current = (usize::MAX, (Matrix3::zeros(), 0.0));
        entries.compare_column(matrix, column, groups.rows(column), |row| {
            let Dof { particle, axis } = dofs[row];
            if current.0 != particle {
                current = (particle, block(particle, dofs[column].particle));
            }
            let (exact, allowed) = current.1;
            (exact[(axis, dofs[column].axis)], allowed)
        });
    }
    let why = format!(
        "1 is the rounding of both sides: 12 u k (1/l0 + 1/l) each for every spring of the entry, and u of each sum; {} entries",
        entries.compared
    );
    let check = check(entries.worst, why);
    let modelled = |r, c| r < system.dimension() && c < system.dimension();
    let table = entries.into_table(|entry| {
        explain_by_spring(entry, &error, matrix, |i, j| {
            let (exact, allowed) = block(i, j);
            (Matrix3::from_fn(|r, c| if modelled(r, c) { exact[(r, c)] } else { 0.0 }), 4.0 * allowed)
        })
    });
    with_wrong_springs(check.with_table(table), system, state)
}

/// Adds to a failed check the scene with the springs that the table names.
fn with_wrong_springs(check: Check, system: &System, state: &State) -> Check {
    if check.passed() {
        return check;
    }
    let mut drawing = Drawing::strains("Springs behind the worst entries", system, state);
    for (spring, entry) in check.table.iter().filter_map(|entry| entry.spring.map(|spring| (spring, entry))) {
        drawing = drawing.highlight(spring, format!("spring {spring}: {}", entry.verdict));
    }
    let entries = check.table.iter().filter(|entry| entry.spring.is_some()).count();
    let springs = drawing.segments.iter().filter(|segment| segment.label.is_some()).count();
    let of = |count: usize, one: &str, several: &str| format!("{count} {}", if count == 1 { one } else { several });
    let (entries, springs) = (of(entries, "entry is", "entries are"), of(springs, "spring", "springs"));
    check.with_drawing(drawing.concluding(format!("The worst {entries} of {springs}, with their numbers here.")))
}

/// Compares every spring's block `K^s` with central differences of its force alone.
///
/// `block` is the block under test as a function of the spring and its extension, in N/m. Value: the largest error of
/// an entry as a multiple of the allowed one. Sees a wrong block of a weak spring that a stiffer neighbour hides from
/// the whole matrix; is blind to the places of blocks.
pub fn spring_blocks(
    system: &System,
    state: &State,
    block: impl Fn(&Spring, &Extension) -> Matrix3<f64>,
    scene: &str,
) -> Check {
    let why = "1 is what analysis allows for an entry: truncation k h²/(2(l − h)³) and rounding 15 u k max(1, l/l0)/h of \
        the one spring, h where both are least";
    let name = "K^s of each spring against central differences";
    every_block(system, state, block, (name, scene, why), difference_block)
}

/// Compares a block function with dual numbers, `K^s = −∂f/∂x`, and with hyper-dual numbers, `K^s = ∂²U/∂x²`, for every
/// spring.
///
/// Value: the largest error of an entry as a multiple of `2 · 12 u k (1/l0 + 1/l)`, the roundings of the block and of
/// the oracle. Sees every fault of a block above rounding, such as a 32-bit k; is blind to the places of blocks, and to
/// a force law that is wrong here and there alike.
pub fn blocks_against_duals(
    system: &System,
    state: &State,
    block: impl Fn(&Spring, &Extension) -> Matrix3<f64>,
    scene: &str,
) -> Vec<Check> {
    type Oracle = fn(&Spring, &Vector3<f64>) -> Matrix3<f64>;
    let oracles: [(&str, Oracle); 2] = [
        ("K^s of each spring against dual numbers", dual_stiffness_block),
        ("K^s of each spring against the energy's second derivative", hyper_dual_stiffness_block),
    ];
    let why =
        "1 is the rounding of both sides, each 12 u k (1/l0 + 1/l): derivatives by dual numbers have no truncation";
    let check = |(name, oracle): (&str, Oracle)| {
        every_block(system, state, &block, (name, scene, why), |spring, at, [xi, xj]| {
            (oracle(spring, &(xi - xj)), 2.0 * block_rounding(spring, at))
        })
    };
    oracles.map(check).into()
}

/// Compares the blocks of all springs with `expected(spring, extension, ends)`, a block and the allowed error of an entry.
fn every_block(
    system: &System,
    state: &State,
    block: impl Fn(&Spring, &Extension) -> Matrix3<f64>,
    (name, scene, why): (&str, &str, &str),
    expected: impl Fn(&Spring, &Extension, [Vector3<f64>; 2]) -> (Matrix3<f64>, f64),
) -> Check {
    let mut entries = WorstEntries::new();
    for (index, ends, spring) in system.active() {
        let ends = ends.map(|end| state.positions[end]);
        let nan = Matrix3::repeat(f64::NAN);
        let (analytic, (numeric, allowed)) = match Extension::between(&ends[0], &ends[1]) {
            Some(at) => (block(spring, &at), expected(spring, &at, ends)),
            None => (nan, (nan, f64::NAN)),
        };
        entries.compare_blocks(index, system.dimension(), &analytic, &numeric, allowed);
    }
    let value = if entries.compared == 0 { 0.0 } else { entries.worst };
    let table = entries.into_table(|entry| entry);
    Check::new(Claim::Jacobian, name, scene, value, 1.0, why).with_table(table)
}

/// `−∂f_i/∂x_i` of one spring by central differences, and the allowed error of an entry.
fn difference_block(spring: &Spring, at: &Extension, [xi, xj]: [Vector3<f64>; 2]) -> (Matrix3<f64>, f64) {
    let rounding = force_rounding(spring, at);
    let mut allowed = 0.0;
    let columns = [0, 1, 2].map(|axis| {
        let step = Step::best(xi[axis], rounding, curvature(spring, at), at.length);
        let force = |x: f64| {
            let mut moved = xi;
            moved[axis] = x;
            Extension::between(&moved, &xj).map_or(Vector3::repeat(f64::NAN), |at| spring.elastic_force(&at))
        };
        allowed = worst([allowed, spring_error(spring, at, step) + rounding / (0.5 * step.width())]);
        (force(step.backward) - force(step.forward)) / step.width()
    });
    (Matrix3::from_columns(&columns), allowed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::StepMatrices;
    use crate::spring::Stiffness;
    use crate::verify::elastic_force;
    use crate::verify::fixtures::{assert_faults_are_found, bent, wrong_stiffness};

    /// Against central differences, and against `k/l0 nnᵀ + k (1/l0 − 1/l) (I − nnᵀ)`.
    #[test]
    fn wrong_terms_are_named() {
        let (system, state) = bent();
        let block = |spring: &Spring, d: &Vector3<f64>| {
            let along = d * d.transpose() / d.norm_squared();
            let transverse = spring.stiffness * (1.0 / spring.rest_length - 1.0 / d.norm());
            along * (spring.stiffness / spring.rest_length) + (Matrix3::identity() - along) * transverse
        };
        let right = StepMatrices::assemble(&system, &state, Stiffness::Full, 1.0).unwrap().k.to_csc();
        assert!(against_blocks(&system, &state, &right, "K", "chain", block).passed());
        let wrong = wrong_stiffness(&system, &state);
        for check in [
            stiffness_entries(&system, &state, elastic_force(&system, &state), &wrong, "chain"),
            against_blocks(&system, &state, &wrong, "K", "chain", block),
        ] {
            assert!(!check.passed() && check.drawing.is_some());
            assert_faults_are_found(&check.table);
        }
    }
}
