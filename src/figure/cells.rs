//! Fields of cells: sparsity patterns, and cells of classes.

use super::{Axis, Series};

/// The nonzero entries of a square matrix, counted in square cells.
#[derive(Debug, Clone, PartialEq)]
pub struct Spy {
    /// The name of the matrix.
    pub title: String,
    /// The conclusion, in a sentence; may be empty.
    pub conclusion: String,
    /// The order of the matrix.
    pub order: usize,
    /// Entries in the lower triangle, the diagonal included.
    pub entries: usize,
    /// Cells along a side.
    pub cells: usize,
    /// Rows and columns in a cell; the last one may have fewer.
    pub rows_per_cell: usize,
    /// Entries in every cell, by rows of cells from above.
    pub counts: Vec<u32>,
}

impl Spy {
    /// From the entries (row, column) of the lower triangle. Matrices of order above 180 are counted in larger cells.
    pub fn lower(title: impl Into<String>, order: usize, entries: impl Iterator<Item = (usize, usize)>) -> Self {
        let rows_per_cell = order.div_ceil(180).max(1);
        let cells = order.div_ceil(rows_per_cell);
        let mut counts = vec![0u32; cells * cells];
        let mut total = 0;
        for (row, column) in entries {
            if let Some(count) = counts.get_mut(row / rows_per_cell * cells + column / rows_per_cell) {
                *count = count.saturating_add(1);
                total += 1;
            }
        }
        Self { title: title.into(), conclusion: String::new(), order, entries: total, cells, rows_per_cell, counts }
    }

    /// The part of the lower triangle that is filled, from 0 to 1.
    pub fn filled(&self) -> f64 {
        let positions = 0.5 * self.order as f64 * (self.order as f64 + 1.0);
        self.entries as f64 / positions.max(1.0)
    }

    /// The part of a cell that is filled, from 0 to 1.
    pub fn share(&self, row: usize, column: usize) -> f64 {
        let count = self.counts.get(row * self.cells + column).copied().unwrap_or(0);
        let side = |cell: usize| self.rows_per_cell.min(self.order - (cell * self.rows_per_cell).min(self.order));
        let area = if row == column { side(row) * (side(row) + 1) / 2 } else { side(row) * side(column) };
        f64::from(count) / area.max(1) as f64
    }
}

/// Cells in columns and rows, each of one class, and curves over them.
#[derive(Debug, Clone, PartialEq)]
pub struct Tiles {
    /// The title, in a few words.
    pub title: String,
    /// The conclusion, in a sentence.
    pub conclusion: String,
    /// The horizontal axis, of the columns.
    pub x: Axis,
    /// The vertical axis, of the rows.
    pub y: Axis,
    /// Centres of the columns, ascending.
    pub columns: Vec<f64>,
    /// Centres of the rows, ascending.
    pub rows: Vec<f64>,
    /// Row by row, an index into `classes`.
    pub cells: Vec<Vec<usize>>,
    /// Names of the classes for the legend; the first is the one in which nothing is wrong.
    pub classes: Vec<String>,
    /// Lines over the cells, for example limits from theory.
    pub curves: Vec<Series>,
}
