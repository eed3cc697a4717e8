//! A level and those below it: set-up, and the V-cycle.

use super::LevelSize;
use super::aggregate::{Aggregates, Graph};
use super::block::BadPivot;
use super::galerkin::Galerkin;
use super::gauss_seidel::GaussSeidel;
use super::modes::Frames;
use super::prolongator::Prolongator;
use super::sparse::{Pattern, Rows};
use crate::error::Result;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::mat::{MatMut, MatRef};
use faer::{Conj, Par, Spec};

#[derive(Debug)]
pub(super) enum Level<const N: usize, const M: usize> {
    /// Small enough for a factorization.
    Direct(Dense),
    /// Smoothing, and a correction from the next level.
    Smoothed(Box<Smoothed<N, M>>),
}

#[derive(Debug)]
pub(super) struct Smoothed<const N: usize, const M: usize> {
    smoother: GaussSeidel<N>,
    residual: Vec<[f32; N]>,
    /// `None` where no two nodes are coupled: smoothing is then exact.
    coarse: Option<Coarse<N, M>>,
}

#[derive(Debug)]
struct Coarse<const N: usize, const M: usize> {
    prolongator: Prolongator<N, M>,
    galerkin: Galerkin<N, M>,
    residual: Vec<[f32; M]>,
    correction: Vec<[f32; M]>,
    level: Level<M, M>,
}

/// A node at which a level's matrix was found not to be positive definite, or not finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NotPositiveDefinite {
    /// 0 is the finest level.
    pub level: usize,
    pub node: usize,
    /// The unknown of the node and its pivot, where known.
    pub pivot: Option<BadPivot>,
}

impl<const N: usize, const M: usize> Level<N, M> {
    /// Aggregates and patterns of this level and all below, down to one of at most `largest_dense` unknowns.
    pub fn new(a: &Pattern, graph: &Graph, largest_dense: usize) -> Result<Self> {
        let rows = a.rows();
        if rows * N <= largest_dense {
            return Ok(Self::Direct(Dense::new(rows * N)));
        }
        let aggregates = Aggregates::new(graph);
        let (smoother, count) = (GaussSeidel::new(a)?, aggregates.count());
        let mut coarse = None;
        if count > 0 {
            let coarse_graph = graph.quotient(count, |node| aggregates.of_node(node));
            let prolongator = Prolongator::new(a, graph, aggregates)?;
            let galerkin = Galerkin::new(a, &prolongator)?;
            let level = Level::new(&galerkin.coarse.pattern, &coarse_graph, largest_dense)?;
            let zeros = || vec![[0.0; M]; count];
            coarse = Some(Coarse { prolongator, galerkin, residual: zeros(), correction: zeros(), level });
        }
        Ok(Self::Smoothed(Box::new(Smoothed { smoother, residual: vec![[0.0; N]; rows], coarse })))
    }

    /// Sets `factor·A` on this level alone.
    pub fn update_smoother(&mut self, a: &impl Rows<N>, factor: f64) -> Result<(), NotPositiveDefinite> {
        let failure = |node, pivot| NotPositiveDefinite { level: 0, node, pivot };
        match self {
            Self::Direct(dense) => dense.update(a, factor).map_err(|node| failure(node, None)),
            Self::Smoothed(level) => level.smoother.update(a, factor).map_err(|(row, bad)| failure(row, Some(bad))),
        }
    }

    fn coarse(&self) -> Option<&Coarse<N, M>> {
        match self {
            Self::Direct(_) => None,
            Self::Smoothed(level) => level.coarse.as_ref(),
        }
    }

    /// Recomputes the coarse levels. Call after [`update_smoother`](Self::update_smoother).
    pub fn update_coarse(
        &mut self,
        a: &impl Rows<N>,
        factor: f64,
        frames: &(impl Frames<N, M> + ?Sized),
    ) -> Result<(), NotPositiveDefinite> {
        let Self::Smoothed(level) = self else { return Ok(()) };
        let Smoothed { smoother, coarse: Some(coarse), .. } = &mut **level else { return Ok(()) };
        let Coarse { prolongator, galerkin, level, .. } = coarse;
        prolongator.update(a, factor, smoother, frames);
        galerkin.update(a, prolongator);
        level
            .update_smoother(&galerkin.coarse, factor)
            .and_then(|()| level.update_coarse(&galerkin.coarse, factor, &prolongator.modes[..]))
            .map_err(|failure| NotPositiveDefinite { level: failure.level + 1, ..failure })
    }

    /// A node of this level among those that make up a node of a lower one.
    pub fn member(&self, level: usize, node: usize) -> usize {
        match self.coarse() {
            Some(coarse) if level > 0 => coarse.prolongator.member(coarse.level.member(level - 1, node)),
            _ => node,
        }
    }

    /// `x ≈ (factor·A)⁻¹ b`: one V-cycle from zero.
    pub fn apply(&mut self, b: &[[f32; N]], x: &mut [[f32; N]]) {
        let level = match self {
            Self::Direct(dense) => return dense.solve(b, x),
            Self::Smoothed(level) => level,
        };
        let Smoothed { smoother, residual, coarse } = &mut **level;
        smoother.forward(b, x, residual);
        if let Some(Coarse { prolongator, residual: coarse_residual, correction, level, .. }) = coarse {
            prolongator.restrict(residual, coarse_residual);
            level.apply(coarse_residual, correction);
            prolongator.prolong(correction, x);
            smoother.backward(b, x);
        }
    }

    pub fn sizes(&self, a: &Pattern) -> Vec<LevelSize> {
        let mut sizes = vec![LevelSize { nodes: a.rows(), unknowns: a.rows() * N, entries: a.blocks() * N * N }];
        if let Some(coarse) = self.coarse() {
            sizes.extend(coarse.level.sizes(&coarse.galerkin.coarse.pattern));
        }
        sizes
    }
}

/// A dense Cholesky factor by faer, with its memory.
pub(super) struct Dense {
    order: usize,
    factor: Vec<f64>,
    solution: Vec<f64>,
    memory: MemBuffer,
}

impl Dense {
    pub fn new(order: usize) -> Self {
        let scratch = llt::factor::cholesky_in_place_scratch::<f64>(order, Par::Seq, Spec::default())
            .or(llt::solve::solve_in_place_scratch::<f64>(order, 1, Par::Seq));
        let memory = MemBuffer::new(scratch);
        Self { order, factor: vec![0.0; order * order], solution: vec![0.0; order], memory }
    }

    pub fn update<const N: usize>(&mut self, a: &impl Rows<N>, factor: f64) -> std::result::Result<(), usize> {
        let order = self.order;
        let matrix = &mut self.factor;
        matrix.fill(0.0);
        for row in 0..a.pattern().rows() {
            a.visit(row, |column, block| {
                for (r, entries) in block.iter().enumerate() {
                    for (c, entry) in entries.iter().enumerate() {
                        matrix[(column * N + c) * order + row * N + r] = factor * entry;
                    }
                }
            });
        }
        if let Some(at) = matrix.iter().position(|entry| !entry.is_finite()) {
            return Err(at % order / N);
        }
        let factor = MatMut::from_column_major_slice_mut(&mut self.factor, order, order);
        let stack = MemStack::new(&mut self.memory);
        let factored = llt::factor::cholesky_in_place(factor, Default::default(), Par::Seq, stack, Spec::default());
        let last = order.saturating_sub(1);
        factored.map(drop).map_err(|llt::factor::LltError::NonPositivePivot { index }| index.min(last) / N)
    }

    /// `x = (factor·A)⁻¹ b`.
    pub fn solve<const N: usize>(&mut self, b: &[[f32; N]], x: &mut [[f32; N]]) {
        let order = self.order;
        for (double, &b) in self.solution.iter_mut().zip(b.as_flattened()) {
            *double = f64::from(b);
        }
        let factor = MatRef::from_column_major_slice(&self.factor, order, order);
        let solution = MatMut::from_column_major_slice_mut(&mut self.solution, order, 1);
        llt::solve::solve_in_place_with_conj(factor, Conj::No, solution, Par::Seq, MemStack::new(&mut self.memory));
        for (x, &double) in x.as_flattened_mut().iter_mut().zip(&self.solution) {
            *x = double as f32;
        }
    }
}

impl std::fmt::Debug for Dense {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Dense").field("order", &self.order).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests;
