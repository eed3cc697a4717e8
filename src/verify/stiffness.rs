//! K and the blocks of springs, entry by entry, against central differences of the force and against dual numbers.

use super::coloring::ForceAt;
use super::comparison::{check_square, explain_by_spring};
use super::force_error::Step;
use super::free_coordinates::elastic_force;
use super::reference::active_links;
use super::{Check, Claim, ColumnGroups, ForceError, Link, TestCase, WorstEntries, dual, reduce, worst};
use crate::error::Result;
use crate::figure::Drawing;
use crate::spring::{Extension, Spring};
use crate::system::Dof;
use nalgebra::{Matrix3, Vector3};
use nalgebra_sparse::CscMatrix;

/// Compares every entry of K with the central difference of the elastic force, columns that share no row at once.
///
/// `stiffness` is the whole K under test, both triangles, in N/m. Value: the largest error as a multiple of truncation and rounding of its entry.
/// Sees any entry that is wrong by more than about 1e-9 of the stiffest spring at its particles; is blind to smaller faults, to those of weak springs
/// beside springs 10⁹ times stiffer, and to a force law that is wrong in both.
///
/// # Errors
/// Coincident ends of a spring; a matrix of another size.
pub fn stiffness_entries(case: &TestCase, stiffness: &CscMatrix<f64>) -> Result<Check> {
    let TestCase { name, system, state, .. } = case;
    check_square("stiffness", stiffness, system.dofs().len())?;
    let dofs: Vec<Dof> = system.dofs().iter().collect();
    let error = ForceError::new(system, &state.positions)?;
    let mut force = ForceAt { force: elastic_force(system, state), x: reduce(system, &state.positions) };
    let mut differences = |group: &[usize]| force.differences(group, |column, x| error.step(dofs[column].particle, x));
    let groups = ColumnGroups::of_system(system);
    let mut entries = WorstEntries::new();
    let allowed = |row: usize, column: usize, step| error.allowed(dofs[row].particle, dofs[column].particle, step);
    entries.compare_differences(stiffness, &groups, &mut differences, allowed);
    let why = format!(
        "1 is what analysis allows for an entry: truncation k h²/(2(l − h)³) of each spring between the two particles, rounding 15 u k max(1, l/l0) \
         of each force divided by h, h = (rounding/truncation)^(1/3) where both are least; {} entries with {} pairs of force evaluations",
        entries.compared,
        groups.groups().len()
    );
    let check = Check::new(Claim::Jacobian, "K against central differences", name, entries.worst, 1.0, why);
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
    Ok(with_wrong_springs(check.with_table(table), case))
}

/// Compares every entry of the assembled K with the sum of dual-number blocks.
///
/// `stiffness` is the whole K under test for [`Stiffness::Full`](crate::Stiffness::Full), both triangles. Value: the largest error of an entry as a
/// multiple of rounding. Sees missing, extra, doubled and misplaced blocks and any fault above rounding; is blind to a wrong force law.
///
/// # Errors
/// Coincident ends of a spring; a matrix of another size.
pub fn stiffness_against_duals(case: &TestCase, stiffness: &CscMatrix<f64>) -> Result<Check> {
    against_blocks(case, stiffness, "K against dual numbers", dual::stiffness_block)
}

/// Compares `matrix` with the sum of blocks `expected(spring)`: minus on the diagonal, plus off it.
pub(super) fn against_blocks(
    case: &TestCase,
    matrix: &CscMatrix<f64>,
    name: &str,
    expected: impl Fn(&Link) -> Matrix3<f64>,
) -> Result<Check> {
    let system = &case.system;
    check_square("stiffness", matrix, system.dofs().len())?;
    let error = ForceError::new(system, &case.state.positions)?;
    // The block at the rows of one particle and the columns of another, and the allowed error of an entry.
    let block = |row: usize, column: usize| {
        let sign = if row == column { -1.0 } else { 1.0 };
        let (mut sum, mut allowed, mut count) = (Matrix3::zeros(), 0.0, 0.0);
        for link in error.links_between(row, column) {
            sum += expected(link) * sign;
            count += 1.0;
            allowed += 2.0 * link.block_rounding();
        }
        // Each of the sums adds u of the terms so far; a term is below a twelfth of its allowance over u.
        (sum, allowed * (1.0 + count / 12.0))
    };
    let dofs: Vec<Dof> = system.dofs().iter().collect();
    let groups = ColumnGroups::of_system(system);
    let mut entries = WorstEntries::new();
    for column in 0..dofs.len() {
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
    let check = Check::new(Claim::Jacobian, name, &case.name, entries.worst, 1.0, why);
    let modelled = |r, c| r < system.dimension() && c < system.dimension();
    let table = entries.into_table(|entry| {
        explain_by_spring(entry, &error, matrix, |i, j| {
            let (exact, allowed) = block(i, j);
            (Matrix3::from_fn(|r, c| if modelled(r, c) { exact[(r, c)] } else { 0.0 }), 4.0 * allowed)
        })
    });
    Ok(with_wrong_springs(check.with_table(table), case))
}

/// Adds to a failed check the scene with the springs that the table names.
fn with_wrong_springs(check: Check, case: &TestCase) -> Check {
    if check.passed() {
        return check;
    }
    let mut drawing = Drawing::strains("Springs behind the worst entries", &case.system, &case.state);
    for (spring, entry) in check.table.iter().filter_map(|entry| entry.spring.map(|spring| (spring, entry))) {
        drawing = drawing.highlight(spring, format!("spring {spring}: {}", entry.verdict));
    }
    let entries = check.table.iter().filter(|entry| entry.spring.is_some()).count();
    let springs = drawing.segments.iter().filter(|segment| segment.label.is_some()).count();
    let of = |count: usize, one: &str, several: &str| format!("{count} {}", if count == 1 { one } else { several });
    let (entries, springs) = (of(entries, "entry is", "entries are"), of(springs, "spring", "springs"));
    check.with_drawing(drawing.concluding(format!("The worst {entries} of {springs}, with their numbers here.")))
}

/// Compares every spring's block `K^s` with central differences of its force alone, with dual numbers, `K^s = −∂f/∂x`, and with
/// hyper-dual numbers, `K^s = ∂²U/∂x²`.
///
/// `block` is the block under test as a function of the spring and its extension, in N/m. Value: the largest error of
/// an entry as a multiple of truncation and rounding, or of the roundings of both blocks, `2 · 12 u k (1/l0 + 1/l)`. Sees a wrong
/// block of a weak spring that a stiffer neighbour hides from the whole matrix, and every fault above rounding, such as a 32-bit k;
/// is blind to the places of blocks, and to a force law that is wrong here and there alike.
pub fn spring_blocks(case: &TestCase, block: impl Fn(&Spring, &Extension) -> Matrix3<f64>) -> [Check; 3] {
    let TestCase { name: scene, system, state, .. } = case;
    let links = active_links(system, &state.positions);
    let compare = |name: &str, why: &str, expected: &dyn Fn(&Link) -> (Matrix3<f64>, f64)| {
        let mut entries = WorstEntries::new();
        for link in &links {
            let [xi, xj] = link.ends.map(|end| state.positions[end]);
            let nan = Matrix3::repeat(f64::NAN);
            let (analytic, (numeric, allowed)) = match Extension::between(&xi, &xj) {
                Some(at) => (block(&system.springs()[link.index], &at), expected(link)),
                None => (nan, (nan, f64::NAN)),
            };
            entries.spring = Some(link.index);
            for (c, r) in (0..system.dimension()).flat_map(|c| (0..system.dimension()).map(move |r| (c, r))) {
                entries.compare(r, Some(c), analytic[(r, c)], numeric[(r, c)], allowed);
            }
        }
        let value = if entries.compared == 0 { 0.0 } else { entries.worst };
        Check::new(Claim::Jacobian, name, scene, value, 1.0, why).with_table(entries.into_table(|entry| entry))
    };
    let by_duals =
        "1 is the rounding of both sides, each 12 u k (1/l0 + 1/l): derivatives by dual numbers have no truncation";
    [
        compare(
            "Kˢ of each spring against central differences",
            "1 is what analysis allows for an entry: truncation k h²/(2(l − h)³) and rounding 15 u k max(1, l/l0)/h of \
             the one spring, h where both are least",
            &|link| difference_block(&system.springs()[link.index], link, link.ends.map(|end| state.positions[end])),
        ),
        compare("Kˢ of each spring against dual numbers", by_duals, &|link| {
            (dual::stiffness_block(link), 2.0 * link.block_rounding())
        }),
        compare("Kˢ of each spring against the energy's second derivative", by_duals, &|link| {
            (dual::energy_block(link), 2.0 * link.block_rounding())
        }),
    ]
}

/// `−∂f_i/∂x_i` of one spring by central differences, and the allowed error of an entry.
fn difference_block(spring: &Spring, link: &Link, [xi, xj]: [Vector3<f64>; 2]) -> (Matrix3<f64>, f64) {
    let rounding = link.force_rounding();
    let mut allowed = 0.0;
    let columns = [0, 1, 2].map(|axis| {
        let step = Step::best(xi[axis], rounding, link.curvature(), link.length);
        let force = |x: f64| {
            let mut moved = xi;
            moved[axis] = x;
            Extension::between(&moved, &xj).map_or(Vector3::repeat(f64::NAN), |at| spring.elastic_force(&at))
        };
        allowed = worst([allowed, link.difference_error(step) + rounding / (0.5 * step.width())]);
        (force(step.backward) - force(step.forward)) / step.width()
    });
    (Matrix3::from_columns(&columns), allowed)
}
