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
//! Springs are taken four at a time: a product is bound by the instructions of one thread, not by the memory, until the data is far larger than the
//! caches.
//!
//! The rows are cut into *parts*, one a thread. A part owns consecutive particles and streams through all springs that end
//! in it, in the order of the active springs, adding to its own rows only; a spring between two parts stands in both. So
//! no two threads write to one row, and every row adds up its springs in one order: the result is the same to the bit
//! for any number of parts.

mod product;

use super::lanes::Portable;
use crate::spring::SpringBlock;
use crate::system::{Axes, DofMap, Share, System};
use product::Product;
use std::ops::Range;
use std::sync::Arc;

/// Quads between two looks at how far the rows reach.
const CHUNK: usize = 32;

/// Four springs of a part, list by list. Behind the last spring there may be some without rows.
#[derive(Debug, Clone, Copy)]
struct Quad {
    /// g, in √(N/m), by axes.
    g: [[f64; 4]; 3],
    /// α, in N/m.
    transverse: [f64; 4],
    /// The first rows of the first ends, and of the others; [`BY_MATRIX`] and the spring's position for one that goes through its matrix.
    ends: [[u32; 4]; 2],
}

const BY_MATRIX: u32 = u32::MAX;

/// No row: rows are fewer, and so are the differences of two.
const NO_ROW: u32 = u32::MAX - 1;

impl Quad {
    const NONE: Self = Self { g: [[0.0; 4]; 3], transverse: [0.0; 4], ends: [[NO_ROW; 4]; 2] };

    fn set(&mut self, spring: usize, g: [f64; 3], transverse: f64, ends: [u32; 2]) {
        (0..3).for_each(|axis| self.g[axis][spring] = g[axis]);
        self.transverse[spring] = transverse;
        (0..2).for_each(|end| self.ends[end][spring] = ends[end]);
    }
}

/// Consecutive particles and the springs that end in them.
#[derive(Debug, Clone)]
struct Part {
    rows: Range<usize>,
    /// Positions among the active springs, ascending.
    positions: Arc<[u32]>,
    quads: Vec<Quad>,
    /// How many rows of this part must have their first term before the springs of a chunk are added, those of earlier chunks included.
    reach: Vec<u32>,
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
        [part] => multiply_part::<N>(part, springs, diagonal, w, y),
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

/// With the widest registers that the processor has and this knows.
fn multiply_part<const N: usize>(part: &Part, springs: &Springs, diagonal: &[f64], w: &[f64], y: &mut [f64]) {
    #[cfg(target_arch = "x86_64")]
    if let Some(lanes) = pulp::x86::V3::try_new() {
        return lanes.vectorize(Product::<_, N> { lanes, part, springs, diagonal, w, y });
    }
    pulp::NullaryFnOnce::call(Product::<_, N> { lanes: Portable, part, springs, diagonal, w, y });
}

impl Part {
    fn new(system: &System, Share { particles, springs: positions }: &Share) -> Self {
        let dofs = system.dofs();
        let rows = dofs.first_row(particles.start)..dofs.first_row(particles.end);
        let end = |&position: &u32| {
            let pair = system.pair(system.active_springs()[position as usize] as usize);
            let own = pair.into_iter().filter(|end| particles.contains(end));
            own.map(|end| (dofs.first_row(end + 1) - rows.start) as u32).max().unwrap_or(0)
        };
        let furthest = |so_far: &mut u32, of_chunk: &[u32]| {
            *so_far = of_chunk.iter().map(end).fold(*so_far, u32::max);
            Some(*so_far)
        };
        let reach = positions.chunks(4 * CHUNK).scan(0, furthest).collect();
        let quads = vec![Quad::NONE; positions.len().div_ceil(4)];
        Self { rows, quads, reach, positions: positions.clone() }
    }

    fn update(&mut self, springs: &Springs) {
        let Springs { system, blocks, sign } = *springs;
        let modelled = Axes::first(system.dimension());
        let dofs = system.dofs();
        for (quad, positions) in self.quads.iter_mut().zip(self.positions.chunks(4)) {
            for (spring, &position) in positions.iter().enumerate() {
                let SpringBlock { direction, transverse, axial } = blocks[position as usize];
                let pair = system.pair(system.active_springs()[position as usize] as usize);
                let excess = sign * (axial - transverse);
                let is_free = pair.iter().all(|&end| dofs.free_axes(end) == modelled);
                let without_cancellation = transverse.abs() <= axial.abs() && excess >= 0.0;
                if is_free && without_cancellation {
                    let g = (direction * excess.sqrt()).into();
                    quad.set(spring, g, transverse, pair.map(|end| dofs.first_row(end) as u32));
                } else {
                    quad.set(spring, [0.0; 3], 0.0, [BY_MATRIX, position]);
                }
            }
        }
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

#[cfg(test)]
mod tests;
