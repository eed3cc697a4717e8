//! Springs whose transverse terms every sufficient set must hold, and a lower bound for the size of such a set.
//!
//! Let `A_T` be A without the transverse term of any compressed spring, and `N_s` the columns of spring s, see `smallest_set`. Dropping more never
//! makes A less definite, so a set without s is sufficient only if `A_T − N_s N_sᵀ` is positive definite, which is `N_sᵀ A_T⁻¹ N_s < 1` by Schur's
//! complement. For the rows P of the particles around s
//!
//! ```text
//! (A_T⁻¹)_PP ≥ (A_T,PP)⁻¹,        so   N_sᵀ (A_T,PP)⁻¹ N_s ≥ 1   ⇒   s is in every sufficient set:
//! ```
//!
//! holding the particles outside P only makes A stiffer. A few dozen rows tell, without a factorization of A.
//!
//! Dropping a term of rank r, at most 2 in space and 1 in the plane, makes no more than r negative eigenvalues positive (Weyl). So lifting N of them
//! takes as many terms as it needs for their ranks to add up to N.

use crate::assembly::SpringPattern;
use crate::operator::SystemOperator;
use nalgebra::{Cholesky, DMatrix, Matrix3};

/// A column of `N_s`: rows and values.
pub(super) type Column = Vec<(usize, f64)>;

/// 1, and what is above rounding for matrices of so few rows.
pub(super) const NECESSARY: f64 = 1.000000001;

pub(super) struct Necessity<'a, 's> {
    /// `A_T`.
    pub operator: &'a SystemOperator<'s>,
    /// Of every active spring.
    pub pattern: &'a SpringPattern,
}

impl<'a, 's> Necessity<'a, 's> {
    /// The largest eigenvalue of `N_sᵀ (A_T,PP)⁻¹ N_s` for the spring between these particles, with these columns, in 36 rows at most: from
    /// [`NECESSARY`] on it is in every sufficient set.
    pub fn need(&self, [i, j]: [usize; 2], columns: &[Column]) -> f64 {
        let mut patch = vec![i, j];
        let need = self.need_in(&patch, columns);
        if need >= NECESSARY {
            return need;
        }
        let rows = |p: usize| self.operator.system().dofs().rows(p).len();
        let mut size = rows(i) + rows(j);
        for end in [i, j] {
            for other in self.pattern.springs_at(end).map(|position| self.other(position, end)) {
                if !patch.contains(&other) && size + rows(other) <= 36 {
                    size += rows(other);
                    patch.push(other);
                }
            }
        }
        if patch.len() > 2 { self.need_in(&patch, columns) } else { need }
    }

    fn other(&self, position: usize, end: usize) -> usize {
        let system = self.operator.system();
        let [i, j] = system.pair(system.active_springs()[position] as usize);
        if i == end { j } else { i }
    }

    /// The need by the rows of these particles; zero where they do not tell.
    fn need_in(&self, patch: &[usize], columns: &[Column]) -> f64 {
        let dofs = self.operator.system().dofs();
        let mut whole = DMatrix::zeros(3 * patch.len(), 3 * patch.len());
        let mut add = |k: usize, l: usize, block: Matrix3<f64>| {
            let mut part = whole.fixed_view_mut::<3, 3>(3 * k, 3 * l);
            part += block;
        };
        for (k, &p) in patch.iter().enumerate() {
            add(k, k, self.operator.particle_block(p));
            for position in self.pattern.springs_at(p) {
                let block = self.operator.blocks()[position].matrix();
                add(k, k, block);
                if let Some(l) = patch.iter().position(|&q| q == self.other(position, p)) {
                    add(k, l, -block);
                }
            }
        }
        let free =
            |(k, &p): (usize, &usize)| dofs.free_axes(p).iter().map(move |axis| 3 * k + axis).collect::<Vec<_>>();
        let rows: Vec<usize> = patch.iter().enumerate().flat_map(free).collect();
        let Some(factored) = Cholesky::new(whole.select_rows(&rows).select_columns(&rows)) else { return 0.0 };
        let of_system: Vec<usize> = patch.iter().flat_map(|&p| dofs.rows(p)).collect();
        let mut n = DMatrix::zeros(rows.len(), columns.len());
        for (c, column) in columns.iter().enumerate() {
            for &(row, value) in column {
                let Some(place) = of_system.iter().position(|&other| other == row) else { return 0.0 };
                n[(place, c)] = value;
            }
        }
        let h = n.tr_mul(&factored.solve(&n));
        if h.is_empty() { 0.0 } else { h.symmetric_eigenvalues().max() }
    }
}

/// The least number of terms with these ranks that lift so many negative eigenvalues.
pub(super) fn fewest(negative: usize, ranks: impl IntoIterator<Item = usize>) -> usize {
    let mut ranks: Vec<usize> = ranks.into_iter().collect();
    ranks.sort_unstable_by(|a, b| b.cmp(a));
    let mut lifted = 0;
    let enough = ranks.iter().position(|rank| {
        lifted += rank;
        lifted >= negative
    });
    // All terms together are sufficient.
    if negative == 0 { 0 } else { enough.map_or(ranks.len(), |last| last + 1) }
}

#[cfg(test)]
mod tests {
    use super::{Necessity, fewest};
    use crate::assembly::SpringPattern;
    use crate::force::SpringGeometry;
    use crate::integrate::StepMatrices;
    use crate::operator::{Combination, SystemOperator};
    use crate::spring::{Spring, Stiffness};
    use crate::system::SystemBuilder;
    use nalgebra::{DMatrix, DVector};

    /// A particle in the middle of fourteen, with springs to all, which have one to a wall each: twelve particles have 36 rows, so those that are
    /// looked at are the two ends of a spring and ten others.
    #[test]
    fn as_many_neighbours_are_looked_at_as_there_are_rows_for() {
        let at = |k: usize, radius: f64| {
            let (height, angle) = (-0.9 + 0.13 * k as f64, 2.4 * k as f64);
            let around = radius * (1.0 - height * height).sqrt();
            [around * angle.cos(), around * angle.sin(), radius * height]
        };
        let mut builder = SystemBuilder::new();
        let middle = builder.particle([0.0; 3], 1.0);
        let stretched = |stiffness| Spring { stiffness, rest_length: 0.5, damping: 0.0 };
        for k in 0..14 {
            let end = builder.particle(at(k, 1.0), 1.5 + 0.1 * k as f64);
            builder.spring(middle, end, stretched(3.0 + k as f64));
        }
        for k in 0..14 {
            let wall = builder.particle(at(k, 2.0), 1.0);
            builder.hold(wall);
            builder.spring(1 + k, wall, stretched(1.0));
        }
        let (system, state) = builder.build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let operator = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(1.0));
        let pattern = SpringPattern::of_stiffness(&system).unwrap();
        let column = vec![(0, 0.3), (1, -0.2), (2, 0.1), (3, -0.3), (4, 0.2), (5, -0.1)];
        let found = Necessity { operator: &operator, pattern: &pattern }.need([0, 1], std::slice::from_ref(&column));
        // Entries of A, of the middle and eleven others.
        let a = StepMatrices::assemble(&system, &state, Stiffness::Tension, 1.0).unwrap().a;
        let a = DMatrix::from(&a.to_csc()).view((0, 0), (36, 36)).into_owned();
        let mut n = DVector::zeros(36);
        column.iter().for_each(|&(row, value)| n[row] = value);
        let expected = n.dot(&a.cholesky().unwrap().solve(&n));
        assert!((found / expected - 1.0).abs() < 1e-12, "{found} {expected}");
    }

    #[test]
    fn the_largest_ranks_lift_most() {
        assert_eq!(fewest(0, [2, 2]), 0);
        assert_eq!(fewest(5, [1, 2, 2, 1, 2]), 3);
        assert_eq!(fewest(7, [1, 2, 2, 1, 2]), 4);
        assert_eq!(fewest(9, [1, 2, 2, 1, 2]), 5);
    }
}
