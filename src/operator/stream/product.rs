//! The product of one part of the stream of springs with a vector.
//!
//! Four contiguous springs have the numbers of their ends in two pieces of twelve, which are transposed into a list of four for every axis and back;
//! any four others are gathered end by end. Successive batches often share their first ends, whose rows of w and of the sum then stay in registers.
//! Rows get their first term just before springs add to them, while they are in the cache.

use super::{Batches, Part, Progress, Springs};
use crate::operator::prefetch;
use crate::operator::simd::Simd;
use crate::operator::spring_order::NO_ROW;
use crate::spring::SpringBlock;
use std::ops::Range;

/// Four springs in the form in which a product reads them; missing ones are zeros.
#[derive(Debug, Clone, Copy)]
pub struct SpringBatch4<E> {
    /// g, in √(N/m), by axes.
    pub g: [[f64; 4]; 3],
    /// α, in N/m.
    pub transverse: [f64; 4],
    pub ends: E,
}

/// The ends of contiguous springs.
#[derive(Debug, Clone, Copy)]
pub struct ContiguousEnds {
    /// The first of the twelve rows of the first ends, and of the others; [`NO_ROW`] where the others are held.
    pub rows: [u32; 2],
    /// A bit for every spring that is multiplied by its matrix.
    pub by_matrix: u32,
}

/// First rows of both ends: [`NO_ROW`] for a held one, twice for no spring, [`BY_MATRIX`] and the position for one multiplied by its matrix.
pub type GatheredEnds = [[u32; 4]; 2];

pub const BY_MATRIX: u32 = u32::MAX;

impl<E> SpringBatch4<E> {
    pub fn new(ends: E) -> Self {
        Self { g: [[0.0; 4]; 3], transverse: [0.0; 4], ends }
    }

    pub fn set(&mut self, spring: usize, streamed: Option<Streamed>) {
        let Streamed { g, transverse } = streamed.unwrap_or_default();
        (0..3).for_each(|axis| self.g[axis][spring] = g[axis]);
        self.transverse[spring] = transverse;
    }

    /// `B d = α d + g σ (g·d)` of four springs, axis by axis; `sign` is σ four times.
    #[inline(always)]
    pub fn times<L: Simd>(&self, simd: L, sign: L::Four, d: [L::Four; 3]) -> [L::Four; 3] {
        let g = self.g.map(|g| simd.four(g));
        let products: [L::Four; 3] = std::array::from_fn(|axis| simd.mul(g[axis], d[axis]));
        let along = simd.add(simd.add(products[0], products[1]), products[2]);
        let along = simd.mul(sign, along);
        let transverse = simd.four(self.transverse);
        std::array::from_fn(|axis| simd.add(simd.mul(transverse, d[axis]), simd.mul(g[axis], along)))
    }
}

/// A block in the form in which it is streamed, `α d + σ g (g·d)`.
#[derive(Debug, Clone, Copy, Default)]
pub struct Streamed {
    g: [f64; 3],
    transverse: f64,
}

impl Streamed {
    /// `None` for a block whose product has cancellation in this form; `sign` is σ.
    #[inline]
    pub fn of(block: &SpringBlock, sign: f64) -> Option<Self> {
        let SpringBlock { direction, transverse, axial } = *block;
        let excess = sign * (axial - transverse);
        let without_cancellation = transverse.abs() <= axial.abs() && excess >= 0.0;
        without_cancellation.then(|| Self { g: (direction * excess.sqrt()).into(), transverse })
    }
}

/// Batches between the use of memory and its prefetching, the best of 16, 32, 64 and 128: twice as fast as without.
const AHEAD: usize = 64;

/// `y = diagonal · w + B w` of a part, in N dimensions; `y` holds the rows of the part.
pub struct Product<'a, L, const N: usize> {
    pub simd: L,
    pub part: &'a Part,
    pub springs: &'a Springs<'a>,
    pub diagonal: &'a [f64],
    pub w: &'a [f64],
    pub y: &'a mut [f64],
}

impl<L: Simd, const N: usize> pulp::NullaryFnOnce for Product<'_, L, N> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { simd, part, springs, diagonal, w, y } = self;
        let rows = part.rows.clone();
        let (own, diagonal) = (&w[rows.clone()], &diagonal[rows.clone()]);
        let mut begun = Progress::default();
        for progress in &part.stretches {
            begin(begun.rows..progress.rows, diagonal, own, y);
            let (batches, ahead) = part.contiguous.with_prefetched(begun.contiguous..progress.contiguous, AHEAD);
            let mut contiguous = Contiguous::new(simd, rows.start, springs.sign);
            for ((n, batch), ahead) in (begun.contiguous..).zip(batches).zip(ahead) {
                prefetch_batch(ahead);
                contiguous.add(batch, w, y);
                if batch.ends.by_matrix != 0 {
                    add_by_matrix(n, &part.contiguous, springs, w, rows.start, y);
                }
            }
            contiguous.store(y);
            let (batches, ahead) = part.others.with_prefetched(begun.others..progress.others, AHEAD);
            let mut gathered = Gathered::<L, N>::new(simd, rows.start);
            for (batch, ahead) in batches.iter().zip(ahead) {
                prefetch_batch(ahead);
                gathered.add_four(batch, springs, w, y);
            }
            gathered.store(y);
            begun = *progress;
        }
        begin(begun.rows..y.len(), diagonal, own, y);
    }
}

#[inline(always)]
fn prefetch_batch<E>(batch: &SpringBatch4<E>) {
    prefetch(&batch.g[0]);
    prefetch(&batch.g[2]);
    prefetch(&batch.ends);
}

/// Adds the springs of a contiguous batch that are multiplied by their matrix; y begins with the row `first`.
#[cold]
fn add_by_matrix(
    number: usize,
    batches: &Batches<ContiguousEnds>,
    springs: &Springs,
    w: &[f64],
    first: usize,
    y: &mut [f64],
) {
    let by_matrix = batches.batches[number].ends.by_matrix;
    for (n, position) in batches.positions(number).into_iter().enumerate() {
        if by_matrix & (1 << n) != 0 {
            springs.add_by_matrix(position, w, first, y);
        }
    }
}

#[inline(always)]
fn begin(rows: Range<usize>, diagonal: &[f64], w: &[f64], y: &mut [f64]) {
    let terms = diagonal[rows.clone()].iter().zip(&w[rows.clone()]);
    for (y, (m, w)) in y[rows].iter_mut().zip(terms) {
        *y = m * w;
    }
}

/// Contiguous springs that share four first ends. Here `s = B (w_j − w_i)`, which is added to the others and subtracted from the first.
pub struct Contiguous<L: Simd> {
    simd: L,
    sign: L::Four,
    first: u32,
    row: u32,
    w: [L::Four; 3],
    sum: [L::Four; 3],
}

impl<L: Simd> Contiguous<L> {
    #[inline(always)]
    pub fn new(simd: L, first: usize, sign: f64) -> Self {
        let nothing = [simd.four([0.0; 4]); 3];
        Self { simd, sign: simd.four([sign; 4]), first: first as u32, row: NO_ROW, w: nothing, sum: nothing }
    }

    #[inline(always)]
    pub fn add(&mut self, batch: &SpringBatch4<ContiguousEnds>, w: &[f64], y: &mut [f64]) {
        let simd = self.simd;
        let [i, j] = batch.ends.rows;
        if i != self.row {
            let Some(of_first) = load_twelve(simd, w, i) else { return };
            self.store(y);
            (self.row, self.w, self.sum) = (i, of_first, [simd.four([0.0; 4]); 3]);
        }
        let of_others = load_twelve(simd, w, j).unwrap_or([simd.four([0.0; 4]); 3]);
        let d = std::array::from_fn(|piece| simd.sub(of_others[piece], self.w[piece]));
        let s = simd.interleave(batch.times(simd, self.sign, simd.deinterleave(d)));
        self.sum = std::array::from_fn(|piece| simd.sub(self.sum[piece], s[piece]));
        if j != NO_ROW {
            add_twelve(simd, y, j.wrapping_sub(self.first), s);
        }
    }

    #[inline(always)]
    pub fn store(&self, y: &mut [f64]) {
        add_twelve(self.simd, y, self.row.wrapping_sub(self.first), self.sum);
    }
}

#[inline(always)]
fn load_twelve<L: Simd>(simd: L, v: &[f64], row: u32) -> Option<[L::Four; 3]> {
    let row = row as usize;
    let numbers: &[f64; 12] = v.get(row..row.wrapping_add(12))?.first_chunk()?;
    let [a, b, c, d, e, f, g, h, i, j, k, l] = *numbers;
    Some([simd.four([a, b, c, d]), simd.four([e, f, g, h]), simd.four([i, j, k, l])])
}

/// Adds to twelve rows from `row` on, as far as y has them: others belong to other parts.
#[inline(always)]
fn add_twelve<L: Simd>(simd: L, y: &mut [f64], row: u32, s: [L::Four; 3]) {
    match load_twelve(simd, y, row) {
        Some(old) => {
            let row = row as usize;
            for (n, y) in y[row..row + 12].chunks_exact_mut(4).enumerate() {
                y.copy_from_slice(&simd.all(simd.add(old[n], s[n])));
            }
        }
        None => add_some(y, row, s.map(|s| simd.all(s))),
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

/// Any springs: the end that successive ones share, with its first row, its part of w and its sum so far.
pub struct Gathered<L: Simd, const N: usize> {
    simd: L,
    first: u32,
    row: u32,
    w: L::Four,
    sum: (L::Two, f64),
}

impl<L: Simd, const N: usize> Gathered<L, N> {
    #[inline(always)]
    pub fn new(simd: L, first: usize) -> Self {
        let nothing = (simd.two([0.0; 2]), 0.0);
        Self { simd, first: first as u32, row: NO_ROW, w: simd.four([0.0; 4]), sum: nothing }
    }

    #[inline(always)]
    pub fn add_four(&mut self, batch: &SpringBatch4<GatheredEnds>, springs: &Springs, w: &[f64], y: &mut [f64]) {
        if self.simd.all_equal(&batch.ends[0]) && batch.ends[0][0] != BY_MATRIX {
            self.add_sharing_end(batch, springs.sign, w, y);
        } else {
            self.add(batch, springs, w, y);
        }
    }

    #[inline(always)]
    fn add_sharing_end(&mut self, batch: &SpringBatch4<GatheredEnds>, sign: f64, w: &[f64], y: &mut [f64]) {
        let simd = self.simd;
        let [[i, ..], to] = &batch.ends;
        if *i != self.row {
            self.change_end(*i, y);
            self.w = wide::<L, N>(simd, w, *i);
        }
        let d = to.map(|j| simd.sub(self.w, wide::<L, N>(simd, w, j)));
        let s = simd.split_transpose(batch.times(simd, simd.four([sign; 4]), simd.transpose(d)));
        for spring in 0..4 {
            self.add_one(s[spring], to[spring], y);
        }
    }

    #[inline(always)]
    fn add(&mut self, batch: &SpringBatch4<GatheredEnds>, springs: &Springs, w: &[f64], y: &mut [f64]) {
        let simd = self.simd;
        let [from, to] = &batch.ends;
        let mut row = self.row;
        let d = std::array::from_fn(|spring| {
            if from[spring] != row {
                row = from[spring];
                self.w = wide::<L, N>(simd, w, row);
            }
            simd.sub(self.w, wide::<L, N>(simd, w, to[spring]))
        });
        let s = simd.split_transpose(batch.times(simd, simd.four([springs.sign; 4]), simd.transpose(d)));
        for spring in 0..4 {
            let [i, j] = [from[spring], to[spring]];
            if i != self.row {
                self.change_end(i, y);
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
        let simd = self.simd;
        self.sum = (simd.add_two(self.sum.0, s.0), self.sum.1 + s.1);
        if let Some(y) = at_mut::<N>(y, j.wrapping_sub(self.first)) {
            let (xy, z) = sum_at(simd, y);
            put(simd, y, (simd.sub_two(xy, s.0), z - s.1));
        }
    }

    /// Stores the sum and begins with another end.
    #[inline(always)]
    fn change_end(&mut self, row: u32, y: &mut [f64]) {
        self.store(y);
        let at = row.wrapping_sub(self.first) as usize;
        (self.row, self.sum) = (row, sum_at(self.simd, y.get(at..at.wrapping_add(N)).unwrap_or_default()));
    }

    /// Stores the sum, if `y` has its rows.
    #[inline(always)]
    pub fn store(&self, y: &mut [f64]) {
        if let Some(y) = at_mut::<N>(y, self.row.wrapping_sub(self.first)) {
            put(self.simd, y, self.sum);
        }
    }
}

/// N numbers from `row` on and padding; zeros out of range.
#[inline(always)]
fn wide<L: Simd, const N: usize>(simd: L, v: &[f64], row: u32) -> L::Four {
    let row = row as usize;
    if N < 3 {
        return simd.four(few::<N>(v, row));
    }
    match v.get(row..row.wrapping_add(4)).and_then(|v| v.first_chunk()) {
        Some(numbers) => simd.four(*numbers),
        None => simd.four(last(v, row)),
    }
}

#[cold]
fn last(v: &[f64], row: usize) -> [f64; 4] {
    few::<3>(v, row)
}

#[inline(always)]
fn few<const N: usize>(v: &[f64], row: usize) -> [f64; 4] {
    let numbers = v.get(row..row.wrapping_add(N)).unwrap_or_default();
    std::array::from_fn(|axis| numbers.get(axis).copied().unwrap_or(0.0))
}

/// As many numbers as there are dimensions, with zeros on the other axes; zeros out of range.
#[inline(always)]
fn sum_at<L: Simd>(simd: L, v: &[f64]) -> (L::Two, f64) {
    match *v {
        [x, y, z] => (simd.two([x, y]), z),
        [x, y] => (simd.two([x, y]), 0.0),
        [x] => (simd.two([x, 0.0]), 0.0),
        _ => (simd.two([0.0; 2]), 0.0),
    }
}

#[inline(always)]
fn at_mut<const N: usize>(v: &mut [f64], row: u32) -> Option<&mut [f64]> {
    let row = row as usize;
    v.get_mut(row..row.wrapping_add(N))
}

#[inline(always)]
fn put<L: Simd>(simd: L, v: &mut [f64], (xy, z): (L::Two, f64)) {
    let [x, y] = simd.numbers(xy);
    match v {
        [a, b, c] => (*a, *b, *c) = (x, y, z),
        [a, b] => (*a, *b) = (x, y),
        [a] => *a = x,
        _ => {}
    }
}
