//! Consecutive particles and the springs that end in them, four by four.

use super::Springs;
use super::order::{Four, NO_SPRING, Stretch, ends, pair};
use super::quad::{AnyEnds, BY_MATRIX, InARow, NO_ROW, Quad, Streamed};
use crate::system::{Axes, System};
use std::ops::Range;

/// Quads and the positions of their springs.
#[derive(Debug, Clone)]
pub struct Quads<E> {
    pub quads: Vec<Quad<E>>,
    positions: Vec<Four>,
}

/// Consecutive particles and the springs that end in them.
#[derive(Debug, Clone)]
pub struct Part {
    pub rows: Range<usize>,
    pub in_a_row: Quads<InARow>,
    pub others: Quads<AnyEnds>,
    pub stretches: Vec<Reach>,
}

/// How far a part has come after a stretch.
#[derive(Debug, Clone, Copy, Default)]
pub struct Reach {
    /// Quads in a row.
    pub in_a_row: usize,
    /// Other quads.
    pub others: usize,
    /// Rows of the part that have their first term, which they must have before springs are added.
    pub rows: usize,
    /// Rows of the part, from the first, that no spring of a later stretch ends in.
    pub complete: usize,
}

impl Part {
    pub fn new(system: &System, particles: &Range<usize>, stretches: &[Stretch]) -> Self {
        let dofs = system.dofs();
        let rows = dofs.first_row(particles.start)..dofs.first_row(particles.end);
        // From the first row that these springs end in to the one behind the last.
        let own = |four: &Four| {
            let springs = four.iter().filter(|&&position| position != NO_SPRING);
            let ends = springs.flat_map(|&position| pair(system, position));
            let own = ends.filter(|end| particles.contains(end) && !dofs.rows(*end).is_empty());
            let (first, last) = own.fold((usize::MAX, 0), |(first, last), end| (first.min(end), last.max(end)));
            (first <= last).then(|| dofs.first_row(first) - rows.start..dofs.first_row(last + 1) - rows.start)
        };
        let mut part = Self { rows: rows.clone(), in_a_row: Quads::new(), others: Quads::new(), stretches: Vec::new() };
        let mut reach = Reach::default();
        let mut first_rows = Vec::with_capacity(stretches.len());
        for stretch in stretches {
            let mut first_row = rows.len();
            let mut reached = |own: Range<usize>| {
                reach.rows = reach.rows.max(own.end);
                first_row = first_row.min(own.start);
            };
            for &(rows, four) in &stretch.in_a_row {
                if let Some(own) = own(&four) {
                    reached(own);
                    part.in_a_row.push(InARow { rows, by_matrix: 0 }, four);
                }
            }
            for four in &stretch.others {
                if let Some(own) = own(four) {
                    reached(own);
                    part.others.push([[NO_ROW; 4]; 2], *four);
                }
            }
            (reach.in_a_row, reach.others) = (part.in_a_row.quads.len(), part.others.quads.len());
            part.stretches.push(reach);
            first_rows.push(first_row);
        }
        let mut complete = rows.len();
        for (stretch, first_row) in part.stretches.iter_mut().zip(first_rows).rev() {
            stretch.complete = complete.min(stretch.rows);
            complete = complete.min(first_row);
        }
        part.in_a_row.shrink();
        part.others.shrink();
        part
    }

    /// Recomputes the numbers from the blocks of the active springs, without allocating.
    pub fn update(&mut self, springs: &Springs) {
        let Springs { system, blocks, sign } = *springs;
        for (quad, four) in self.in_a_row.each() {
            quad.ends.by_matrix = 0;
            for (n, &position) in four.iter().enumerate() {
                let streamed = blocks.get(position as usize).map(|block| Streamed::of(block, sign));
                quad.set(n, streamed.flatten());
                if streamed.is_some_and(|streamed| streamed.is_none()) {
                    quad.ends.by_matrix |= 1 << n;
                }
            }
        }
        for (quad, four) in self.others.each() {
            for (n, &position) in four.iter().enumerate() {
                let Some(block) = blocks.get(position as usize) else { continue };
                let [first, other] = ends(system, position).map(|end| row(system, end));
                let rows = first.zip(other);
                let streamed = Streamed::of(block, sign).filter(|_| rows.is_some());
                let (first, other) = rows.filter(|_| streamed.is_some()).unwrap_or((BY_MATRIX, position));
                quad.set(n, streamed);
                (quad.ends[0][n], quad.ends[1][n]) = (first, other);
            }
        }
    }
}

/// Where the rows of a particle that moves along all axes begin; [`NO_ROW`] of one that is held.
fn row(system: &System, particle: usize) -> Option<u32> {
    match system.dofs().free_axes(particle) {
        Axes::NONE => Some(NO_ROW),
        // Rows are numbered in 32 bits.
        axes => (axes == Axes::first(system.dimension())).then(|| system.dofs().first_row(particle) as u32),
    }
}

impl<E> Quads<E> {
    fn new() -> Self {
        Self { quads: Vec::new(), positions: Vec::new() }
    }

    fn push(&mut self, ends: E, four: Four) {
        self.quads.push(Quad::new(ends));
        self.positions.push(four);
    }

    fn shrink(&mut self) {
        self.quads.shrink_to_fit();
        self.positions.shrink_to_fit();
    }

    fn each(&mut self) -> impl Iterator<Item = (&mut Quad<E>, &Four)> {
        self.quads.iter_mut().zip(&self.positions)
    }

    /// Some quads, and as many, `ahead` of them, as far as there are any: some of these may be quads that have been already.
    #[inline(always)]
    pub fn with_those_ahead(&self, some: Range<usize>, ahead: usize) -> (&[Quad<E>], &[Quad<E>]) {
        let first = (some.start + ahead).min(self.quads.len() - some.len());
        (&self.quads[some], &self.quads[first..])
    }

    /// The positions of the springs of a quad.
    pub fn positions(&self, quad: usize) -> Four {
        self.positions.get(quad).copied().unwrap_or([NO_SPRING; 4])
    }
}
