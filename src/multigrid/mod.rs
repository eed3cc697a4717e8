//! Smoothed-aggregation algebraic multigrid as a preconditioner.
//!
//! Block Jacobi carries information one spring an iteration, multigrid over all distances at once, in a number of iterations that hardly depends on
//! the size or the stiffness of a scene. This is the method of Vaněk, Mandel and Brezina, "Algebraic multigrid by smoothed aggregation for second and
//! fourth order elliptic problems", Computing 56 (1996), for conjugate gradients on `A = M/dt² − G/dt − K`.
//!
//! **Once a scene.** Particles that can move are the nodes of a graph, springs its edges. Nodes are gathered into aggregates of a dozen or two, which
//! are the nodes of the next level, and so on until a few hundred unknowns are left. The sparsity of every level's matrix follows, and all memory is
//! allocated.
//!
//! **Once a matrix.** The near-null space of A is that of K: translations and rotations, restricted to the free axes. Their orthonormal bases on the
//! aggregates are the columns of the tentative prolongator T; a step of block Jacobi makes it `P = (I − ω D⁻¹A) T`, without weak couplings to other
//! aggregates, see `prolongator`. The next level's matrix is `Pᵀ A P + ε Tᵀ A T`, the second term for motions that P smooths away, see `galerkin`.
//!
//! **Once an iteration**, a V-cycle from zero: a forward sweep of block Gauss–Seidel, the coarse correction `x += P A_c⁻¹ Pᵀ (b − A x)` by the next
//! level, a backward sweep; on the coarsest level a dense Cholesky factorization. With M the matrix of the forward sweep and B_c the coarse levels'
//! approximation of A_c⁻¹ a cycle is
//!
//! ```text
//! B = M̄⁻¹ + (I − M⁻ᵀ A) P B_c Pᵀ (I − A M⁻¹),   M̄ = M (M + Mᵀ − A)⁻¹ Mᵀ,
//! ```
//!
//! symmetric, and positive definite when the diagonal blocks and B_c are, for any P and any age of the coarse levels, and even if A is indefinite. So
//! CG's own test `pᵀAp ≤ 0` stays valid. If `Pᵀ A P` is not positive definite A is not either, and the set-up reports it.
//!
//! Choices beside the method's: the graph is weighted by k/l0 instead of A, so that aggregates and sparsity never change; a cycle works in single
//! precision on one triangle of each matrix, a set-up in double; the rows of the finest matrix are recomputed from the springs; the smoother's
//! domains depend on size alone, for the same bits with any number of threads.
//!
//! Under `axial` A has soft motions that are not rigid, all those that stretch no spring: the stiffer the springs, the more iterations they cost.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `solvers`.

mod aggregate;
mod block;
mod border;
mod finest;
mod galerkin;
mod gauss_seidel;
mod level;
mod modes;
mod parallel;
mod prolongator;
mod sparse;

use crate::error::Result;
use crate::memory;
use crate::operator::{SystemOperator, dot};
use crate::system::{Dof, System};
use finest::{Finest, near_one};
use level::{Level, NotPositiveDefinite};
use nalgebra::Vector3;

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

/// The failure of a set-up.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SetupFailure {
    /// The diagonal block of a particle is not positive definite, so A is not.
    #[error("the diagonal block at {0} is not positive definite")]
    DiagonalBlock(Dof),
    /// The factorization of a small A met a pivot that is not positive at this coordinate or another of its particle.
    #[error("the pivot of {0}, or of another coordinate of its particle, is not positive")]
    Pivot(Dof),
    /// The matrix of a coarse level, `Pᵀ A P`, is not positive definite, so A is not.
    #[error("the matrix of coarse level {level} is not positive definite near {dof}")]
    CoarseLevel {
        /// The level, from 1.
        level: usize,
        /// A coordinate of a particle in the aggregate that failed.
        dof: Dof,
    },
    /// The matrix has an infinite or undefined entry.
    #[error("the matrix has entries that are not finite")]
    NonFinite,
}

/// A multigrid preconditioner for a system's A.
///
/// # Examples
/// ```
/// use sprung::Stiffness;
/// use sprung::force::SpringGeometry;
/// use sprung::multigrid::Multigrid;
/// use sprung::operator::{Combination, SystemOperator};
///
/// let (system, state) = sprung::scene::builtin::cloth(20)?.build()?;
/// let extensions = SpringGeometry::at(&system, &state.positions)?;
/// let a = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.05));
/// let mut multigrid = Multigrid::new(&system)?;
/// multigrid.set_positions(&state.positions);
/// multigrid.refill(&a)?;
/// multigrid.rebuild(&a)?;
/// let (r, mut z) = (vec![1.0; system.dofs().len()], vec![0.0; system.dofs().len()]);
/// multigrid.apply(&r, &mut z); // about A⁻¹ r
/// assert!(z.iter().zip(&r).map(|(z, r)| z * r).sum::<f64>() > 0.0);
/// assert!(multigrid.levels().len() > 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Multigrid(Box<dyn Cycle>);

/// A hierarchy in one, two or three dimensions.
trait Cycle: std::fmt::Debug + Send + Sync {
    fn set_positions(&mut self, positions: &[Vector3<f64>]);
    fn refill(&mut self, a: &SystemOperator) -> Result<(), SetupFailure>;
    fn rebuild(&mut self, a: &SystemOperator) -> Result<(), SetupFailure>;
    fn apply(&mut self, r: &[f64], z: &mut [f64]);
    fn levels(&self) -> Vec<LevelSize>;
}

impl Multigrid {
    /// Orders, aggregates, finds the sparsity of every level, and allocates all memory.
    ///
    /// # Errors
    /// More matrix blocks than 32-bit indices can count.
    pub fn new(system: &System) -> Result<Self> {
        // A dense factorization of this order takes a few milliseconds.
        Self::down_to(system, 400)
    }

    /// As [`new`](Self::new), with levels down to one of at most `largest_dense` unknowns, which is solved directly.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    pub fn down_to(system: &System, largest_dense: usize) -> Result<Self> {
        let [springs, particles] = [system.active_springs().len() as u64, system.particles() as u64];
        // Bounds found by lowering the limit on memory until a run failed.
        memory::ensure_with_dense_products(500 * springs + 3000 * particles, "multigrid")?;
        Ok(Self(match system.dimension() {
            1 => Box::new(Hierarchy::<1, 1>::new(system, largest_dense)?),
            2 => Box::new(Hierarchy::<2, 3>::new(system, largest_dense)?),
            _ => Box::new(Hierarchy::<3, 6>::new(system, largest_dense)?),
        }))
    }

    /// Sets the positions of all particles, in m, about which [`rebuild`](Self::rebuild) takes rotations. Without them only translations are
    /// represented, and the preconditioner is slower.
    pub fn set_positions(&mut self, positions: &[Vector3<f64>]) {
        self.0.set_positions(positions);
    }

    /// Sets the matrix of the finest level. The coarse levels may lag behind as long as conjugate gradients converge.
    ///
    /// # Errors
    /// When A is found not to be positive definite, or not finite.
    pub fn refill(&mut self, a: &SystemOperator) -> Result<(), SetupFailure> {
        self.0.refill(a)
    }

    /// Recomputes the coarse levels for the matrix of the last [`refill`](Self::refill), which must be given again.
    ///
    /// # Errors
    /// When A is found not to be positive definite, or not finite.
    pub fn rebuild(&mut self, a: &SystemOperator) -> Result<(), SetupFailure> {
        self.0.rebuild(a)
    }

    /// `z = B r`, reduced vectors, B symmetric positive definite: one V-cycle.
    pub fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        self.0.apply(r, z);
    }

    /// The levels, from the finest.
    pub fn levels(&self) -> Vec<LevelSize> {
        self.0.levels()
    }
}

/// All levels, with D axes a particle and M rigid motions.
#[derive(Debug)]
struct Hierarchy<const D: usize, const M: usize> {
    finest: Finest<D>,
    level: Level<D, M>,
    /// The levels hold `factor·A`, a power of two times A with entries near one.
    factor: f64,
    right_hand_side: Vec<[f32; D]>,
    solution: Vec<[f32; D]>,
}

impl<const D: usize, const M: usize> Hierarchy<D, M> {
    fn new(system: &System, largest_dense: usize) -> Result<Self> {
        let (finest, graph) = Finest::new(system)?;
        let level = Level::new(&finest.pattern, &graph, largest_dense)?;
        let zeros = || vec![[0.0; D]; finest.pattern.rows()];
        let (right_hand_side, solution) = (zeros(), zeros());
        Ok(Self { finest, level, factor: 1.0, right_hand_side, solution })
    }

    /// A pivot that is not positive means an indefinite matrix only if the matrix is finite.
    fn failure(&self, a: &SystemOperator, failure: NotPositiveDefinite) -> SetupFailure {
        let NotPositiveDefinite { level, node, pivot } = failure;
        if !a.is_finite() || pivot.is_some_and(|bad| !bad.pivot.is_finite()) {
            return SetupFailure::NonFinite;
        }
        let axis = pivot.filter(|_| level == 0).map(|bad| bad.index);
        let dof = self.finest.dof(self.level.member(level, node), axis);
        match pivot {
            Some(_) if level == 0 => SetupFailure::DiagonalBlock(dof),
            None if level == 0 => SetupFailure::Pivot(dof),
            _ => SetupFailure::CoarseLevel { level, dof },
        }
    }
}

impl<const D: usize, const M: usize> Cycle for Hierarchy<D, M> {
    fn set_positions(&mut self, positions: &[Vector3<f64>]) {
        self.finest.set_positions(positions);
    }

    fn refill(&mut self, a: &SystemOperator) -> Result<(), SetupFailure> {
        let Self { finest, level, factor, .. } = self;
        *factor = finest.factor(a);
        level.update_smoother(&finest.rows(a), *factor).map_err(|failure| self.failure(a, failure))
    }

    fn rebuild(&mut self, a: &SystemOperator) -> Result<(), SetupFailure> {
        let Self { finest, level, factor, .. } = self;
        level.update_coarse(&finest.rows(a), *factor, finest).map_err(|failure| self.failure(a, failure))
    }

    /// Powers of two keep the numbers of the cycle within single precision, and are exact.
    fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        let Self { finest, level, factor, right_hand_side, solution } = self;
        if [r.len(), z.len()] != [finest.unknowns(); 2] {
            return z.fill(f64::NAN);
        }
        let scale = near_one(dot(r, r).sqrt());
        finest.gather(r, scale, right_hand_side);
        level.apply(right_hand_side, solution);
        finest.scatter(solution, *factor / scale, z);
    }

    fn levels(&self) -> Vec<LevelSize> {
        self.level.sizes(&self.finest.pattern)
    }
}

#[cfg(test)]
mod tests;
