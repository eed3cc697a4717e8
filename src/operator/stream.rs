//! The springs of an operator in the form and order in which a product reads them.
//!
//! A block `α (I − nnᵀ) + β nnᵀ` needs four numbers: with `g = √|β − α| n`,
//!
//! ```text
//! B d = α d + σ g (g·d),   σ the sign of β, one for the whole operator.
//! ```
//!
//! Where `|α| ≤ |β|`, which holds for every spring longer than half its rest length, nothing cancels: the product is the exact one of a block whose
//! α, β and n are changed by a few units in the last place, with an error of at most `c u (|α| |I − nnᵀ| + |β| |nnᵀ|) |d|` by components. Other
//! springs, and those with an end that moves along some axes only, are multiplied by their 3×3 matrix, which keeps the bound for every α and β.
//!
//! Springs are taken four at a time, contiguous where possible, see `spring_order`: until the data is far larger than the caches a product is bound
//! by instructions.
//!
//! The rows are cut into *parts*, one a thread. A part owns consecutive particles and streams through all springs that end in it, in the one order of
//! all springs, adding to its own rows only; a spring between two parts is in both. So no two threads write to one row, and every row adds up its
//! springs in one order: the result is the same to the bit for any number of parts.

mod product;

use super::simd::Portable;
use super::spring_order::{Four, NO_ROW, NO_SPRING, Stretch, ends, most_stretches, pair, stretches};
use crate::spring::SpringBlock;
use crate::system::{Axes, DofMap, System, ThreadPartition};
use product::{BY_MATRIX, ContiguousEnds, GatheredEnds, Product, SpringBatch4, Streamed};
use rayon::prelude::*;
use std::ops::Range;

#[derive(Debug, Clone)]
pub(super) struct SpringStream {
    parts: Vec<Part>,
    /// σ.
    sign: f64,
}

impl SpringStream {
    /// A part for every partition; [`update`](Self::update) fills in the numbers.
    pub fn new(system: &System, partitions: &[ThreadPartition]) -> Self {
        let mut parts: Vec<_> = partitions.iter().map(|partition| Part::new(system, partition)).collect();
        for stretch in stretches(system) {
            parts.iter_mut().for_each(|part| part.add(system, &stretch));
        }
        parts.iter_mut().for_each(Part::shrink);
        Self { parts, sign: 1.0 }
    }

    /// Recomputes the numbers from the blocks of the active springs, without allocating; those whose β has the other sign go by their matrix.
    pub fn update(&mut self, system: &System, blocks: &[SpringBlock], sign: f64) {
        self.sign = sign;
        let springs = Springs { system, blocks, sign };
        self.parts.par_iter_mut().for_each(|part| part.update(&springs));
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

#[derive(Clone, Copy)]
pub struct Springs<'a> {
    system: &'a System,
    blocks: &'a [SpringBlock],
    pub sign: f64,
}

/// `y` has the rows of these parts.
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

fn multiply_part<const N: usize>(part: &Part, springs: &Springs, diagonal: &[f64], w: &[f64], y: &mut [f64]) {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = pulp::x86::V3::try_new() {
        return simd.vectorize(Product::<_, N> { simd, part, springs, diagonal, w, y });
    }
    pulp::NullaryFnOnce::call(Product::<_, N> { simd: Portable, part, springs, diagonal, w, y });
}

impl Springs<'_> {
    /// Adds the product of one spring by its 3×3 matrix; `y` has the rows from `first` on.
    pub fn add_by_matrix(&self, position: u32, w: &[f64], first: usize, y: &mut [f64]) {
        let dofs = self.system.dofs();
        let [i, j] = pair(self.system, position);
        let s = self.blocks[position as usize].apply(&(dofs.get(w, i) - dofs.get(w, j)));
        add_own(dofs, first, y, i, s.into());
        add_own(dofs, first, y, j, (-s).into());
    }
}

/// Adds to a particle's rows if `y`, the rows from `first` on, has them.
fn add_own(dofs: &DofMap, first: usize, y: &mut [f64], particle: usize, s: [f64; 3]) {
    let rows = dofs.rows(particle);
    if let Some(y) = y.get_mut(rows.start.wrapping_sub(first)..rows.end.wrapping_sub(first)) {
        for (y, axis) in y.iter_mut().zip(dofs.free_axes(particle).iter()) {
            *y += s[axis];
        }
    }
}

#[derive(Debug, Clone)]
pub struct Batches<E> {
    pub batches: Vec<SpringBatch4<E>>,
    positions: Vec<Four>,
}

#[derive(Debug, Clone)]
pub struct Part {
    particles: Range<usize>,
    pub rows: Range<usize>,
    pub contiguous: Batches<ContiguousEnds>,
    pub others: Batches<GatheredEnds>,
    /// The progress after every stretch.
    pub stretches: Vec<Progress>,
}

/// The numbers of batches and rows of a part up to the end of a stretch.
#[derive(Debug, Clone, Copy, Default)]
pub struct Progress {
    pub contiguous: usize,
    pub others: usize,
    /// Rows that need their first term before springs are added.
    pub rows: usize,
}

impl Part {
    /// Without springs, and with capacity for all that can end in its particles, as growing lists would fragment memory.
    fn new(system: &System, ThreadPartition { particles, springs }: &ThreadPartition) -> Self {
        let stretches = most_stretches(system);
        Self {
            particles: particles.clone(),
            rows: system.dofs().first_row(particles.start)..system.dofs().first_row(particles.end),
            // A contiguous batch has at least two springs; others have four, but for the last of every stretch.
            contiguous: Batches::with_capacity(springs.len() / 2),
            others: Batches::with_capacity(springs.len() / 4 + stretches),
            stretches: Vec::with_capacity(stretches),
        }
    }

    fn add(&mut self, system: &System, stretch: &Stretch) {
        let mut progress = self.stretches.last().copied().unwrap_or_default();
        for &(rows, four) in &stretch.contiguous {
            if let Some(end) = self.end_row(system, &four) {
                progress.rows = progress.rows.max(end);
                self.contiguous.push(ContiguousEnds { rows, by_matrix: 0 }, four);
            }
        }
        for four in &stretch.others {
            if let Some(end) = self.end_row(system, four) {
                progress.rows = progress.rows.max(end);
                // All are multiplied by their matrix until they have numbers.
                let ends = four.map(|p| if p == NO_SPRING { [NO_ROW; 2] } else { [BY_MATRIX, p] });
                self.others.push([ends.map(|[first, _]| first), ends.map(|[_, other]| other)], *four);
            }
        }
        (progress.contiguous, progress.others) = (self.contiguous.batches.len(), self.others.batches.len());
        self.stretches.push(progress);
    }

    /// The row of the part after the last one that these springs end in.
    fn end_row(&self, system: &System, four: &Four) -> Option<usize> {
        let springs = four.iter().filter(|&&position| position != NO_SPRING);
        let ends = springs.flat_map(|&position| pair(system, position));
        let own = ends.filter(|end| self.particles.contains(end) && !system.dofs().rows(*end).is_empty());
        own.max().map(|last| system.dofs().first_row(last + 1) - self.rows.start)
    }

    fn shrink(&mut self) {
        self.contiguous.shrink();
        self.others.shrink();
    }

    /// Recomputes the numbers from the blocks of the active springs, without allocating.
    fn update(&mut self, springs: &Springs) {
        let Springs { system, blocks, sign } = *springs;
        for (batch, four) in self.contiguous.each() {
            batch.ends.by_matrix = 0;
            for (n, &position) in four.iter().enumerate() {
                let streamed = blocks.get(position as usize).map(|block| Streamed::of(block, sign));
                batch.set(n, streamed.flatten());
                if streamed.is_some_and(|streamed| streamed.is_none()) {
                    batch.ends.by_matrix |= 1 << n;
                }
            }
        }
        for (batch, four) in self.others.each() {
            for (n, &position) in four.iter().enumerate() {
                let Some(block) = blocks.get(position as usize) else { continue };
                let mut streamed = Streamed::of(block, sign);
                // A spring that stays streamed keeps its rows: looking them up would take most of the time.
                if streamed.is_none() || batch.ends[0][n] == BY_MATRIX {
                    let rows = streamed.and_then(|_| rows(system, position));
                    (batch.ends[0][n], batch.ends[1][n]) = rows.unwrap_or((BY_MATRIX, position));
                    streamed = streamed.filter(|_| rows.is_some());
                }
                batch.set(n, streamed);
            }
        }
    }
}

/// The first rows of both ends of a spring, if each moves along all axes or is held.
fn rows(system: &System, position: u32) -> Option<(u32, u32)> {
    let [first, other] = ends(system, position).map(|end| row(system, end));
    first.zip(other)
}

/// The first row of a particle that moves along all axes; [`NO_ROW`] for one that is held.
fn row(system: &System, particle: usize) -> Option<u32> {
    match system.dofs().free_axes(particle) {
        Axes::NONE => Some(NO_ROW),
        axes => (axes == Axes::first(system.dimension())).then(|| system.dofs().first_row(particle) as u32),
    }
}

impl<E> Batches<E> {
    fn with_capacity(batches: usize) -> Self {
        Self { batches: Vec::with_capacity(batches), positions: Vec::with_capacity(batches) }
    }

    fn push(&mut self, ends: E, four: Four) {
        self.batches.push(SpringBatch4::new(ends));
        self.positions.push(four);
    }

    fn shrink(&mut self) {
        self.batches.shrink_to_fit();
        self.positions.shrink_to_fit();
    }

    fn each(&mut self) -> impl Iterator<Item = (&mut SpringBatch4<E>, &Four)> {
        self.batches.iter_mut().zip(&self.positions)
    }

    /// Some batches, and as many to be prefetched, `ahead` of them where possible.
    #[inline(always)]
    pub fn with_prefetched(&self, some: Range<usize>, ahead: usize) -> (&[SpringBatch4<E>], &[SpringBatch4<E>]) {
        let first = (some.start + ahead).min(self.batches.len() - some.len());
        (&self.batches[some], &self.batches[first..])
    }

    pub fn positions(&self, batch: usize) -> Four {
        self.positions.get(batch).copied().unwrap_or([NO_SPRING; 4])
    }
}

#[cfg(test)]
mod tests;
