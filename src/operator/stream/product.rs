//! The product of one part: four springs at a time, each added to its ends in the order of the springs.
//!
//! Successive springs often share their first end i, whose rows of w and of the sum then stay in registers. Where four springs in a row share
//! it, only their other ends are looked at one by one. Rows get their first term just before a spring adds to them, while they are in the cache.

use super::{BY_MATRIX, CHUNK, NO_ROW, Part, Quad, Springs};
use crate::operator::lanes::Lanes;
use crate::operator::prefetch;
use std::ops::Range;

/// How many quads ahead of their use memory is asked for: about the delay of main memory. Measured, 64 is the best of
/// 16, 32, 64 and 128, and twice as fast as the processor's own prefetching alone.
const AHEAD: usize = 64;

/// `y = diagonal · w + B w` of a part, in N dimensions; `y` holds the rows of the part.
pub struct Product<'a, L, const N: usize> {
    pub lanes: L,
    pub part: &'a Part,
    pub springs: &'a Springs<'a>,
    pub diagonal: &'a [f64],
    pub w: &'a [f64],
    pub y: &'a mut [f64],
}

impl<L: Lanes, const N: usize> pulp::NullaryFnOnce for Product<'_, L, N> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { lanes, part, springs, diagonal, w, y } = self;
        let Part { rows, quads, reach, .. } = part;
        let (own, diagonal) = (&w[rows.clone()], &diagonal[rows.clone()]);
        // Rows are numbered in 32 bits.
        let first = rows.start as u32;
        let nothing = (lanes.two([0.0; 2]), 0.0);
        let mut run = Run::<L, N> { lanes, first, row: NO_ROW, w: lanes.four([0.0; 4]), sum: nothing };
        let mut begun = 0;
        for (chunk, (of_chunk, &reach)) in quads.chunks(CHUNK).zip(reach).enumerate() {
            begin(begun..reach as usize, diagonal, own, y);
            begun = reach as usize;
            // Behind the last ones there is nothing to ask for; some are asked for again.
            let ahead = (chunk * CHUNK + AHEAD).min(quads.len() - of_chunk.len());
            for (quad, ahead) in of_chunk.iter().zip(&quads[ahead..]) {
                prefetch(&ahead.g[0]);
                prefetch(&ahead.g[2]);
                prefetch(&ahead.ends[0]);
                if lanes.all_equal(&quad.ends[0]) && quad.ends[0][0] != BY_MATRIX {
                    run.add_of_one_end(quad, springs.sign, w, y);
                } else {
                    run.add(quad, springs, w, y);
                }
            }
        }
        begin(begun..y.len(), diagonal, own, y);
        run.end(y);
    }
}

/// Sets some rows to `diagonal · w`.
#[inline(always)]
fn begin(rows: Range<usize>, diagonal: &[f64], w: &[f64], y: &mut [f64]) {
    let terms = diagonal[rows.clone()].iter().zip(&w[rows.clone()]);
    for (y, (m, w)) in y[rows].iter_mut().zip(terms) {
        *y = m * w;
    }
}

/// The end that successive springs share: its first row, its part of w and its sum so far.
struct Run<L: Lanes, const N: usize> {
    lanes: L,
    /// The row that y begins with.
    first: u32,
    row: u32,
    w: L::Four,
    sum: (L::Two, f64),
}

impl<L: Lanes, const N: usize> Run<L, N> {
    /// Adds the products of four springs that share their first end.
    #[inline(always)]
    fn add_of_one_end(&mut self, quad: &Quad, sign: f64, w: &[f64], y: &mut [f64]) {
        let lanes = self.lanes;
        let [[i, ..], to] = &quad.ends;
        if *i != self.row {
            self.turn_to(*i, y);
            self.w = wide::<L, N>(lanes, w, *i);
        }
        let d = to.map(|j| lanes.sub(self.w, wide::<L, N>(lanes, w, j)));
        let s = times(lanes, quad, sign, d);
        for spring in 0..4 {
            self.add_one(s[spring], to[spring], y);
        }
    }

    /// Adds the products of any four springs.
    #[inline(always)]
    fn add(&mut self, quad: &Quad, springs: &Springs, w: &[f64], y: &mut [f64]) {
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
        let s = times(lanes, quad, springs.sign, d);
        for spring in 0..4 {
            let [i, j] = [from[spring], to[spring]];
            if i != self.row {
                self.turn_to(i, y);
                if i == BY_MATRIX {
                    self.row = NO_ROW;
                    springs.add_by_matrix(j as usize, w, self.first as usize, y);
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
    fn end(&self, y: &mut [f64]) {
        if let Some(y) = at_mut::<N>(y, self.row.wrapping_sub(self.first)) {
            put(self.lanes, y, self.sum);
        }
    }
}

/// `B d` of four springs.
#[inline(always)]
fn times<L: Lanes>(lanes: L, quad: &Quad, sign: f64, d: [L::Four; 4]) -> [(L::Two, f64); 4] {
    let d = lanes.lists(d);
    let g = quad.g.map(|g| lanes.four(g));
    let products: [L::Four; 3] = std::array::from_fn(|axis| lanes.mul(g[axis], d[axis]));
    let along = lanes.add(lanes.add(products[0], products[1]), products[2]);
    let along = lanes.mul(lanes.four([sign; 4]), along);
    let transverse = lanes.four(quad.transverse);
    let s = |axis: usize| lanes.add(lanes.mul(transverse, d[axis]), lanes.mul(g[axis], along));
    lanes.vectors(std::array::from_fn(s))
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
