//! Consecutive particles and the springs that end in them, four by four.

use super::Springs;
use super::batch4::{AnyEnds, BY_MATRIX, InARow, NO_ROW, SpringBatch4, Streamed};
use super::order::{self, Four, NO_SPRING, Stretch, ends, pair};
use crate::system::{Axes, System, ThreadPartition};
use std::ops::Range;

/// Quads and the positions of their springs.
#[derive(Debug, Clone)]
pub struct Quads<E> {
    pub quads: Vec<SpringBatch4<E>>,
    positions: Vec<Four>,
}

/// Consecutive particles and the springs that end in them.
#[derive(Debug, Clone)]
pub struct Part {
    pub rows: Range<usize>,
    pub contiguous: Quads<InARow>,
    pub others: Quads<AnyEnds>,
    pub stretches: Vec<Progress>,
}

/// How far a part has come after a stretch.
#[derive(Debug, Clone, Copy, Default)]
pub struct Progress {
    /// Quads in a row.
    pub contiguous: usize,
    /// Other quads.
    pub others: usize,
    /// Rows of the part that have their first term, which they must have before springs are added.
    pub rows: usize,
}

/// A part to which the springs of one stretch after the other are added.
pub struct Growing<'a> {
    system: &'a System,
    particles: Range<usize>,
    part: Part,
}

impl<'a> Growing<'a> {
    /// Without springs, and with room for all that can end in these particles: lists that grow leave holes in the memory.
    pub fn new(system: &'a System, ThreadPartition { particles, springs }: &ThreadPartition) -> Self {
        let rows = system.dofs().first_row(particles.start)..system.dofs().first_row(particles.end);
        let stretches = order::most_stretches(system);
        // At least two springs in a row are a quad; others are four by four, but for the last of every stretch.
        let contiguous = Quads::with_capacity(springs.len() / 2);
        let others = Quads::with_capacity(springs.len() / 4 + stretches);
        let part = Part { rows, contiguous, others, stretches: Vec::with_capacity(stretches) };
        Self { system, particles: particles.clone(), part }
    }

    /// Adds those springs of a stretch that end in these particles.
    pub fn add(&mut self, stretch: &Stretch) {
        let mut reach = self.part.stretches.last().copied().unwrap_or_default();
        for &(rows, four) in &stretch.contiguous {
            if let Some(own) = self.own(&four) {
                reach.rows = reach.rows.max(own);
                self.part.contiguous.push(InARow { rows, by_matrix: 0 }, four);
            }
        }
        for four in &stretch.others {
            if let Some(own) = self.own(four) {
                reach.rows = reach.rows.max(own);
                // All go through their matrix until they have numbers.
                let ends = four.map(|p| if p == NO_SPRING { [NO_ROW; 2] } else { [BY_MATRIX, p] });
                self.part.others.push([ends.map(|[first, _]| first), ends.map(|[_, other]| other)], *four);
            }
        }
        (reach.contiguous, reach.others) = (self.part.contiguous.quads.len(), self.part.others.quads.len());
        self.part.stretches.push(reach);
    }

    /// The row of the part behind the last one that these springs end in.
    fn own(&self, four: &Four) -> Option<usize> {
        let dofs = self.system.dofs();
        let springs = four.iter().filter(|&&position| position != NO_SPRING);
        let ends = springs.flat_map(|&position| pair(self.system, position));
        let own = ends.filter(|end| self.particles.contains(end) && !dofs.rows(*end).is_empty());
        own.max().map(|last| dofs.first_row(last + 1) - self.part.rows.start)
    }

    /// The part, when all stretches have been added.
    pub fn finish(self) -> Part {
        let mut part = self.part;
        part.contiguous.shrink();
        part.others.shrink();
        part
    }
}

impl Part {
    /// Recomputes the numbers from the blocks of the active springs, without allocating.
    pub fn update(&mut self, springs: &Springs) {
        let Springs { system, blocks, sign } = *springs;
        for (quad, four) in self.contiguous.each() {
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
                let mut streamed = Streamed::of(block, sign);
                // What was streamed, and is, keeps its rows: to look them up takes longer than all the rest.
                if streamed.is_none() || quad.ends[0][n] == BY_MATRIX {
                    let rows = streamed.and_then(|_| rows(system, position));
                    (quad.ends[0][n], quad.ends[1][n]) = rows.unwrap_or((BY_MATRIX, position));
                    streamed = streamed.filter(|_| rows.is_some());
                }
                quad.set(n, streamed);
            }
        }
    }
}

/// Where the rows of both ends of a spring begin, if each moves along all axes or is held.
fn rows(system: &System, position: u32) -> Option<(u32, u32)> {
    let [first, other] = ends(system, position).map(|end| row(system, end));
    first.zip(other)
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
    fn with_capacity(quads: usize) -> Self {
        Self { quads: Vec::with_capacity(quads), positions: Vec::with_capacity(quads) }
    }

    fn push(&mut self, ends: E, four: Four) {
        self.quads.push(SpringBatch4::new(ends));
        self.positions.push(four);
    }

    fn shrink(&mut self) {
        self.quads.shrink_to_fit();
        self.positions.shrink_to_fit();
    }

    fn each(&mut self) -> impl Iterator<Item = (&mut SpringBatch4<E>, &Four)> {
        self.quads.iter_mut().zip(&self.positions)
    }

    /// Some quads, and as many, `ahead` of them, as far as there are any: some of these may be quads that have been already.
    #[inline(always)]
    pub fn with_those_ahead(&self, some: Range<usize>, ahead: usize) -> (&[SpringBatch4<E>], &[SpringBatch4<E>]) {
        let first = (some.start + ahead).min(self.quads.len() - some.len());
        (&self.quads[some], &self.quads[first..])
    }

    /// The positions of the springs of a quad.
    pub fn positions(&self, quad: usize) -> Four {
        self.positions.get(quad).copied().unwrap_or([NO_SPRING; 4])
    }
}
