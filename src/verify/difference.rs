//! K, entry by entry, against central differences of the force.

use super::check::{Check, Entry, worst};
use super::claim::Claim;
use super::coloring::ColumnGroups;
use super::entries::{entry_of, for_each_entry};
use super::force_error::{ForceError, Step, curvature, force_rounding, own_error};
use super::reduced::reduce;
use super::verdict::{TABLE_ROWS, WorstEntries, of_block};
use crate::figure::Drawing;
use crate::force::SpringGeometry;
use crate::spring::{Extension, Spring};
use crate::system::{Dof, State, System};
use nalgebra::{Matrix3, Vector3};
use nalgebra_sparse::CscMatrix;

const WHY: &str = "1 is what analysis allows for an entry: truncation k h²/(2(l − h)³) of each spring between the two \
    particles, rounding 15 u k max(1, l/l0) of each force divided by h, h = (rounding/truncation)^(1/3) where both are least";

/// Compares every entry of K with the central difference of `force`, columns that share no row at once.
///
/// `force` is f_el over the free coordinates, in N; `stiffness` is the whole K under test, both triangles, in N/m.
/// Value: the largest error as a multiple of what truncation and rounding allow for its entry. Sees any entry that is
/// wrong by more than about 1e-9 of the stiffest spring at its particles; is blind to smaller faults, to those of weak
/// springs beside springs 10⁹ times stiffer, and to a force law that is wrong in both.
pub fn stiffness_entries(
    system: &System,
    state: &State,
    force: impl FnMut(&[f64], &mut [f64]),
    stiffness: &CscMatrix<f64>,
    scene: &str,
) -> Check {
    let check =
        |value, why: String| Check::new(Claim::Jacobian, "K against central differences", scene, value, 1.0, why);
    let n = system.dofs().len();
    if (stiffness.nrows(), stiffness.ncols()) != (n, n) {
        return check(f64::NAN, format!("K is {} × {}, not {n} × {n}", stiffness.nrows(), stiffness.ncols()));
    }
    let extensions = match SpringGeometry::at(system, &state.positions) {
        Ok(extensions) => extensions,
        Err(degenerate) => return check(f64::NAN, degenerate.to_string()),
    };
    let groups = ColumnGroups::of_system(system);
    let mut differences = Differences {
        dofs: system.dofs().iter().collect(),
        error: ForceError::new(system, &extensions),
        x: reduce(system, &state.positions),
        forward: vec![0.0; n],
        backward: vec![0.0; n],
        force,
    };
    let mut entries = WorstEntries::new(TABLE_ROWS);
    for group in groups.groups() {
        let steps = differences.measure(group);
        for (&column, &step) in group.iter().zip(&steps) {
            differences.compare_column(column, step, groups.rows(column), stiffness, &mut entries);
        }
    }
    let why =
        format!("{WHY}; {} entries with {} pairs of force evaluations", entries.compared(), groups.groups().len());
    let value = entries.worst();
    let table = entries.into_table(|entry| differences.explain(system, stiffness, entry));
    let check = check(value, why).with_table(table);
    if check.passed() { check } else { with_wrong_springs(check, system, state) }
}

/// Adds the scene with the springs that the table names.
pub(super) fn with_wrong_springs(check: Check, system: &System, state: &State) -> Check {
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

/// A force with the analysis of its errors, and the last two evaluations.
struct Differences<'a, F> {
    dofs: Vec<Dof>,
    error: ForceError<'a>,
    x: Vec<f64>,
    forward: Vec<f64>,
    backward: Vec<f64>,
    force: F,
}

impl<F: FnMut(&[f64], &mut [f64])> Differences<'_, F> {
    /// Evaluates the force before and behind x along a group of columns; returns their steps.
    fn measure(&mut self, group: &[usize]) -> Vec<Step> {
        let at: Vec<f64> = group.iter().map(|&column| self.x[column]).collect();
        let steps: Vec<Step> =
            group.iter().zip(&at).map(|(&column, &x)| self.error.step(self.dofs[column].particle, x)).collect();
        for (&column, step) in group.iter().zip(&steps) {
            self.x[column] = step.forward;
        }
        (self.force)(&self.x, &mut self.forward);
        for (&column, step) in group.iter().zip(&steps) {
            self.x[column] = step.backward;
        }
        (self.force)(&self.x, &mut self.backward);
        for (&column, &x) in group.iter().zip(&at) {
            self.x[column] = x;
        }
        steps
    }

    fn quotient(&self, row: usize, step: Step) -> f64 {
        (self.forward[row] - self.backward[row]) / step.width()
    }

    /// Compares a column over the rows that springs couple to it and over those that only the matrix has.
    fn compare_column(
        &self,
        column: usize,
        step: Step,
        coupled: &[u32],
        stiffness: &CscMatrix<f64>,
        entries: &mut WorstEntries,
    ) {
        let particle = self.dofs[column].particle;
        let mut allowed = (usize::MAX, 0.0);
        for_each_entry(stiffness, column, coupled, |row, value, coupled| {
            if !coupled {
                return entries.compare(row, Some(column), value, 0.0, 0.0);
            }
            let other = self.dofs[row].particle;
            if allowed.0 != other {
                allowed = (other, self.error.allowed(other, particle, step));
            }
            entries.compare(row, Some(column), value, self.quotient(row, step), allowed.1);
        });
    }

    /// Names the spring of a wrong entry, and the term of its block that is wrong.
    fn explain(&mut self, system: &System, stiffness: &CscMatrix<f64>, entry: Entry) -> Entry {
        let Some(column) = entry.column else { return entry };
        let (i, j) = (self.dofs[entry.row].particle, self.dofs[column].particle);
        // Unless exactly one spring is behind the block, no term of a spring can be blamed.
        let mut links = self.error.links_between(i, j);
        let (Some(link), None) = (links.next(), links.next()) else { return entry };
        drop(links);
        let entry = entry.of_spring(link.index);
        let (rows, columns) = (system.dofs().rows(i), system.dofs().rows(j));
        let dimension = system.dimension();
        if rows.len() != dimension || columns.len() != dimension {
            return entry;
        }
        let (mut analytic, mut numeric, mut tolerance) = (Matrix3::zeros(), Matrix3::zeros(), 0.0);
        for (c, column) in columns.enumerate() {
            for step in self.measure(&[column]) {
                for (r, row) in rows.clone().enumerate() {
                    analytic[(r, c)] = entry_of(stiffness, row, column);
                    numeric[(r, c)] = self.quotient(row, step);
                }
                tolerance = worst([tolerance, 4.0 * self.error.allowed(i, j, step)]);
            }
        }
        match of_block(&analytic, &numeric, &link.at.direction, link.spring.rest_length, dimension, tolerance) {
            Some(words) => entry.with_verdict(words),
            None => entry,
        }
    }
}

/// Compares every spring's block `K^s` with central differences of its force alone.
///
/// `block` is the block under test as a function of the spring and its extension, in N/m. Value: the largest error of
/// an entry as a multiple of what is allowed. Sees a wrong block of a weak spring that a stiffer neighbour hides from
/// the whole matrix; is blind to where blocks are put.
pub fn spring_blocks(
    system: &System,
    state: &State,
    block: impl Fn(&Spring, &Extension) -> Matrix3<f64>,
    scene: &str,
) -> Check {
    let why = "1 is what analysis allows for an entry: truncation k h²/(2(l − h)³) and rounding 15 u k max(1, l/l0)/h of \
        the one spring, h where both are least";
    let mut entries = WorstEntries::new(TABLE_ROWS);
    for (index, [i, j], spring) in system.active() {
        let (xi, xj) = (&state.positions[i], &state.positions[j]);
        let analytic = Extension::between(xi, xj).map(|at| block(spring, &at));
        let numeric = Extension::between(xi, xj).map(|at| difference_block(spring, &at, xi, xj));
        let nothing = (Matrix3::repeat(f64::NAN), f64::NAN);
        let (numeric, allowed) = numeric.unwrap_or(nothing);
        let analytic = analytic.unwrap_or(nothing.0);
        for c in 0..system.dimension() {
            for r in 0..system.dimension() {
                entries.compare_spring(index, (r, Some(c)), analytic[(r, c)], numeric[(r, c)], allowed);
            }
        }
    }
    let value = if system.active_springs().is_empty() { 0.0 } else { entries.worst() };
    let table = entries.into_table(|entry| entry);
    Check::new(Claim::Jacobian, "K^s of each spring against central differences", scene, value, 1.0, why)
        .with_table(table)
}

/// `−∂f_i/∂x_i` of one spring by central differences, and how much an entry may be off.
fn difference_block(spring: &Spring, at: &Extension, xi: &Vector3<f64>, xj: &Vector3<f64>) -> (Matrix3<f64>, f64) {
    let rounding = force_rounding(spring, at);
    let mut allowed = 0.0;
    let columns = [0, 1, 2].map(|axis| {
        let step = Step::best(xi[axis], rounding, curvature(spring, at), at.length);
        let force = |x: f64| {
            let mut moved = *xi;
            moved[axis] = x;
            Extension::between(&moved, xj).map_or(Vector3::repeat(f64::NAN), |at| spring.elastic_force(&at))
        };
        allowed = worst([allowed, own_error(spring, at, step) + rounding / (0.5 * step.width())]);
        (force(step.backward) - force(step.forward)) / step.width()
    });
    (Matrix3::from_columns(&columns), allowed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::elastic_force;
    use crate::verify::fixtures::{assert_faults_are_found, bent, wrong_stiffness};

    #[test]
    fn wrong_terms_are_named() {
        let (system, state) = bent();
        let wrong = wrong_stiffness(&system, &state);
        let check = stiffness_entries(&system, &state, elastic_force(&system, &state), &wrong, "chain");
        assert!(!check.passed() && check.drawing.is_some());
        assert_faults_are_found(&check.table);
    }
}
