//! Smoothed-aggregation algebraic multigrid as a preconditioner.

mod aggregate;
mod block;
mod coarsest;
mod finest;
mod galerkin;
mod gauss_seidel;
mod graph;
mod modes;
mod order;
mod parallel;
mod prolongator;
mod sparse;
mod stage;

use crate::error::Result;
use crate::operator::SystemOperator;
use crate::system::{Dof, System};
use finest::{Finest, near_one};
use nalgebra::Vector3;
use stage::{Refusal, Stage};

/// Size of one level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LevelSize {
    /// Particles, or aggregates of them.
    pub nodes: usize,
    /// Order of the level's matrix.
    pub unknowns: usize,
    /// Entries of the level's matrix, both triangles.
    pub entries: usize,
}

/// Why there is no preconditioner for a matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SetupFailure {
    /// The diagonal block of a particle is not positive definite, so A is not.
    DiagonalBlock(Dof),
    /// The factorization of a small A met a pivot that is not positive at this coordinate or another of its particle.
    Pivot(Dof),
    /// The matrix of a coarse level, `Pᵀ A P`, is not positive definite, so A is not.
    CoarseLevel {
        /// The level, from 1.
        level: usize,
        /// A coordinate of one of the particles in the aggregate at which it showed.
        dof: Dof,
    },
    /// The matrix has an infinite or undefined entry.
    NonFinite,
}

/// A multigrid preconditioner for a system's A.
#[derive(Debug)]
pub struct Multigrid(Dimension);

#[derive(Debug)]
enum Dimension {
    Line(Hierarchy<1, 1>),
    Plane(Hierarchy<2, 3>),
    Space(Hierarchy<3, 6>),
}

/// Calls a method of the hierarchy, whatever its dimension.
macro_rules! hierarchy {
    ($multigrid:expr, $hierarchy:ident => $call:expr) => {
        match $multigrid {
            Dimension::Line($hierarchy) => $call,
            Dimension::Plane($hierarchy) => $call,
            Dimension::Space($hierarchy) => $call,
        }
    };
}

impl Multigrid {
    /// Orders, aggregates, and finds the sparsity of every level: all that does not depend on numbers, and all memory.
    ///
    /// # Errors
    /// More matrix blocks than 32-bit indices can count.
    pub fn new(system: &System) -> Result<Self> {
        Ok(Self(match system.dimension() {
            1 => Dimension::Line(Hierarchy::new(system)?),
            2 => Dimension::Plane(Hierarchy::new(system)?),
            _ => Dimension::Space(Hierarchy::new(system)?),
        }))
    }

    /// Says where the particles are, in m: [`rebuild`](Self::rebuild) makes its rotations about these places. Without it
    /// the preconditioner knows of translations only, and is slower.
    pub fn place(&mut self, positions: &[Vector3<f64>]) {
        hierarchy!(&mut self.0, h => h.finest.place(positions));
    }

    /// Takes over a matrix on the finest level, and leaves the coarse ones as they are: they may lag behind as long as
    /// conjugate gradients do not mind.
    ///
    /// # Errors
    /// When A is seen not to be positive definite, or not finite.
    pub fn refill(&mut self, a: &SystemOperator) -> Result<(), SetupFailure> {
        hierarchy!(&mut self.0, h => h.refill(a))
    }

    /// Recomputes the coarse levels for the matrix of the last [`refill`](Self::refill), which must be given again.
    ///
    /// # Errors
    /// When A is seen not to be positive definite, or not finite.
    pub fn rebuild(&mut self, a: &SystemOperator) -> Result<(), SetupFailure> {
        hierarchy!(&mut self.0, h => h.rebuild(a))
    }

    /// `z = B r`, reduced vectors, B symmetric positive definite: one V-cycle.
    pub fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        hierarchy!(&mut self.0, h => h.apply(r, z));
    }

    /// The levels, from the finest.
    pub fn levels(&self) -> Vec<LevelSize> {
        hierarchy!(&self.0, h => h.stage.sizes(&h.finest.pattern))
    }

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        hierarchy!(&self.0, h => h.bytes())
    }
}

/// All levels, with D axes a particle and M rigid motions.
#[derive(Debug)]
struct Hierarchy<const D: usize, const M: usize> {
    finest: Finest<D>,
    stage: Stage<D, M>,
    /// The levels hold `factor·A`.
    factor: f64,
    right_hand_side: Vec<[f32; D]>,
    solution: Vec<[f32; D]>,
}

impl<const D: usize, const M: usize> Hierarchy<D, M> {
    fn new(system: &System) -> Result<Self> {
        let (finest, graph) = Finest::new(system)?;
        let stage = Stage::new(&finest.pattern, &graph)?;
        let zeros = || vec![[0.0; D]; finest.pattern.rows()];
        let (right_hand_side, solution) = (zeros(), zeros());
        Ok(Self { finest, stage, factor: 1.0, right_hand_side, solution })
    }

    fn refill(&mut self, a: &SystemOperator) -> Result<(), SetupFailure> {
        let Self { finest, stage, factor, .. } = self;
        *factor = finest.factor(a);
        stage.update_smoother(&finest.rows(a), *factor).map_err(|refusal| self.explain(a, refusal))
    }

    fn rebuild(&mut self, a: &SystemOperator) -> Result<(), SetupFailure> {
        let Self { finest, stage, factor, .. } = self;
        stage.update_coarse(&finest.rows(a), *factor, finest).map_err(|refusal| self.explain(a, refusal))
    }

    /// A pivot that is not positive means an indefinite matrix only if the matrix is finite.
    fn explain(&self, a: &SystemOperator, Refusal { level, node, pivot }: Refusal) -> SetupFailure {
        if !a.blocks().iter().all(|block| block.axial.is_finite() && block.transverse.is_finite()) {
            return SetupFailure::NonFinite;
        }
        let axis = pivot.filter(|_| level == 0).map(|bad| bad.index);
        let dof = self.finest.dof(self.stage.member(level, node), axis);
        match pivot {
            Some(bad) if !bad.pivot.is_finite() => SetupFailure::NonFinite,
            Some(_) if level == 0 => SetupFailure::DiagonalBlock(dof),
            None if level == 0 => SetupFailure::Pivot(dof),
            _ => SetupFailure::CoarseLevel { level, dof },
        }
    }

    /// Powers of two keep the numbers of the cycle within single precision, and are exact.
    fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        let Self { finest, stage, factor, right_hand_side, solution } = self;
        let scale = near_one(r.iter().fold(0.0, |largest, r| f64::max(largest, r.abs())));
        finest.gather(r, scale, right_hand_side);
        stage.apply(right_hand_side, solution);
        finest.scatter(solution, *factor / scale, z);
    }

    fn bytes(&self) -> usize {
        self.finest.bytes()
            + self.stage.bytes()
            + size_of_val(&self.right_hand_side[..])
            + size_of_val(&self.solution[..])
    }
}
