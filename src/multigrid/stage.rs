//! A level and what is below it: set-up, and the V-cycle.

use super::LevelSize;
use super::aggregate::Aggregates;
use super::block::BadPivot;
use super::coarsest::{BadRow, Dense};
use super::galerkin::Galerkin;
use super::gauss_seidel::{BadBlock, GaussSeidel};
use super::graph::Graph;
use super::modes::Frames;
use super::parts::{Part, SpringVisitor};
use super::prolongator::Prolongator;
use super::sparse::{Pattern, Rows};
use crate::error::Result;

/// A matrix and how it is solved, approximately.
#[derive(Debug)]
pub(super) enum Stage<const N: usize, const M: usize> {
    /// Small enough for a factorization.
    Direct(Dense),
    /// Smoothing, and a correction from the next stage.
    Coarsen(Box<Level<N, M>>),
    /// Smoothing is exact: no two nodes are coupled.
    Uncoupled(Box<Uncoupled<N>>),
}

/// A level without couplings.
#[derive(Debug)]
pub(super) struct Uncoupled<const N: usize> {
    smoother: GaussSeidel<N>,
    residual: Vec<[f32; N]>,
}

/// A level with its coarse one.
#[derive(Debug)]
pub(super) struct Level<const N: usize, const M: usize> {
    smoother: GaussSeidel<N>,
    prolongator: Prolongator<N, M>,
    galerkin: Galerkin<N, M>,
    residual: Vec<[f32; N]>,
    coarse_residual: Vec<[f32; M]>,
    correction: Vec<[f32; M]>,
    next: Stage<M, M>,
}

/// A node at which a set-up found its level's matrix not to be positive definite, or not finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NotPositiveDefinite {
    /// 0 is the finest level.
    pub level: usize,
    pub node: usize,
    /// The unknown of the node and its pivot, where known.
    pub pivot: Option<BadPivot>,
}

impl<const N: usize, const M: usize> Stage<N, M> {
    /// Aggregates and patterns of this level and all below, down to one of at most `largest_dense` unknowns.
    ///
    /// # Errors
    /// More blocks than 32-bit indices can count.
    pub fn new(a: &Pattern, graph: &Graph, largest_dense: usize) -> Result<Self> {
        let rows = a.rows();
        if rows * N <= largest_dense {
            return Ok(Self::Direct(Dense::new(rows * N)));
        }
        let aggregates = Aggregates::of(graph);
        let smoother = GaussSeidel::new(a)?;
        if aggregates.count() == 0 {
            return Ok(Self::Uncoupled(Box::new(Uncoupled { smoother, residual: vec![[0.0; N]; rows] })));
        }
        let coarse_graph = graph.quotient(aggregates.count(), |node| aggregates.of_node(node));
        let prolongator = Prolongator::new(a, graph, aggregates)?;
        let galerkin = Galerkin::new(a, &prolongator)?;
        let next = Stage::new(&galerkin.coarse.pattern, &coarse_graph, largest_dense)?;
        let coarse = prolongator.columns();
        Ok(Self::Coarsen(Box::new(Level {
            smoother,
            prolongator,
            galerkin,
            residual: vec![[0.0; N]; rows],
            coarse_residual: vec![[0.0; M]; coarse],
            correction: vec![[0.0; M]; coarse],
            next,
        })))
    }

    /// Takes over `factor·A` on this level alone.
    ///
    /// # Errors
    /// A node whose diagonal block is not positive definite; for a factorization, whose pivot is not positive.
    pub fn update_smoother(&mut self, a: &impl Rows<N>, factor: f64) -> Result<(), NotPositiveDefinite> {
        let smoother = match self {
            Self::Direct(dense) => {
                let refused = |BadRow(node)| NotPositiveDefinite { level: 0, node, pivot: None };
                return dense.update(a, factor).map_err(refused);
            }
            Self::Uncoupled(level) => &mut level.smoother,
            Self::Coarsen(level) => &mut level.smoother,
        };
        smoother.update(a, factor).map_err(|BadBlock { row, bad }| NotPositiveDefinite {
            level: 0,
            node: row,
            pivot: Some(bad),
        })
    }

    /// Recomputes the coarse levels. Call after [`update_smoother`](Self::update_smoother).
    ///
    /// # Errors
    /// A node of a coarse level at which its matrix is not positive definite: then A is not.
    pub fn update_coarse(
        &mut self,
        a: &impl Rows<N>,
        factor: f64,
        frames: &(impl Frames<N, M> + ?Sized),
        done: SpringVisitor,
    ) -> Result<(), NotPositiveDefinite> {
        let Self::Coarsen(level) = self else { return Ok(()) };
        let Level { smoother, prolongator, galerkin, next, .. } = &mut **level;
        prolongator.update(a, factor, smoother, frames);
        done(Part::Prolongator);
        galerkin.update(a, prolongator);
        done(Part::CoarseMatrix);
        let below = next
            .update_smoother(&galerkin.coarse, factor)
            .and_then(|()| next.update_coarse(&galerkin.coarse, factor, &prolongator.modes[..], &mut |_| ()))
            .map_err(|refusal| NotPositiveDefinite { level: refusal.level + 1, ..refusal });
        done(Part::CoarseSetup);
        below
    }

    /// A particle or node of this level among those that make up a node of a lower one.
    pub fn member(&self, level: usize, node: usize) -> usize {
        match self {
            Self::Coarsen(this) if level > 0 => this.prolongator.member(this.next.member(level - 1, node)),
            _ => node,
        }
    }

    /// `x ≈ (factor·A)⁻¹ b`: one V-cycle from zero.
    pub fn apply(&mut self, b: &[[f32; N]], x: &mut [[f32; N]], done: SpringVisitor) {
        match self {
            Self::Direct(dense) => dense.solve(b, x),
            Self::Uncoupled(level) => level.smoother.forward(b, x, &mut level.residual),
            Self::Coarsen(level) => return level.cycle(b, x, done),
        }
        done(Part::Smoothing);
    }

    /// Sizes of this level and all below.
    pub fn sizes(&self, a: &Pattern) -> Vec<LevelSize> {
        let mut sizes = vec![LevelSize { nodes: a.rows(), unknowns: a.rows() * N, entries: a.blocks() * N * N }];
        if let Self::Coarsen(level) = self {
            sizes.extend(level.next.sizes(&level.galerkin.coarse.pattern));
        }
        sizes
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Direct(dense) => dense.bytes(),
            Self::Uncoupled(level) => level.smoother.bytes() + size_of_val(&level.residual[..]),
            Self::Coarsen(level) => level.bytes(),
        }
    }
}

impl<const N: usize, const M: usize> Level<N, M> {
    fn cycle(&mut self, b: &[[f32; N]], x: &mut [[f32; N]], done: SpringVisitor) {
        let Self { smoother, prolongator, residual, coarse_residual, correction, next, .. } = self;
        smoother.forward(b, x, residual);
        done(Part::Smoothing);
        prolongator.restrict(residual, coarse_residual);
        done(Part::Transfer);
        next.apply(coarse_residual, correction, &mut |_| ());
        done(Part::CoarseLevels);
        prolongator.prolong(correction, x);
        done(Part::Transfer);
        smoother.backward(b, x);
        done(Part::Smoothing);
    }

    fn bytes(&self) -> usize {
        self.smoother.bytes()
            + self.prolongator.bytes()
            + self.galerkin.bytes()
            + size_of_val(&self.residual[..])
            + size_of_val(&self.coarse_residual[..])
            + size_of_val(&self.correction[..])
            + self.next.bytes()
    }
}

#[cfg(test)]
mod tests;
