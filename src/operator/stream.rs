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
//! Springs are taken four at a time, *in a row* where they are (the module `order`): a product is bound by the instructions of one
//! thread, not by the memory, until the data is far larger than the caches.
//!
//! The rows are cut into *parts*, one a thread. A part owns consecutive particles and streams through all springs that end
//! in it, in the one order of all springs, adding to its own rows only; a spring between two parts stands in both. So
//! no two threads write to one row, and every row adds up its springs in one order: the result is the same to the bit
//! for any number of parts.

mod batch4;
mod contiguous;
mod gathered;
mod order;
mod part;
mod product;

use super::lanes::Portable;
use crate::spring::SpringBlock;
use crate::system::{DofMap, System, ThreadPartition};
use order::pair;
use part::{Growing, Part};
use product::Product;

/// The springs of an operator, by parts.
#[derive(Debug, Clone)]
pub(super) struct SpringStream {
    parts: Vec<Part>,
    /// σ.
    sign: f64,
}

impl SpringStream {
    /// A part for every share; [`update`](Self::update) fills in the numbers.
    pub fn new(system: &System, shares: &[ThreadPartition]) -> Self {
        let mut parts: Vec<_> = shares.iter().map(|share| Growing::new(system, share)).collect();
        for stretch in order::stretches(system) {
            parts.iter_mut().for_each(|part| part.add(&stretch));
        }
        Self { parts: parts.into_iter().map(Growing::finish).collect(), sign: 1.0 }
    }

    /// Recomputes the numbers from the blocks of the active springs, without allocating. Those whose β has the other sign go through their matrix.
    pub fn update(&mut self, system: &System, blocks: &[SpringBlock], sign: f64) {
        self.sign = sign;
        update_parts(&mut self.parts, &Springs { system, blocks, sign: self.sign });
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
        [part] => multiply_part::<N>(part, springs, diagonal, w, y),
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

/// With the widest registers that the processor has and this knows.
fn multiply_part<const N: usize>(part: &Part, springs: &Springs, diagonal: &[f64], w: &[f64], y: &mut [f64]) {
    #[cfg(target_arch = "x86_64")]
    if let Some(lanes) = pulp::x86::V3::try_new() {
        return lanes.vectorize(Product::<_, N> { lanes, part, springs, diagonal, w, y });
    }
    pulp::NullaryFnOnce::call(Product::<_, N> { lanes: Portable, part, springs, diagonal, w, y });
}

impl Springs<'_> {
    /// The product of one spring through its 3×3 matrix; `y` holds the rows from `first` on.
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
