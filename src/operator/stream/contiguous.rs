//! The product of four springs in a row: their ends are twelve numbers in one piece, which become a list of four for every axis and go back.
//!
//! Successive quads often share their first ends, whose rows of w and of the sum then stay in registers. Here `s = B (w_j − w_i)`, which is added to the others and
//! taken from the first.

use super::batch4::{InARow, NO_ROW, SpringBatch4};
use crate::operator::lanes::Lanes;

/// Four first ends that successive quads share.
pub struct Row<L: Lanes> {
    lanes: L,
    /// σ, four times.
    sign: L::Four,
    /// The row that y begins with.
    first: u32,
    /// Their first row.
    row: u32,
    w: [L::Four; 3],
    /// What their springs add.
    sum: [L::Four; 3],
}

impl<L: Lanes> Row<L> {
    /// Without ends; y begins with this row.
    #[inline(always)]
    pub fn new(lanes: L, first: usize, sign: f64) -> Self {
        let nothing = [lanes.four([0.0; 4]); 3];
        // Rows are numbered in 32 bits.
        Self { lanes, sign: lanes.four([sign; 4]), first: first as u32, row: NO_ROW, w: nothing, sum: nothing }
    }

    /// Adds the products of a quad.
    #[inline(always)]
    pub fn add(&mut self, quad: &SpringBatch4<InARow>, w: &[f64], y: &mut [f64]) {
        let lanes = self.lanes;
        let [i, j] = quad.ends.rows;
        if i != self.row {
            let Some(of_first) = twelve(lanes, w, i) else { return };
            self.end(y);
            (self.row, self.w, self.sum) = (i, of_first, [lanes.four([0.0; 4]); 3]);
        }
        // Those that are held do not move.
        let of_others = twelve(lanes, w, j).unwrap_or([lanes.four([0.0; 4]); 3]);
        let d = std::array::from_fn(|piece| lanes.sub(of_others[piece], self.w[piece]));
        let s = lanes.twelve(quad.times(lanes, self.sign, lanes.axes(d)));
        self.sum = std::array::from_fn(|piece| lanes.sub(self.sum[piece], s[piece]));
        if j != NO_ROW {
            add_twelve(lanes, y, j.wrapping_sub(self.first), s);
        }
    }

    /// Adds the sum to its rows.
    #[inline(always)]
    pub fn end(&self, y: &mut [f64]) {
        add_twelve(self.lanes, y, self.row.wrapping_sub(self.first), self.sum);
    }
}

#[inline(always)]
fn twelve<L: Lanes>(lanes: L, v: &[f64], row: u32) -> Option<[L::Four; 3]> {
    let row = row as usize;
    let numbers: &[f64; 12] = v.get(row..row.wrapping_add(12))?.first_chunk()?;
    let [a, b, c, d, e, f, g, h, i, j, k, l] = *numbers;
    Some([lanes.four([a, b, c, d]), lanes.four([e, f, g, h]), lanes.four([i, j, k, l])])
}

/// Adds to twelve rows from `row` on, to those that y holds: some may be another part's.
#[inline(always)]
fn add_twelve<L: Lanes>(lanes: L, y: &mut [f64], row: u32, s: [L::Four; 3]) {
    match twelve(lanes, y, row) {
        Some(old) => {
            let row = row as usize;
            for (n, y) in y[row..row + 12].chunks_exact_mut(4).enumerate() {
                y.copy_from_slice(&lanes.all(lanes.add(old[n], s[n])));
            }
        }
        None => add_some(y, row, s.map(|s| lanes.all(s))),
    }
}

#[cold]
fn add_some(y: &mut [f64], row: u32, s: [[f64; 4]; 3]) {
    for (row, s) in (0..).map(|n| row.wrapping_add(n)).zip(s.as_flattened()) {
        if let Some(y) = y.get_mut(row as usize) {
            *y += s;
        }
    }
}
