//! An assembled matrix, entry by entry, against the sum of expected spring blocks.

use super::check::{Check, Entry};
use super::claim::Claim;
use super::coloring::ColumnGroups;
use super::difference::with_wrong_springs;
use super::entries::{entry_of, for_each_entry};
use super::force_error::{ForceError, block_rounding};
use super::verdict::{TABLE_ROWS, WorstEntries, of_block};
use crate::force::SpringGeometry;
use crate::spring::Spring;
use crate::system::{Dof, State, System};
use nalgebra::{Matrix3, Vector3};
use nalgebra_sparse::CscMatrix;

const WHY: &str =
    "1 is the rounding of both sides: 12 u k (1/l0 + 1/l) each for every spring of the entry, and u of each sum";

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
    if (matrix.nrows(), matrix.ncols()) != (n, n) {
        return check(f64::NAN, format!("the matrix is {} × {}, not {n} × {n}", matrix.nrows(), matrix.ncols()));
    }
    let extensions = match SpringGeometry::at(system, &state.positions) {
        Ok(extensions) => extensions,
        Err(degenerate) => return check(f64::NAN, degenerate.to_string()),
    };
    let sum = BlockSum { state, error: ForceError::new(system, &extensions), expected };
    let dofs: Vec<Dof> = system.dofs().iter().collect();
    let groups = ColumnGroups::of_system(system);
    let mut entries = WorstEntries::new(TABLE_ROWS);
    for column in 0..n {
        let mut current = (usize::MAX, (Matrix3::zeros(), 0.0));
        for_each_entry(matrix, column, groups.rows(column), |row, value, coupled| {
            let particle = dofs[row].particle;
            if current.0 != particle {
                current = (particle, sum.block(particle, dofs[column].particle));
            }
            let (exact, allowed) = current.1;
            let exact = if coupled { exact[(dofs[row].axis, dofs[column].axis)] } else { 0.0 };
            entries.compare(row, Some(column), value, exact, if coupled { allowed } else { 0.0 });
        });
    }
    let (value, why) = (entries.worst(), format!("{WHY}; {} entries", entries.compared()));
    let explain = |entry: Entry| match entry.column {
        Some(column) => sum.explain(system, matrix, [dofs[entry.row], dofs[column]].map(|dof| dof.particle), entry),
        None => entry,
    };
    let check = check(value, why).with_table(entries.into_table(explain));
    if check.passed() { check } else { with_wrong_springs(check, system, state) }
}

struct BlockSum<'a, F> {
    state: &'a State,
    error: ForceError<'a>,
    expected: F,
}

impl<F: Fn(&Spring, &Vector3<f64>) -> Matrix3<f64>> BlockSum<'_, F> {
    /// The block at the rows of one particle and the columns of another, and how much an entry may be off.
    fn block(&self, row: usize, column: usize) -> (Matrix3<f64>, f64) {
        let sign = if row == column { -1.0 } else { 1.0 };
        let (mut sum, mut allowed, mut count) = (Matrix3::zeros(), 0.0, 0.0);
        for link in self.error.links_between(row, column) {
            let [xi, xj] = link.ends.map(|end| self.state.positions[end]);
            sum += (self.expected)(link.spring, &(xi - xj)) * sign;
            count += 1.0;
            allowed += 2.0 * block_rounding(link.spring, link.at);
        }
        // Each of the sums adds u of the terms so far; a term is below a twelfth of its allowance over u.
        (sum, allowed * (1.0 + count / 12.0))
    }

    /// Names the spring of a wrong entry, and the term of its block that is wrong.
    fn explain(&self, system: &System, matrix: &CscMatrix<f64>, [i, j]: [usize; 2], entry: Entry) -> Entry {
        // Unless exactly one spring is behind the block, no term of a spring can be blamed.
        let mut links = self.error.links_between(i, j);
        let (Some(link), None) = (links.next(), links.next()) else { return entry };
        let entry = entry.of_spring(link.index);
        let (rows, columns) = (system.dofs().rows(i), system.dofs().rows(j));
        let dimension = system.dimension();
        if rows.len() != dimension || columns.len() != dimension {
            return entry;
        }
        let (exact, allowed) = self.block(i, j);
        let modelled = |r, c| r < dimension && c < dimension;
        let analytic =
            Matrix3::from_fn(
                |r, c| {
                    if modelled(r, c) { entry_of(matrix, rows.start + r, columns.start + c) } else { 0.0 }
                },
            );
        let exact = Matrix3::from_fn(|r, c| if modelled(r, c) { exact[(r, c)] } else { 0.0 });
        match of_block(&analytic, &exact, &link.at.direction, link.spring.rest_length, dimension, 4.0 * allowed) {
            Some(words) => entry.with_verdict(words),
            None => entry,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Stiffness;
    use crate::verify::fixtures::{assert_faults_are_found, bent, wrong_stiffness};

    /// Against `k/l0 nnᵀ + k (1/l0 − 1/l) (I − nnᵀ)`.
    #[test]
    fn wrong_terms_are_named() {
        let (system, state) = bent();
        let block = |spring: &Spring, d: &Vector3<f64>| {
            let along = d * d.transpose() / d.norm_squared();
            let transverse = spring.stiffness * (1.0 / spring.rest_length - 1.0 / d.norm());
            along * (spring.stiffness / spring.rest_length) + (Matrix3::identity() - along) * transverse
        };
        let right = crate::integrate::StepMatrices::assemble(&system, &state, Stiffness::Full, 1.0).unwrap().k.to_csc();
        assert!(against_blocks(&system, &state, &right, "K", "chain", block).passed());
        let check = against_blocks(&system, &state, &wrong_stiffness(&system, &state), "K", "chain", block);
        assert!(!check.passed() && check.drawing.is_some());
        assert_faults_are_found(&check.table);
    }
}
