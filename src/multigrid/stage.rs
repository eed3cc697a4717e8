//! A level and what is below it: set-up, and the V-cycle.

use super::LevelSize;
use super::aggregate::Aggregates;
use super::block::BadPivot;
use super::coarsest::{BadRow, Dense};
use super::galerkin::Galerkin;
use super::gauss_seidel::{BadBlock, GaussSeidel};
use super::graph::Graph;
use super::modes::Frame;
use super::prolongator::{LargestEigenvalue, Prolongator};
use super::sparse::{BlockMatrix, Pattern};
use crate::error::Result;

/// Unknowns that are solved for directly: a dense factorization of this order takes a few milliseconds.
const LARGEST_DENSE: usize = 400;

/// ω λ_max: one step of Jacobi, `1 − ω λ`, is then at most 1/3 in the upper three quarters of the spectrum.
const DAMPING: f64 = 4.0 / 3.0;

/// A matrix and how it is solved, approximately.
#[derive(Debug)]
pub(super) enum Stage<const N: usize, const M: usize> {
    /// Small enough for a factorization.
    Direct(Dense),
    /// Smoothing, and a correction from the next stage.
    Coarsen(Box<Level<N, M>>),
    /// Smoothing is exact: no two nodes are coupled.
    Uncoupled(GaussSeidel<N>),
}

/// A level with its coarse one.
#[derive(Debug)]
pub(super) struct Level<const N: usize, const M: usize> {
    smoother: GaussSeidel<N>,
    prolongator: Prolongator<N, M>,
    eigenvalue: LargestEigenvalue<N>,
    galerkin: Galerkin<N, M>,
    frames: Vec<Frame<M, M>>,
    residual: Vec<[f64; N]>,
    coarse_residual: Vec<[f64; M]>,
    correction: Vec<[f64; M]>,
    next: Stage<M, M>,
}

/// A node at which a set-up found its level's matrix not to be positive definite, or not finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Refusal {
    /// 0 is the finest level.
    pub level: usize,
    pub node: usize,
    /// The unknown of the node and its pivot, where known.
    pub pivot: Option<BadPivot>,
}

impl<const N: usize, const M: usize> Stage<N, M> {
    /// Aggregates and patterns of this level and all below.
    ///
    /// # Errors
    /// More blocks than 32-bit indices can count.
    pub fn new(a: &Pattern, graph: &Graph) -> Result<Self> {
        if a.rows() * N <= LARGEST_DENSE {
            return Ok(Self::Direct(Dense::new(a.rows() * N)));
        }
        let aggregates = Aggregates::of(graph);
        let smoother = GaussSeidel::new(a.rows());
        if aggregates.count() == 0 {
            return Ok(Self::Uncoupled(smoother));
        }
        let coarse_graph = graph.quotient(aggregates.count(), |node| aggregates.of_node(node));
        let prolongator = Prolongator::new(a, aggregates)?;
        let galerkin = Galerkin::new(a, &prolongator)?;
        let next = Stage::new(&galerkin.coarse.pattern, &coarse_graph)?;
        let coarse = prolongator.columns();
        Ok(Self::Coarsen(Box::new(Level {
            smoother,
            eigenvalue: LargestEigenvalue::new(a.rows()),
            frames: prolongator.modes.iter().map(|modes| modes.frame).collect(),
            residual: vec![[0.0; N]; a.rows()],
            coarse_residual: vec![[0.0; M]; coarse],
            correction: vec![[0.0; M]; coarse],
            prolongator,
            galerkin,
            next,
        })))
    }

    /// Recomputes what depends on the numbers of A on this level alone: all but the coarse levels.
    ///
    /// # Errors
    /// A node whose diagonal block is not positive definite; for a factorization, whose pivot is not positive.
    pub fn update_smoother(&mut self, a: &BlockMatrix<N, N>) -> Result<(), Refusal> {
        let smoother = match self {
            Self::Direct(dense) => {
                let refused = |BadRow(node)| Refusal { level: 0, node, pivot: None };
                return dense.update(a).map_err(refused);
            }
            Self::Uncoupled(smoother) => smoother,
            Self::Coarsen(level) => &mut level.smoother,
        };
        smoother.update(a).map_err(|BadBlock { row, bad }| Refusal { level: 0, node: row, pivot: Some(bad) })
    }

    /// Recomputes the coarse levels. Call after [`update_smoother`](Self::update_smoother).
    ///
    /// # Errors
    /// A node of a coarse level at which its matrix is not positive definite: then A is not.
    pub fn update_coarse(&mut self, a: &BlockMatrix<N, N>, frames: &[Frame<N, M>]) -> Result<(), Refusal> {
        let Self::Coarsen(level) = self else { return Ok(()) };
        let Level { smoother, prolongator, eigenvalue, galerkin, frames: coarse_frames, next, .. } = &mut **level;
        let damping = DAMPING / eigenvalue.update(a, &smoother.inverses);
        // The product is computed after the prolongator and lends it its memory.
        prolongator.update(a, &smoother.inverses, damping, frames, &mut galerkin.product.values);
        galerkin.update(a, prolongator);
        for (frame, modes) in coarse_frames.iter_mut().zip(&prolongator.modes) {
            *frame = modes.frame;
        }
        next.update_smoother(&galerkin.coarse)
            .and_then(|()| next.update_coarse(&galerkin.coarse, coarse_frames))
            .map_err(|refusal| Refusal { level: refusal.level + 1, ..refusal })
    }

    /// A particle or node of this level among those that make up a node of a lower one.
    pub fn member(&self, level: usize, node: usize) -> usize {
        match self {
            Self::Coarsen(this) if level > 0 => this.prolongator.member(this.next.member(level - 1, node)),
            _ => node,
        }
    }

    /// `x ≈ A⁻¹ b`: one V-cycle from zero.
    pub fn apply(&mut self, a: &BlockMatrix<N, N>, b: &[[f64; N]], x: &mut [[f64; N]]) {
        match self {
            Self::Direct(dense) => dense.solve(b, x),
            Self::Uncoupled(smoother) => smoother.forward(a, b, x),
            Self::Coarsen(level) => level.cycle(a, b, x),
        }
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
            Self::Uncoupled(smoother) => smoother.bytes(),
            Self::Coarsen(level) => level.bytes(),
        }
    }
}

impl<const N: usize, const M: usize> Level<N, M> {
    fn cycle(&mut self, a: &BlockMatrix<N, N>, b: &[[f64; N]], x: &mut [[f64; N]]) {
        let Self { smoother, prolongator, galerkin, residual, coarse_residual, correction, next, .. } = self;
        smoother.forward(a, b, x);
        smoother.residual(a, x, residual);
        prolongator.restrict(residual, coarse_residual);
        next.apply(&galerkin.coarse, coarse_residual, correction);
        prolongator.prolong(correction, x);
        smoother.backward(a, b, x);
    }

    fn bytes(&self) -> usize {
        self.smoother.bytes()
            + self.prolongator.bytes()
            + self.eigenvalue.bytes()
            + self.galerkin.bytes()
            + size_of_val(&self.frames[..])
            + size_of_val(&self.residual[..])
            + size_of_val(&self.coarse_residual[..])
            + size_of_val(&self.correction[..])
            + self.next.bytes()
    }
}
