//! The coarsest level: a dense Cholesky factorization by faer.

use super::sparse::Rows;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::mat::{MatMut, MatRef};
use faer::{Conj, Par, Spec};

/// A dense Cholesky factor with its memory.
pub(super) struct Dense {
    order: usize,
    /// By columns.
    factor: Vec<f64>,
    solution: Vec<f64>,
    memory: MemBuffer,
}

/// The row of a pivot that is not positive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct BadRow(pub usize);

impl Dense {
    pub fn new(order: usize) -> Self {
        let scratch = llt::factor::cholesky_in_place_scratch::<f64>(order, Par::Seq, Spec::default())
            .or(llt::solve::solve_in_place_scratch::<f64>(order, 1, Par::Seq));
        let memory = MemBuffer::new(scratch);
        Self { order, factor: vec![0.0; order * order], solution: vec![0.0; order], memory }
    }

    /// Factors `factor·A`.
    ///
    /// # Errors
    /// The block row of the first pivot that is not positive, or of an entry that is not finite.
    pub fn update<const N: usize>(&mut self, a: &impl Rows<N>, factor: f64) -> Result<(), BadRow> {
        let order = self.order;
        let matrix = &mut self.factor;
        matrix.fill(0.0);
        for row in 0..a.pattern().rows() {
            a.visit(row, |column, block| {
                for (r, entries) in block.iter().enumerate() {
                    for (c, entry) in entries.iter().enumerate() {
                        matrix[(column * N + c) * order + row * N + r] = factor * entry;
                    }
                }
            });
        }
        if let Some(at) = matrix.iter().position(|entry| !entry.is_finite()) {
            return Err(BadRow(at % order / N));
        }
        let factor = MatMut::from_column_major_slice_mut(&mut self.factor, order, order);
        let stack = MemStack::new(&mut self.memory);
        match llt::factor::cholesky_in_place(factor, Default::default(), Par::Seq, stack, Spec::default()) {
            Ok(_) => Ok(()),
            Err(llt::factor::LltError::NonPositivePivot { index }) => {
                Err(BadRow(index.min(order.saturating_sub(1)) / N))
            }
        }
    }

    /// `x = (factor·A)⁻¹ b`.
    pub fn solve<const N: usize>(&mut self, b: &[[f32; N]], x: &mut [[f32; N]]) {
        let order = self.order;
        for (double, &b) in self.solution.iter_mut().zip(b.as_flattened()) {
            *double = f64::from(b);
        }
        let factor = MatRef::from_column_major_slice(&self.factor, order, order);
        let solution = MatMut::from_column_major_slice_mut(&mut self.solution, order, 1);
        llt::solve::solve_in_place_with_conj(factor, Conj::No, solution, Par::Seq, MemStack::new(&mut self.memory));
        for (x, &double) in x.as_flattened_mut().iter_mut().zip(&self.solution) {
            *x = double as f32;
        }
    }

    /// Bytes held, without faer's scratch.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.factor[..]) + size_of_val(&self.solution[..])
    }
}

impl std::fmt::Debug for Dense {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Dense").field("order", &self.order).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::super::sparse::{BlockMatrix, Pattern};
    use super::*;
    use std::sync::Arc;

    /// The row is told in which an entry is not finite, or a pivot not positive; the rest is solved with.
    #[test]
    fn bad_rows_are_told() {
        let pattern = Pattern::build(5, |row, columns| columns.push(row as u32)).unwrap();
        let with = |row: usize, entry: f64| {
            let mut matrix = BlockMatrix::<2, 2, f64>::zeros(Arc::new(pattern.clone()));
            for (at, block) in matrix.values.iter_mut().enumerate() {
                *block = [[2.0, 0.5], [0.5, if at == row { entry } else { 4.0 }]];
            }
            matrix
        };
        let mut dense = Dense::new(10);
        assert!(format!("{dense:?}").contains("order: 10"));
        for row in 0..5 {
            for entry in [f64::INFINITY, f64::NAN, -1.0] {
                assert_eq!(dense.update(&with(row, entry), 1.0), Err(BadRow(row)), "{entry}");
            }
        }
        // Beside the diagonal the row counts, not the column.
        let pattern =
            Pattern::build(5, |row, columns| columns.extend(if row == 3 { vec![1, 3] } else { vec![row as u32] }));
        let mut matrix = BlockMatrix::<2, 2, f64>::zeros(Arc::new(pattern.unwrap()));
        matrix.values.fill([[2.0, 0.5], [0.5, 4.0]]);
        matrix.values[3][1][0] = f64::INFINITY;
        assert_eq!(dense.update(&matrix, 1.0), Err(BadRow(3)));
        dense.update(&with(3, 1.0), 2.0).unwrap();
        let mut x = [[0.0f32; 2]; 5];
        dense.solve(&[[1.0, 3.0]; 5], &mut x);
        assert!(x.iter().enumerate().all(|(row, x)| {
            let last = if row == 3 { 1.0 } else { 4.0 };
            (4.0 * x[0] + x[1] - 1.0).abs() < 1e-6 && (x[0] + 2.0 * last * x[1] - 3.0).abs() < 1e-6
        }));
    }
}
