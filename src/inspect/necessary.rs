//! Springs whose transverse terms every set that is enough must hold, and how many such a set holds at least.
//!
//! Let `A_T` be A without the transverse term of any compressed spring, and `N_s` the columns of spring s, see `smallest_set`. Dropping more
//! never makes A less definite, so a set that leaves s out is enough only if `A_T − N_s N_sᵀ` is positive definite, which is `N_sᵀ A_T⁻¹ N_s < 1`
//! by Schur's complement. For the rows P of the particles around s
//!
//! ```text
//! (A_T⁻¹)_PP ≥ (A_T,PP)⁻¹,        so   N_sᵀ (A_T,PP)⁻¹ N_s ≥ 1   ⇒   s is in every set that is enough:
//! ```
//!
//! what holds those particles fixed that are not in P only makes A stiffer. A few dozen rows tell, no factorization of A is needed.
//!
//! A term of rank r, at most 2 in space and 1 in the plane, is put right by taking back r directions: dropping it makes no more than r
//! negative eigenvalues positive (Weyl). So whoever is to lift N of them takes as many terms as it needs for their ranks to add up to N.

use crate::assembly::SpringPattern;
use crate::operator::SystemOperator;
use nalgebra::{Cholesky, DMatrix};

/// A column of `N_s`: rows and values.
pub(super) type Column = Vec<(usize, f64)>;

/// Rows around a spring that are looked at: a spring's ends alone first, which is often enough, then these.
const ROWS: usize = 36;

/// 1, and what is above rounding for matrices of so few rows.
pub(super) const NECESSARY: f64 = 1.000000001;

/// Finds out which springs are necessary.
pub(super) struct Necessity<'a, 's> {
    /// `A_T`.
    operator: &'a SystemOperator<'s>,
    pattern: &'a SpringPattern,
}

impl<'a, 's> Necessity<'a, 's> {
    /// With A without the transverse terms of compressed springs, on a pattern of every active spring.
    pub fn new(operator: &'a SystemOperator<'s>, pattern: &'a SpringPattern) -> Self {
        Self { operator, pattern }
    }

    /// The largest eigenvalue of `N_sᵀ (A_T,PP)⁻¹ N_s` for the spring between these particles, with these columns: from [`NECESSARY`] on it is in
    /// every set that is enough. Where it is not, a look at more rows might tell that it is after all.
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
                if !patch.contains(&other) && size + rows(other) <= ROWS {
                    size += rows(other);
                    patch.push(other);
                }
            }
        }
        if patch.len() > 2 { self.need_in(&patch, columns) } else { need }
    }

    fn pair(&self, position: usize) -> [usize; 2] {
        let system = self.operator.system();
        system.pair(system.active_springs()[position] as usize)
    }

    fn other(&self, position: usize, end: usize) -> usize {
        let [i, j] = self.pair(position);
        if i == end { j } else { i }
    }

    /// As far as the rows of these particles tell; zero where they cannot.
    fn need_in(&self, patch: &[usize], columns: &[Column]) -> f64 {
        let system = self.operator.system();
        let dofs = system.dofs();
        // Where the rows of each particle begin, and their number at the end.
        let mut starts = vec![0];
        starts.extend(patch.iter().scan(0, |rows, &p| {
            *rows += dofs.rows(p).len();
            Some(*rows)
        }));
        let size = starts[patch.len()];
        let mut matrix = DMatrix::zeros(size, size);
        for (k, &p) in patch.iter().enumerate() {
            let own = self.operator.particle_block(p);
            for (r, a) in dofs.free_axes(p).iter().enumerate() {
                for (c, b) in dofs.free_axes(p).iter().enumerate() {
                    matrix[(starts[k] + r, starts[k] + c)] += own[(a, b)];
                }
            }
            for position in self.pattern.springs_at(p) {
                let block = self.operator.blocks()[position].matrix();
                let other = self.other(position, p);
                let beside = patch.iter().position(|&q| q == other).map(|l| (l, other, -1.0));
                for (l, q, sign) in [Some((k, p, 1.0)), beside].into_iter().flatten() {
                    for (r, a) in dofs.free_axes(p).iter().enumerate() {
                        for (c, b) in dofs.free_axes(q).iter().enumerate() {
                            matrix[(starts[k] + r, starts[l] + c)] += sign * block[(a, b)];
                        }
                    }
                }
            }
        }
        let Some(factored) = Cholesky::new(matrix) else { return 0.0 };
        let place = |row: usize| {
            let k = patch.iter().position(|&p| dofs.rows(p).contains(&row))?;
            Some(starts[k] + row - dofs.rows(patch[k]).start)
        };
        let mut n = DMatrix::zeros(size, columns.len());
        for (c, column) in columns.iter().enumerate() {
            for &(row, value) in column {
                let Some(place) = place(row) else { return 0.0 };
                n[(place, c)] = value;
            }
        }
        let h = n.tr_mul(&factored.solve(&n));
        if h.is_empty() { 0.0 } else { h.symmetric_eigenvalues().max() }
    }
}

/// The fewest of terms with these ranks that lift so many negative eigenvalues.
pub(super) fn fewest(negative: usize, ranks: impl IntoIterator<Item = usize>) -> usize {
    let mut ranks: Vec<usize> = ranks.into_iter().collect();
    ranks.sort_unstable_by(|a, b| b.cmp(a));
    let mut lifted = 0;
    let enough = ranks.iter().position(|rank| {
        lifted += rank;
        lifted >= negative
    });
    // The terms together are enough, so this ends; a count that says otherwise proves nothing.
    if negative == 0 { 0 } else { enough.map_or(ranks.len(), |last| last + 1) }
}

#[cfg(test)]
mod tests {
    use super::{Necessity, fewest};
    use crate::assembly::SpringPattern;
    use crate::force::SpringGeometry;
    use crate::operator::{Combination, SystemOperator};
    use crate::spring::{Spring, Stiffness};
    use crate::system::SystemBuilder;
    use nalgebra::{DMatrix, DVector};

    /// A particle in the middle of fourteen, with springs to all, which have one to a wall each: twelve particles have 36 rows, so those
    /// that are looked at are the two ends of a spring and ten others.
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
        let found = Necessity::new(&operator, &pattern).need([0, 1], std::slice::from_ref(&column));
        // Entries of A by the blocks of its springs, of the middle and eleven others.
        let mut a = DMatrix::zeros(36, 36);
        for (p, mass) in system.masses().iter().enumerate().take(12) {
            (3 * p..3 * p + 3).for_each(|row| a[(row, row)] += mass);
        }
        for ((_, ends, _), block) in system.active().zip(operator.blocks()) {
            for (sign, p, q) in
                [(1.0, ends[0], ends[0]), (1.0, ends[1], ends[1]), (-1.0, ends[0], ends[1]), (-1.0, ends[1], ends[0])]
            {
                if p.max(q) < 12 {
                    let mut part = a.view_mut((3 * p, 3 * q), (3, 3));
                    part += block.matrix() * sign;
                }
            }
        }
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
