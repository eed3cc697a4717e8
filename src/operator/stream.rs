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
//! components. This holds for every spring longer than half its rest length. The others (and springs with an end that
//! moves along some axes only) are multiplied through their 3×3 matrix, which keeps the bound for every α and β.
//!
//! The rows are cut into *parts*, one a thread. A part owns consecutive particles and streams through all springs that end
//! in it, in the one order of all springs, adding to its own rows only; a spring between two parts stands in both. So
//! no two threads write to one row, and every row adds up its springs in one order: the result is the same to the bit
//! for any number of parts. Springs follow each other by their first end, whose rows of w and of the sum stay in registers.

use super::prefetch;
use crate::registers::widely;
use crate::spring::SpringBlock;
use crate::system::{Axes, DofMap, Share, System};
use std::ops::Range;

/// Springs ahead of their use for which memory is asked: about the delay of main memory.
const AHEAD: usize = 128;

/// In place of the first end's row: the spring goes through its matrix, and its position stands in place of the other row.
const BY_MATRIX: u32 = u32::MAX;

/// The row of an end that is held.
const NO_ROW: u32 = u32::MAX - 1;

/// A spring as a product reads it.
#[derive(Debug, Clone, Copy)]
struct Streamed {
    /// g, in √(N/m), and α, in N/m.
    numbers: [f64; 4],
    /// Where the rows of both ends begin, or [`BY_MATRIX`] and the spring's position.
    ends: [u32; 2],
}

/// Consecutive particles and the springs that end in them.
#[derive(Debug, Clone)]
struct Part {
    rows: Range<usize>,
    springs: Vec<Streamed>,
    /// Positions of the springs among the active ones.
    positions: Vec<u32>,
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
        Self { parts: shares.iter().map(|share| Part::new(system, share)).collect(), sign: 1.0 }
    }

    /// Recomputes the numbers from the blocks of the active springs, without allocating. Those whose β has the other sign go through their matrix.
    pub fn update(&mut self, system: &System, blocks: &[SpringBlock], sign: f64) {
        self.sign = sign;
        update_parts(&mut self.parts, &Springs { system, blocks, sign });
    }

    /// `y = diagonal · w + B w` over all springs, `diagonal` one number a row.
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
        [part] => part.multiply::<N>(springs, diagonal, w, y),
        [first, ..] => {
            let (left, right) = parts.split_at(parts.len() / 2);
            let boundary = right.first().map_or(first.rows.start, |part| part.rows.start);
            let (top, bottom) = y.split_at_mut(boundary - first.rows.start);
            rayon::join(
                || multiply_parts::<N>(left, springs, diagonal, w, top),
                || multiply_parts::<N>(right, springs, diagonal, w, bottom),
            );
        }
    }
}

impl Part {
    fn new(system: &System, Share { particles, springs }: &Share) -> Self {
        let rows = system.dofs().first_row(particles.start)..system.dofs().first_row(particles.end);
        let mut positions = springs.to_vec();
        positions.sort_unstable_by_key(|&position| (ends(system, position)[0], position));
        let nothing = |&position: &u32| Streamed { numbers: [0.0; 4], ends: [BY_MATRIX, position] };
        Self { rows, springs: positions.iter().map(nothing).collect(), positions }
    }

    fn update(&mut self, springs: &Springs) {
        for (spring, &position) in self.springs.iter_mut().zip(&self.positions) {
            let Some(SpringBlock { direction, transverse, axial }) = springs.blocks.get(position as usize) else {
                continue;
            };
            let excess = springs.sign * (axial - transverse);
            // Without cancellation.
            let is_streamed = transverse.abs() <= axial.abs() && excess >= 0.0;
            if !is_streamed {
                spring.ends = [BY_MATRIX, position];
                continue;
            }
            // What was streamed keeps its rows: to look them up takes longer than all the rest.
            if spring.ends[0] == BY_MATRIX {
                spring.ends = rows(springs.system, position).unwrap_or([BY_MATRIX, position]);
            }
            let g = direction * excess.sqrt();
            spring.numbers = [g.x, g.y, g.z, *transverse];
        }
    }

    /// `y = diagonal · w + B w` in N dimensions; `y` holds the rows of the part.
    fn multiply<const N: usize>(&self, springs: &Springs, diagonal: &[f64], w: &[f64], y: &mut [f64]) {
        for ((y, m), w) in y.iter_mut().zip(&diagonal[self.rows.clone()]).zip(&w[self.rows.clone()]) {
            *y = m * w;
        }
        widely(
            #[inline(always)]
            || self.add_springs::<N>(springs, w, y),
        );
    }

    #[inline(always)]
    fn add_springs<const N: usize>(&self, springs: &Springs, w: &[f64], y: &mut [f64]) {
        let first = self.rows.start;
        let (mut row, mut mine, mut sum) = (NO_ROW, [0.0; LANES], [0.0; LANES]);
        for (spring, ahead) in self.springs.iter().zip(self.springs.iter().skip(AHEAD).chain(&self.springs)) {
            prefetch(ahead);
            let [i, j] = spring.ends;
            if i != row {
                add::<N>(y, first, row, sum);
                (row, sum) = (i, [0.0; LANES]);
                if i == BY_MATRIX {
                    row = NO_ROW;
                    springs.add_by_matrix(j, w, first, y);
                    continue;
                }
                mine = lanes::<N>(w, i);
            }
            let other = lanes::<N>(w, j);
            let (g, transverse) = (&spring.numbers, spring.numbers[LANES - 1]);
            let d: [f64; LANES] = [mine[0] - other[0], mine[1] - other[1], mine[2] - other[2], mine[3] - other[3]];
            let along = springs.sign * (g[0] * d[0] + g[1] * d[1] + g[2] * d[2]);
            let mut s = [0.0; LANES];
            for lane in 0..LANES {
                s[lane] = transverse * d[lane] + g[lane] * along;
                sum[lane] += s[lane];
            }
            add::<N>(y, first, j, s.map(|s| -s));
        }
        add::<N>(y, first, row, sum);
    }
}

/// Numbers that are worked on at once: those of a vector, and one that is never looked at.
const LANES: usize = 4;

/// N numbers from `row` on in the first lanes; zeros where there are none.
#[inline(always)]
fn lanes<const N: usize>(v: &[f64], row: u32) -> [f64; LANES] {
    let row = row as usize;
    if N == 3
        && let Some(numbers) = v.get(row..row.wrapping_add(LANES)).and_then(|v| v.first_chunk())
    {
        return *numbers;
    }
    let numbers = v.get(row..row.wrapping_add(N)).unwrap_or_default();
    std::array::from_fn(|axis| numbers.get(axis).copied().unwrap_or(0.0))
}

/// Adds to the rows from `row` on, if `y`, the rows from `first` on, holds them.
#[inline(always)]
fn add<const N: usize>(y: &mut [f64], first: usize, row: u32, s: [f64; LANES]) {
    let row = (row as usize).wrapping_sub(first);
    if let Some(y) = y.get_mut(row..row.wrapping_add(N)) {
        y.iter_mut().zip(s).for_each(|(y, s)| *y += s);
    }
}

/// The ends of the active spring at a position: first the one with the smaller number, or the one that moves.
fn ends(system: &System, position: u32) -> [usize; 2] {
    let [i, j] = pair(system, position);
    let (first, other) = (i.min(j), i.max(j));
    if system.dofs().free_axes(first) == Axes::NONE { [other, first] } else { [first, other] }
}

fn pair(system: &System, position: u32) -> [usize; 2] {
    system.pair(system.active_springs()[position as usize] as usize)
}

/// Where the rows of both ends begin, if each moves along all axes or is held.
fn rows(system: &System, position: u32) -> Option<[u32; 2]> {
    let row = |particle| match system.dofs().free_axes(particle) {
        Axes::NONE => Some(NO_ROW),
        // Rows are numbered in 32 bits.
        axes => (axes == Axes::first(system.dimension())).then(|| system.dofs().first_row(particle) as u32),
    };
    let [first, other] = ends(system, position).map(row);
    Some([first?, other?])
}

impl Springs<'_> {
    /// The product of one spring through its 3×3 matrix; `y` holds the rows from `first` on.
    #[cold]
    fn add_by_matrix(&self, position: u32, w: &[f64], first: usize, y: &mut [f64]) {
        let dofs = self.system.dofs();
        let [i, j] = pair(self.system, position);
        let s = self.blocks[position as usize].apply(&(dofs.get(w, i) - dofs.get(w, j)));
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

#[cfg(test)]
mod tests;
