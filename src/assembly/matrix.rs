//! A symmetric sparse matrix of particle blocks: values on a [`BlockPattern`].

use super::{BlockPattern, BlockSlot};
use crate::error::{Result, check_length};
use crate::operator::{BlockDiagonal, LinearOperator};
use crate::system::DofMap;
use faer::sparse::SparseColMatRef;
use nalgebra::Matrix3;
use nalgebra_sparse::{CooMatrix, CscMatrix};
use std::sync::Arc;

/// A symmetric sparse matrix over the free degrees of freedom; the lower triangle is stored.
///
/// # Examples
/// ```
/// use sprung::DofMap;
/// use sprung::assembly::{BlockPattern, SymmetricMatrix};
/// use sprung::nalgebra::Matrix3;
/// use std::sync::Arc;
///
/// let pattern = Arc::new(BlockPattern::new(&DofMap::unconstrained(2), [[0, 1]].into_iter())?);
/// let slot = pattern.slot(0, 1).ok_or("no such pair")?;
/// let mut a = SymmetricMatrix::zeros(pattern);
/// a.add_diagonal_block(0, &Matrix3::identity());
/// a.add_block(slot, &Matrix3::from_diagonal_element(-0.5));
/// assert_eq!(a.to_csc().nnz(), 18 + 18); // two diagonal blocks, and the pair's block twice
/// assert_eq!(a.as_faer().nrows(), 6);    // nothing copied: the lower triangle
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct SymmetricMatrix {
    pattern: Arc<BlockPattern>,
    pub(super) values: Vec<f64>,
}

impl SymmetricMatrix {
    /// The zero matrix on a pattern.
    pub fn zeros(pattern: Arc<BlockPattern>) -> Self {
        let values = vec![0.0; pattern.entries()];
        Self { pattern, values }
    }

    /// The pattern.
    pub fn pattern(&self) -> &Arc<BlockPattern> {
        &self.pattern
    }

    /// The map between (particle, axis) and rows.
    pub fn dofs(&self) -> &DofMap {
        self.pattern.dofs()
    }

    /// The stored values, by columns.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Sets all values to zero.
    pub fn set_zero(&mut self) {
        self.values.fill(0.0);
    }

    /// Replaces A by `S A S` with the diagonal S; by Sylvester's law the signs of the eigenvalues stay.
    ///
    /// # Errors
    /// [`Invalid`](crate::error::Invalid) for a diagonal whose length is not the order of A.
    pub fn scale(&mut self, diagonal: &[f64]) -> Result<()> {
        check_length("diagonal", diagonal.len(), self.pattern.order())?;
        self.scale_rows_and_columns(diagonal);
        Ok(())
    }

    /// As [`scale`](Self::scale), for a diagonal of the right length.
    pub(crate) fn scale_rows_and_columns(&mut self, diagonal: &[f64]) {
        let symbolic = self.pattern.symbolic();
        for (column, factor) in diagonal.iter().enumerate() {
            let range = symbolic.col_range(column);
            for (value, &row) in self.values[range.clone()].iter_mut().zip(&symbolic.row_idx()[range]) {
                *value *= factor * diagonal[row as usize];
            }
        }
    }

    pub(crate) fn scaled(&self, factor: f64) -> Self {
        let values = self.values.iter().map(|value| factor * value).collect();
        Self { pattern: self.pattern.clone(), values }
    }

    /// |A|: the sizes of all entries.
    pub(crate) fn absolute(&self) -> Self {
        let values = self.values.iter().map(|value| value.abs()).collect();
        Self { pattern: self.pattern.clone(), values }
    }

    pub(crate) fn plus(mut self, other: &Self) -> Self {
        self.values.iter_mut().zip(&other.values).for_each(|(a, b)| *a += b);
        self
    }

    /// Adds `value` to all diagonal entries.
    pub fn shift(&mut self, value: f64) {
        for particle in 0..self.dofs().particles() {
            self.add_to_diagonal(particle, value);
        }
    }

    /// Adds `factor` times a diagonal as long as the order of A.
    pub(crate) fn add_diagonal(&mut self, factor: f64, diagonal: &[f64]) {
        let firsts = self.pattern.symbolic().col_ptr();
        for (&first, value) in firsts.iter().zip(diagonal) {
            self.values[first as usize] += factor * value;
        }
    }

    /// Adds `value` to the diagonal entries of a particle's free axes.
    #[inline]
    pub fn add_to_diagonal(&mut self, particle: usize, value: f64) {
        for column in 0..self.dofs().rows(particle).len() {
            let first = self.pattern.column(particle, column).start;
            self.values[first] += value;
        }
    }

    /// Adds a symmetric block to (p, p). The lower triangle of `block` is read.
    #[inline]
    pub fn add_diagonal_block(&mut self, particle: usize, block: &Matrix3<f64>) {
        let free = self.pattern.dofs().free_axes(particle);
        for (column, c) in free.iter().enumerate() {
            let first = self.pattern.column(particle, column).start;
            let values = &mut self.values[first..];
            for (value, r) in values.iter_mut().zip(free.iter().skip(column)) {
                *value += block[(r, c)];
            }
        }
    }

    /// Adds a block to the pair of the slot, (i, j) as it was asked for, and its transpose to (j, i).
    #[inline]
    pub fn add_block(&mut self, slot: BlockSlot, block: &Matrix3<f64>) {
        let block = if slot.transposed { &block.transpose() } else { block };
        let dofs = self.pattern.dofs();
        let (row_axes, column_axes) = (dofs.free_axes(slot.row as usize), dofs.free_axes(slot.column as usize));
        let columns = column_axes.count();
        for (column, c) in column_axes.iter().enumerate() {
            let start = self.pattern.column(slot.column as usize, column).start;
            let first = start + (columns - column) + slot.offset as usize;
            for (value, r) in self.values[first..].iter_mut().zip(row_axes.iter()) {
                *value += block[(r, c)];
            }
        }
    }

    /// The stored lower triangle as faer's sparse type, without a copy. Use it with `Side::Lower`; `to_owned` makes faer's owning type of it.
    pub fn as_faer(&self) -> SparseColMatRef<'_, u32, f64> {
        SparseColMatRef::new(self.pattern.symbolic(), &self.values)
    }

    /// The maximum norm `‖A‖ = max_r Σ_c |a_rc|`; `sums` is scratch of length n.
    pub fn norm_inf(&self, sums: &mut [f64]) -> f64 {
        sums.fill(0.0);
        for (row, column, value) in self.iter() {
            sums[row] += value.abs();
            if row != column {
                sums[column] += value.abs();
            }
        }
        sums.iter().fold(0.0, |largest, &sum| if sum <= largest { largest } else { sum })
    }

    /// Entries (row, column, value) of the stored lower triangle, by columns, rows ascending.
    pub fn iter(&self) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        let symbolic = self.pattern.symbolic();
        (0..self.order()).flat_map(move |column| {
            let range = symbolic.col_range(column);
            let rows = &symbolic.row_idx()[range.clone()];
            rows.iter().zip(&self.values[range]).map(move |(&row, &value)| (row as usize, column, value))
        })
    }

    /// The whole matrix, both triangles, as nalgebra-sparse triplets.
    pub fn to_coo(&self) -> CooMatrix<f64> {
        let mut coo = CooMatrix::new(self.order(), self.order());
        for (row, column, value) in self.iter() {
            coo.push(row, column, value);
            if row != column {
                coo.push(column, row, value);
            }
        }
        coo
    }

    /// The whole matrix, both triangles, as nalgebra-sparse compressed columns.
    pub fn to_csc(&self) -> CscMatrix<f64> {
        CscMatrix::from(&self.to_coo())
    }
}

impl From<&SymmetricMatrix> for CscMatrix<f64> {
    fn from(matrix: &SymmetricMatrix) -> Self {
        matrix.to_csc()
    }
}

impl LinearOperator for SymmetricMatrix {
    fn order(&self) -> usize {
        self.pattern.order()
    }

    fn apply(&self, w: &[f64], y: &mut [f64]) {
        if w.len() != self.order() || y.len() != self.order() {
            return y.fill(f64::NAN);
        }
        let symbolic = self.pattern.symbolic();
        y.fill(0.0);
        for column in 0..self.order() {
            let range = symbolic.col_range(column);
            let mut below = 0.0;
            for (&row, &value) in symbolic.row_idx()[range.clone()].iter().zip(&self.values[range]) {
                let row = row as usize;
                y[row] += value * w[column];
                if row != column {
                    below += value * w[row];
                }
            }
            y[column] += below;
        }
    }
}

impl BlockDiagonal for SymmetricMatrix {
    fn diagonal_blocks(&self, blocks: &mut [Matrix3<f64>]) {
        for (particle, block) in blocks.iter_mut().enumerate() {
            *block = Matrix3::zeros();
            let free = self.dofs().free_axes(particle);
            for (column, c) in free.iter().enumerate() {
                let values = &self.values[self.pattern.column(particle, column)];
                for (&value, r) in values.iter().zip(free.iter().skip(column)) {
                    block[(r, c)] = value;
                    block[(c, r)] = value;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{BlockPattern, LinearOperator, SymmetricMatrix};
    use crate::system::DofMap;
    use nalgebra::Matrix3;
    use std::sync::Arc;

    /// Two particles with blocks `[2 −1 0; −1 3 0; 0 0 5]`, `−7 E` and `4 E` (row 2, column 1), E the matrix with a one in its first corner.
    fn matrix() -> SymmetricMatrix {
        let pattern = BlockPattern::new(&DofMap::unconstrained(2), [[1, 0]].into_iter()).unwrap();
        let mut a = SymmetricMatrix::zeros(Arc::new(pattern));
        let corner = |value| Matrix3::new(value, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        a.add_diagonal_block(0, &Matrix3::new(2.0, -1.0, 0.0, -1.0, 3.0, 0.0, 0.0, 0.0, 5.0));
        a.add_diagonal_block(1, &corner(-7.0));
        let slot = a.pattern().slot(1, 0).unwrap();
        a.add_block(slot, &corner(4.0));
        a
    }

    fn entries(a: &SymmetricMatrix) -> Vec<(usize, usize, f64)> {
        a.iter().filter(|(.., value)| *value != 0.0).collect()
    }

    /// Rows of magnitudes 2 + 1 + 4, 1 + 3, 5 and 4 + 7; an entry below the diagonal counts in its row and in its column.
    #[test]
    fn the_norm_is_the_largest_row_of_magnitudes() {
        let mut a = matrix();
        assert_eq!(a.norm_inf(&mut [f64::NAN; 6]), 11.0);
        // Then |−7 + 6| + 4 and 6: the first row is the largest.
        a.add_to_diagonal(1, 6.0);
        assert_eq!(a.norm_inf(&mut [f64::NAN; 6]), 7.0);
        a.add_to_diagonal(1, f64::NAN);
        assert!(a.norm_inf(&mut [0.0; 6]).is_nan());
    }

    #[test]
    fn scaling_is_from_both_sides() {
        let mut a = matrix();
        a.scale(&[2.0, 3.0, 10.0, 0.5, 1.0, 1.0]).unwrap();
        assert_eq!(entries(&a), [(0, 0, 8.0), (1, 0, -6.0), (3, 0, 4.0), (1, 1, 27.0), (2, 2, 500.0), (3, 3, -1.75)]);
        a.set_zero();
        assert_eq!(entries(&a), []);
    }

    /// Vectors that are short, long or empty are errors, and leave nothing that looks like a product.
    #[test]
    fn wrong_lengths_are_refused() {
        let mut a = matrix();
        for length in [0, 5, 7] {
            assert!(a.scale(&vec![1.0; length]).is_err(), "{length}");
            let mut y = [0.0; 6];
            a.apply(&vec![1.0; length], &mut y);
            assert!(y.iter().all(|y| y.is_nan()), "{length}");
        }
    }
}
