//! The product of any four springs, each added to its ends in the order of the springs.
//!
//! Successive springs often share their first end i, whose rows of w and of the sum then stay in registers. Where four springs in a row share
//! it, only their other ends are looked at one by one.

use super::Springs;
use super::batch4::{AnyEnds, BY_MATRIX, NO_ROW, SpringBatch4};
use crate::operator::lanes::Lanes;

/// The end that successive springs share: its first row, its part of w and its sum so far.
pub struct Run<L: Lanes, const N: usize> {
    lanes: L,
    /// The row that y begins with.
    first: u32,
    row: u32,
    w: L::Four,
    sum: (L::Two, f64),
}

impl<L: Lanes, const N: usize> Run<L, N> {
    /// Without an end; y begins with this row.
    #[inline(always)]
    pub fn new(lanes: L, first: usize) -> Self {
        let nothing = (lanes.two([0.0; 2]), 0.0);
        // Rows are numbered in 32 bits.
        Self { lanes, first: first as u32, row: NO_ROW, w: lanes.four([0.0; 4]), sum: nothing }
    }

    /// Adds the products of four springs.
    #[inline(always)]
    pub fn add_four(&mut self, quad: &SpringBatch4<AnyEnds>, springs: &Springs, w: &[f64], y: &mut [f64]) {
        if self.lanes.all_equal(&quad.ends[0]) && quad.ends[0][0] != BY_MATRIX {
            self.add_of_one_end(quad, springs.sign, w, y);
        } else {
            self.add(quad, springs, w, y);
        }
    }

    /// Adds the products of four springs that share their first end.
    #[inline(always)]
    fn add_of_one_end(&mut self, quad: &SpringBatch4<AnyEnds>, sign: f64, w: &[f64], y: &mut [f64]) {
        let lanes = self.lanes;
        let [[i, ..], to] = &quad.ends;
        if *i != self.row {
            self.turn_to(*i, y);
            self.w = wide::<L, N>(lanes, w, *i);
        }
        let d = to.map(|j| lanes.sub(self.w, wide::<L, N>(lanes, w, j)));
        let s = lanes.vectors(quad.times(lanes, lanes.four([sign; 4]), lanes.lists(d)));
        for spring in 0..4 {
            self.add_one(s[spring], to[spring], y);
        }
    }

    /// Adds the products of any four springs.
    #[inline(always)]
    fn add(&mut self, quad: &SpringBatch4<AnyEnds>, springs: &Springs, w: &[f64], y: &mut [f64]) {
        let lanes = self.lanes;
        let [from, to] = &quad.ends;
        let mut row = self.row;
        let d = std::array::from_fn(|spring| {
            if from[spring] != row {
                row = from[spring];
                self.w = wide::<L, N>(lanes, w, row);
            }
            lanes.sub(self.w, wide::<L, N>(lanes, w, to[spring]))
        });
        let s = lanes.vectors(quad.times(lanes, lanes.four([springs.sign; 4]), lanes.lists(d)));
        for spring in 0..4 {
            let [i, j] = [from[spring], to[spring]];
            if i != self.row {
                self.turn_to(i, y);
                if i == BY_MATRIX {
                    self.row = NO_ROW;
                    springs.add_by_matrix(j, w, self.first as usize, y);
                    continue;
                }
            }
            self.add_one(s[spring], j, y);
        }
    }

    /// Adds s to the shared end and takes it from the other.
    #[inline(always)]
    fn add_one(&mut self, s: (L::Two, f64), j: u32, y: &mut [f64]) {
        let lanes = self.lanes;
        self.sum = (lanes.add_two(self.sum.0, s.0), self.sum.1 + s.1);
        if let Some(y) = at_mut::<N>(y, j.wrapping_sub(self.first)) {
            let (xy, z) = sum_at(lanes, y);
            put(lanes, y, (lanes.sub_two(xy, s.0), z - s.1));
        }
    }

    /// Puts the sum back and begins with that of another end.
    #[inline(always)]
    fn turn_to(&mut self, row: u32, y: &mut [f64]) {
        self.end(y);
        let at = row.wrapping_sub(self.first) as usize;
        (self.row, self.sum) = (row, sum_at(self.lanes, y.get(at..at.wrapping_add(N)).unwrap_or_default()));
    }

    /// Puts the sum back, if `y` holds its rows.
    #[inline(always)]
    pub fn end(&self, y: &mut [f64]) {
        if let Some(y) = at_mut::<N>(y, self.row.wrapping_sub(self.first)) {
            put(self.lanes, y, self.sum);
        }
    }
}

/// N numbers from `row` on in the first lanes, anything in the fourth; zeros where there are none.
#[inline(always)]
fn wide<L: Lanes, const N: usize>(lanes: L, v: &[f64], row: u32) -> L::Four {
    let row = row as usize;
    if N < 3 {
        return lanes.four(few::<N>(v, row));
    }
    match v.get(row..row.wrapping_add(4)).and_then(|v| v.first_chunk()) {
        Some(numbers) => lanes.four(*numbers),
        None => lanes.four(last(v, row)),
    }
}

/// As [`wide`], of the last rows, behind which there is nothing.
#[cold]
fn last(v: &[f64], row: usize) -> [f64; 4] {
    few::<3>(v, row)
}

#[inline(always)]
fn few<const N: usize>(v: &[f64], row: usize) -> [f64; 4] {
    let numbers = v.get(row..row.wrapping_add(N)).unwrap_or_default();
    std::array::from_fn(|axis| numbers.get(axis).copied().unwrap_or(0.0))
}

/// As many numbers as there are dimensions, with zeros on the other axes; zeros where there are none.
#[inline(always)]
fn sum_at<L: Lanes>(lanes: L, v: &[f64]) -> (L::Two, f64) {
    match *v {
        [x, y, z] => (lanes.two([x, y]), z),
        [x, y] => (lanes.two([x, y]), 0.0),
        [x] => (lanes.two([x, 0.0]), 0.0),
        _ => (lanes.two([0.0; 2]), 0.0),
    }
}

#[inline(always)]
fn at_mut<const N: usize>(v: &mut [f64], row: u32) -> Option<&mut [f64]> {
    let row = row as usize;
    v.get_mut(row..row.wrapping_add(N))
}

#[inline(always)]
fn put<L: Lanes>(lanes: L, v: &mut [f64], (xy, z): (L::Two, f64)) {
    let [x, y] = lanes.numbers(xy);
    match v {
        [a, b, c] => (*a, *b, *c) = (x, y, z),
        [a, b] => (*a, *b) = (x, y),
        [a] => *a = x,
        _ => {}
    }
}
