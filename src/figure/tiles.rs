//! A field of classified cells over two axes.

use super::{Axis, Series};
use serde::Serialize;

/// Cells in columns and rows, each of one class, and curves over them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tiles {
    /// What the field shows, in a few words.
    pub title: String,
    /// What the cells say, in a sentence.
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
