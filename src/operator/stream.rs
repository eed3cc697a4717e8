//! The springs of an operator in the form and order in which a product reads them.
//!
//! A block `α (I − nnᵀ) + β nnᵀ` needs four numbers: with `g = √|β − α| n`,
//!
//! ```text
//! B d = α d + σ g (g·d),   σ the sign of β, one for the whole operator.
//! ```
//!
//! Where `|α| ≤ |β|`, every number is computed without cancellation, so the product is the exact one of a block whose α, β
//! and n are changed by a few units in the last place: its error is at most `c u (|α| |I − nnᵀ| + |β| |nnᵀ|) |d|` by
//! components. This holds for every spring longer than half its rest length. The others (and springs with an end that is
//! not free along all axes) are multiplied through their 3×3 matrix, which keeps the bound for every α and β.
//!
//! The rows are cut into *parts*, one a thread. A part owns consecutive particles and streams through all springs that end
//! in it, in the order of the active springs, adding to its own rows only; a spring between two parts stands in both. So
//! no two threads write to one row, and every row adds up its springs in one order: the result is the same to the bit
//! for any number of parts.

use super::prefetch;
use crate::spring::SpringBlock;
use crate::system::{Axes, DofMap, Share, System};
use std::ops::Range;
use std::sync::Arc;

/// Records between two rounds of prefetching: five cache lines hold eight of them.
const BATCH: usize = 8;

/// One of them in every line.
const IN_EVERY_LINE: [usize; 5] = [0, 2, 4, 5, 7];

/// How many records ahead of their use memory is asked for: about the delay of main memory. Measured, 256 is the best of
/// 64, 128, 256 and 512, and twice as fast as the processor's own prefetching alone.
const AHEAD: usize = 256;

/// One spring of a part.
#[derive(Debug, Clone, Copy)]
struct Record {
    /// g, in √(N/m).
    g: [f64; 3],
    /// α, in N/m.
    transverse: f64,
    /// The first rows of both ends; [`BY_MATRIX`] and the spring's position for one that goes through its matrix.
    ends: [u32; 2],
}

const BY_MATRIX: u32 = u32::MAX;

/// No row: rows are fewer, and so are the differences of two.
const NO_ROW: u32 = u32::MAX - 1;

/// Consecutive particles and the springs that end in them.
#[derive(Debug, Clone)]
struct Part {
    rows: Range<usize>,
    /// Positions among the active springs, ascending.
    positions: Arc<[u32]>,
    records: Vec<Record>,
}

/// The springs of an operator, by parts.
#[derive(Debug, Clone)]
pub(super) struct SpringStream {
    parts: Vec<Part>,
    /// σ.
    sign: f64,
}

impl SpringStream {
    /// A part for every share; [`update`](Self::update) fills in the numbers.
    pub fn new(system: &System, shares: &[Share]) -> Self {
        let parts = shares.iter().map(|share| Part::new(system, share)).collect();
        Self { parts, sign: 1.0 }
    }

    /// Recomputes the numbers from the blocks of the active springs, without allocating.
    pub fn update(&mut self, system: &System, blocks: &[SpringBlock]) {
        self.sign = if blocks.iter().any(|block| block.axial < 0.0) { -1.0 } else { 1.0 };
        update_parts(&mut self.parts, &Springs { system, blocks, sign: self.sign });
    }

    /// `y += B w` over all springs, and before it `y = diagonal · w`, one number a row.
    pub fn multiply(&self, system: &System, blocks: &[SpringBlock], diagonal: &[f64], w: &[f64], y: &mut [f64]) {
        let springs = Springs { system, blocks, sign: self.sign };
        match system.dimension() {
            1 => multiply_parts::<1>(&self.parts, &springs, diagonal, w, y),
            2 => multiply_parts::<2>(&self.parts, &springs, diagonal, w, y),
            _ => multiply_parts::<3>(&self.parts, &springs, diagonal, w, y),
        }
    }
}

/// What all parts read.
#[derive(Clone, Copy)]
struct Springs<'a> {
    system: &'a System,
    blocks: &'a [SpringBlock],
    sign: f64,
}

fn update_parts(parts: &mut [Part], springs: &Springs) {
    match parts {
        [] => {}
        [part] => part.update(springs),
        parts => {
            let (left, right) = parts.split_at_mut(parts.len() / 2);
            rayon::join(|| update_parts(left, springs), || update_parts(right, springs));
        }
    }
}

/// `y` holds the rows of these parts.
fn multiply_parts<const N: usize>(parts: &[Part], springs: &Springs, diagonal: &[f64], w: &[f64], y: &mut [f64]) {
    match parts {
        [] => {}
        [part] => pulp::Arch::new().dispatch(Product::<N> { part, springs, diagonal, w, y }),
        [first, ..] => {
            let (left, right) = parts.split_at(parts.len() / 2);
            let boundary = right.first().map_or(0, |part| part.rows.start - first.rows.start);
            let (top, bottom) = y.split_at_mut(boundary);
            rayon::join(
                || multiply_parts::<N>(left, springs, diagonal, w, top),
                || multiply_parts::<N>(right, springs, diagonal, w, bottom),
            );
        }
    }
}

impl Part {
    fn new(system: &System, Share { particles, springs: positions }: &Share) -> Self {
        let nothing = Record { g: [0.0; 3], transverse: 0.0, ends: [0; 2] };
        let rows = system.dofs().first_row(particles.start)..system.dofs().first_row(particles.end);
        Self { rows, records: vec![nothing; positions.len()], positions: positions.clone() }
    }

    fn update(&mut self, springs: &Springs) {
        let Springs { system, blocks, sign } = *springs;
        let modelled = Axes::first(system.dimension());
        let dofs = system.dofs();
        for (record, &position) in self.records.iter_mut().zip(&*self.positions) {
            let SpringBlock { direction, transverse, axial } = blocks[position as usize];
            let pair = system.pair(system.active_springs()[position as usize] as usize);
            let excess = sign * (axial - transverse);
            let is_free = pair.iter().all(|&end| dofs.free_axes(end) == modelled);
            let without_cancellation = transverse.abs() <= axial.abs() && excess >= 0.0;
            *record = if is_free && without_cancellation {
                let g = (direction * excess.sqrt()).into();
                Record { g, transverse, ends: pair.map(|end| dofs.rows(end).start as u32) }
            } else {
                Record { g: [0.0; 3], transverse: 0.0, ends: [BY_MATRIX, position] }
            };
        }
    }
}

/// A part's product, compiled for every kind of processor that [`pulp`] tells apart.
struct Product<'a, const N: usize> {
    part: &'a Part,
    springs: &'a Springs<'a>,
    diagonal: &'a [f64],
    w: &'a [f64],
    y: &'a mut [f64],
}

impl<const N: usize> pulp::NullaryFnOnce for Product<'_, N> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { part: Part { rows, records, .. }, springs, diagonal, w, y } = self;
        // Rows are numbered in 32 bits.
        let first = rows.start as u32;
        for ((y, m), w) in y.iter_mut().zip(&diagonal[rows.clone()]).zip(&w[rows.clone()]) {
            *y = m * w;
        }
        // Successive springs often share their first end: its sum stays in registers until another one comes.
        let mut run = Run::<N> { row: NO_ROW, w: [0.0; N], sum: [0.0; N] };
        for (batch, of_batch) in records.chunks(BATCH).enumerate() {
            if let Some(ahead) = records.get(batch * BATCH + AHEAD..(batch + 1) * BATCH + AHEAD) {
                IN_EVERY_LINE.iter().for_each(|&record| prefetch(&ahead[record]));
            }
            for &Record { g, transverse, ends: [i, j] } in of_batch {
                if i != run.row {
                    run.end(first, y);
                    if i == BY_MATRIX {
                        run.row = NO_ROW;
                        springs.add_by_matrix(j as usize, w, rows.start, y);
                        continue;
                    }
                    run = Run { row: i, w: at(w, i), sum: at(y, i.wrapping_sub(first)) };
                }
                let wj: [f64; N] = at(w, j);
                let d: [f64; N] = std::array::from_fn(|axis| run.w[axis] - wj[axis]);
                let along = springs.sign * (1..N).fold(g[0] * d[0], |sum, axis| sum + g[axis] * d[axis]);
                let s: [f64; N] = std::array::from_fn(|axis| transverse * d[axis] + g[axis] * along);
                (0..N).for_each(|axis| run.sum[axis] += s[axis]);
                if let Some(y) = at_mut::<N>(y, j.wrapping_sub(first)) {
                    (0..N).for_each(|axis| y[axis] -= s[axis]);
                }
            }
        }
        run.end(first, y);
    }
}

impl Springs<'_> {
    /// The product of one spring through its 3×3 matrix; `y` holds the rows from `first` on.
    fn add_by_matrix(&self, position: usize, w: &[f64], first: usize, y: &mut [f64]) {
        let dofs = self.system.dofs();
        let [i, j] = self.system.pair(self.system.active_springs()[position] as usize);
        let s = self.blocks[position].apply(&(dofs.get(w, i) - dofs.get(w, j)));
        add_own(dofs, first, y, i, s.into());
        add_own(dofs, first, y, j, (-s).into());
    }
}

/// Adds to a particle's rows if `y`, the rows from `first` on, holds them.
fn add_own(dofs: &DofMap, first: usize, y: &mut [f64], particle: usize, s: [f64; 3]) {
    let rows = dofs.rows(particle);
    if let Some(y) = y.get_mut(rows.start.wrapping_sub(first)..rows.end.wrapping_sub(first)) {
        for (y, axis) in y.iter_mut().zip(dofs.free_axes(particle).iter()) {
            *y += s[axis];
        }
    }
}

/// The end that successive springs share: its first row, its part of w and its sum so far.
struct Run<const N: usize> {
    row: u32,
    w: [f64; N],
    sum: [f64; N],
}

impl<const N: usize> Run<N> {
    /// Puts the sum back, if `y`, the rows from `first` on, holds them.
    #[inline(always)]
    fn end(&self, first: u32, y: &mut [f64]) {
        if let Some(y) = at_mut::<N>(y, self.row.wrapping_sub(first)) {
            *y = self.sum;
        }
    }
}

/// N numbers from `row` on; zeros where there are none.
#[inline(always)]
fn at<const N: usize>(v: &[f64], row: u32) -> [f64; N] {
    let row = row as usize;
    v.get(row..row.wrapping_add(N)).and_then(|v| v.first_chunk()).copied().unwrap_or([0.0; N])
}

#[inline(always)]
fn at_mut<const N: usize>(v: &mut [f64], row: u32) -> Option<&mut [f64; N]> {
    let row = row as usize;
    v.get_mut(row..row.wrapping_add(N)).and_then(|v| v.first_chunk_mut())
}

#[cfg(test)]
mod tests;
