//! Groups of columns that one pair of force evaluations measures together.
//!
//! A difference quotient along `e_c` is column c of the Jacobian. Where no two columns of a group have a nonzero entry in the same row, moving all
//! their coordinates at once measures all of them: each row of the difference belongs to one column (Curtis, Powell and Reid 1974). Finding few
//! groups is colouring a graph whose neighbours share a row; the greedy colouring needs one colour more than the most neighbours at worst.

use super::force_error::Step;
use crate::system::{Dof, System};
use nalgebra_sparse::CscMatrix;

/// The rows that may be nonzero in each column, and the columns in groups that share no row.
#[derive(Debug, Clone)]
pub struct ColumnGroups {
    rows: Vec<Vec<u32>>,
    groups: Vec<Vec<usize>>,
}

impl ColumnGroups {
    /// Every column on its own, every entry expected: no trust in any pattern.
    pub fn one_by_one(order: usize) -> Self {
        let rows = vec![(0..order as u32).collect(); order];
        Self { rows, groups: (0..order).map(|column| vec![column]).collect() }
    }

    /// From the particles that springs couple, all axes of a particle alike. The pattern of K, G and A.
    pub fn of_system(system: &System) -> Self {
        let dofs = system.dofs();
        let mut coupled: Vec<Vec<u32>> = (0..system.particles() as u32).map(|particle| vec![particle]).collect();
        for (_, [i, j], _) in system.active() {
            coupled[i].push(j as u32);
            coupled[j].push(i as u32);
        }
        for neighbours in &mut coupled {
            neighbours.sort_unstable();
            neighbours.dedup();
        }
        let rows_of = |particle: &u32| dofs.rows(*particle as usize).map(|row| row as u32);
        let rows = dofs.iter().map(|dof| coupled[dof.particle].iter().flat_map(rows_of).collect()).collect();
        let mut groups = Vec::new();
        for particles in color(&coupled, &coupled) {
            for axis in 0..3 {
                let column = |&particle: &usize| dofs.row(Dof { particle, axis });
                groups.push(particles.iter().filter_map(column).collect());
            }
        }
        groups.retain(|columns: &Vec<usize>| !columns.is_empty());
        Self { rows, groups }
    }

    /// From the stored entries of a square matrix. An entry that only a force has is seen in rows in which no other column of the group stands.
    pub fn of_matrix(matrix: &CscMatrix<f64>) -> Self {
        let rows: Vec<Vec<u32>> =
            matrix.col_iter().map(|column| column.row_indices().iter().map(|&row| row as u32).collect()).collect();
        let mut columns = vec![Vec::new(); matrix.nrows()];
        for (column, rows) in rows.iter().enumerate() {
            rows.iter().for_each(|&row| columns[row as usize].push(column as u32));
        }
        let groups = color(&rows, &columns);
        Self { rows, groups }
    }

    /// Number of columns.
    pub fn order(&self) -> usize {
        self.rows.len()
    }

    /// The groups.
    pub fn groups(&self) -> &[Vec<usize>] {
        &self.groups
    }

    /// The rows in which a column may be nonzero, ascending.
    pub fn rows(&self, column: usize) -> &[u32] {
        &self.rows[column]
    }
}

/// Greedy colouring: no two vertices of a colour are in one list. `lists` has the lists of every vertex, `members` the vertices of every list.
fn color(lists: &[Vec<u32>], members: &[Vec<u32>]) -> Vec<Vec<usize>> {
    let mut colors = vec![usize::MAX; lists.len()];
    let mut groups: Vec<Vec<usize>> = Vec::new();
    // The vertex that last found a colour among its neighbours.
    let mut met_by: Vec<usize> = Vec::new();
    for vertex in 0..lists.len() {
        for &other in lists[vertex].iter().flat_map(|&list| &members[list as usize]) {
            if let Some(met_by) = met_by.get_mut(colors[other as usize]) {
                *met_by = vertex;
            }
        }
        let color = met_by.iter().position(|&met_by| met_by != vertex).unwrap_or(groups.len());
        if color == groups.len() {
            groups.push(Vec::new());
            met_by.push(vertex);
        }
        groups[color].push(vertex);
        colors[vertex] = color;
    }
    groups
}

/// A force at a point, some of whose coordinates are moved.
pub(super) struct ForceAt<F> {
    pub force: F,
    pub x: Vec<f64>,
}

impl<F: FnMut(&[f64], &mut [f64])> ForceAt<F> {
    /// The force with the coordinates of a group moved to `to(place in the group, coordinate)`.
    pub fn moved(&mut self, group: &[usize], to: impl Fn(usize, f64) -> f64) -> Vec<f64> {
        let mut x = self.x.clone();
        group.iter().enumerate().for_each(|(place, &column)| x[column] = to(place, x[column]));
        let mut f = vec![0.0; x.len()];
        (self.force)(&x, &mut f);
        f
    }

    /// The steps of the coordinates of a group, and the changes of the force over them, all moved at once.
    pub fn differences(&mut self, group: &[usize], step: impl Fn(usize, f64) -> Step) -> (Vec<Step>, Vec<f64>) {
        let steps: Vec<Step> = group.iter().map(|&column| step(column, self.x[column])).collect();
        let after = self.moved(group, |place, _| steps[place].forward);
        let before = self.moved(group, |place, _| steps[place].backward);
        let differences = after.iter().zip(&before).map(|(after, before)| after - before).collect();
        (steps, differences)
    }
}

#[cfg(all(test, feature = "scene"))]
mod tests {
    use super::*;
    use crate::integrate::StepMatrices;
    use crate::scene::{Kind, builtin};
    use crate::spring::Stiffness;

    fn assert_no_row_is_shared(groups: &ColumnGroups) {
        let mut seen = vec![0; groups.order()];
        for group in groups.groups() {
            let mut taken = vec![false; groups.order()];
            for &column in group {
                seen[column] += 1;
                for &row in groups.rows(column) {
                    assert!(!std::mem::replace(&mut taken[row as usize], true), "row {row} is taken twice");
                }
            }
        }
        assert!(seen.iter().all(|&times| times == 1), "every column is in one group");
    }

    #[test]
    fn columns_of_a_group_share_no_row() {
        for kind in Kind::ALL {
            let (system, state) = builtin(kind, kind.default_size()).unwrap().build().unwrap();
            let of_system = ColumnGroups::of_system(&system);
            assert_no_row_is_shared(&of_system);
            let k = StepMatrices::assemble(&system, &state, Stiffness::Full, 0.01).unwrap().k.to_csc();
            let of_matrix = ColumnGroups::of_matrix(&k);
            assert_no_row_is_shared(&of_matrix);
            for column in 0..k.ncols() {
                let stored: Vec<u32> = k.col(column).row_indices().iter().map(|&row| row as u32).collect();
                assert_eq!(of_system.rows(column), stored);
                assert_eq!(of_matrix.rows(column), stored);
            }
        }
        assert_no_row_is_shared(&ColumnGroups::one_by_one(5));
        assert_no_row_is_shared(&ColumnGroups::one_by_one(0));
    }

    #[test]
    fn the_number_of_groups_does_not_grow_with_the_scene() {
        let groups = |size| {
            let (system, _) = builtin(Kind::Cloth, size).unwrap().build().unwrap();
            ColumnGroups::of_system(&system).groups().len()
        };
        assert!(groups(30) <= 120);
        assert!(groups(60) <= groups(30) + 12);
    }
}
