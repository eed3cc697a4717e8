//! Smoothed-aggregation algebraic multigrid as a preconditioner.
//!
//! Block Jacobi needs more iterations the larger a scene and the stiffer: information travels one spring an iteration.
//! Multigrid carries it over all distances at once, and needs a number of iterations that hardly depends on either. It is
//! the method of Vaněk, Mandel and Brezina, "Algebraic multigrid by smoothed aggregation for second and fourth order elliptic
//! problems", Computing 56 (1996), for conjugate gradients on `A = M/dt² − G/dt − K`.
//!
//! **Once a scene.** Particles that can move are the nodes of a graph, springs its edges. Nodes are gathered into aggregates of
//! a dozen or two, these are the nodes of the next level, and so on until few hundred unknowns are left. The sparsity of
//! every level's matrix follows, and all memory is taken then.
//!
//! **Once a matrix.** An aggregate moves like a rigid body: the near-null space of A is that of K, translations and
//! rotations, restricted to the axes that are free. Their orthonormal bases on the aggregates are the columns of the
//! tentative prolongator T; a step of block Jacobi makes it `P = (I − ω D⁻¹A) T`, without weak couplings to other aggregates, see
//! `prolongator::filter`. The next level's matrix is `Pᵀ A P + ε Tᵀ A T`, the second term for motions that P smooths away, see `galerkin`.
//!
//! **Once an iteration**, a cycle from zero: a forward sweep of block Gauss–Seidel, the coarse correction
//! `x += P A_c⁻¹ Pᵀ (b − A x)` by the next level, a backward sweep. On the coarsest level a dense Cholesky factorization. Each level asks
//! the next one once (a V-cycle): asking twice takes the same number of iterations and more time. With M
//! the matrix of the forward sweep and B_c the coarse levels' approximation of A_c⁻¹ a cycle is
//!
//! ```text
//! B = M̄⁻¹ + (I − M⁻ᵀ A) P B_c Pᵀ (I − A M⁻¹),   M̄ = M (M + Mᵀ − A)⁻¹ Mᵀ,
//! ```
//!
//! symmetric, and positive definite when the diagonal blocks and B_c are: whatever P is, whatever age the coarse levels have,
//! and even if A is indefinite. So CG's own test `pᵀAp ≤ 0` stays what it is. Where `Pᵀ A P` is found not to be positive
//! definite A is not either, and the set-up says so.
//!
//! Our choices, beside the method's:
//!
//! | choice | why |
//! |---|---|
//! | graph weighted by k/l0, not by A | aggregates and sparsity do not change from step to step |
//! | Gram matrices for the bases | they take one pass, and show which motions an aggregate does not have |
//! | P without weak couplings, for which others stand in | half of the multiplications of a set-up, a quarter less memory, a cycle in seven eighths of the time; a few more iterations, of falling cloths an eighth to a fifth: work is a tenth less, see `prolongator::filter` |
//! | λ_max(D⁻¹A) = 2, its bound | nothing to estimate, see `prolongator` |
//! | cycle in single precision, coarse matrices computed in double | half the time, the same iterations |
//! | loops compiled for wide vectors, picked at run time | set-up in eight tenths of the time, see `parallel` |
//! | one triangle of each matrix, each block used twice | half the time of a sweep, see `gauss_seidel` |
//! | nodes of a sweep in a room of one domain | all that a sweep takes from memory is the matrix, b, x and r, see `gauss_seidel` |
//! | blocks asked for before they are used | from 10⁵ particles on a cycle in three quarters of the time, see `sparse` |
//! | finest matrix in double precision never stored | recomputing rows from the springs is cheap |
//! | the smoother's domains depend on size alone | the same bits for any number of threads |
//! | rows at their borders resist what their springs resist | motions across a cloth stay smoothed, see `gauss_seidel::border` |
//!
//! Where scenes move, coarse levels age: a step of a falling cloth is enough to double the iterations. `linear::lagged_multigrid` makes them anew
//! when their age has cost as much as that.
//!
//! Under `axial` A has soft motions that are not rigid: all those that stretch no spring. The stiffer, the more iterations
//! they cost.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `multigrid`.

mod aggregate;
mod block;
mod coarsest;
mod finest;
mod galerkin;
mod gauss_seidel;
mod graph;
mod modes;
mod parallel;
mod parts;
mod prolongator;
mod sparse;
mod stage;

use crate::error::Result;
use crate::memory;
use crate::operator::SystemOperator;
use crate::system::{Dof, System};
use finest::{Finest, near_one};
use nalgebra::Vector3;
use parallel::largest;
pub use parts::Part;
use parts::SpringVisitor;
use stage::{NotPositiveDefinite, Stage};

/// Unknowns that are solved for directly: a dense factorization of this order takes a few milliseconds.
const LARGEST_DENSE: usize = 400;

/// Bytes that all levels and their making hold at most for a spring and for a particle. Found by lowering the limit on memory until
/// a run failed.
const SPRING: u64 = 500;
const PARTICLE: u64 = 3000;

fn bytes_at_most(springs: u64, particles: u64) -> u64 {
    SPRING * springs + PARTICLE * particles
}

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
        /// A coordinate of one of the particles in the aggregate at which it showed.
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
/// multigrid.place(&state.positions);
/// multigrid.refill(&a)?;
/// multigrid.rebuild(&a)?;
/// let (r, mut z) = (vec![1.0; system.dofs().len()], vec![0.0; system.dofs().len()]);
/// multigrid.apply(&r, &mut z); // about A⁻¹ r
/// assert!(z.iter().zip(&r).map(|(z, r)| z * r).sum::<f64>() > 0.0);
/// assert!(multigrid.levels().len() > 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
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
        Self::down_to(system, LARGEST_DENSE)
    }

    /// As [`new`](Self::new), with levels down to one of at most `largest_dense` unknowns, which is solved directly.
    ///
    /// # Errors
    /// More matrix blocks than 32-bit indices can count.
    pub fn down_to(system: &System, largest_dense: usize) -> Result<Self> {
        let [springs, particles] = [system.active_springs().len() as u64, system.particles() as u64];
        memory::ensure_with_dense_products(bytes_at_most(springs, particles), "multigrid")?;
        Ok(Self(match system.dimension() {
            1 => Dimension::Line(Hierarchy::new(system, largest_dense)?),
            2 => Dimension::Plane(Hierarchy::new(system, largest_dense)?),
            _ => Dimension::Space(Hierarchy::new(system, largest_dense)?),
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
        self.rebuild_watched(a, &mut |_| ())
    }

    /// As [`rebuild`](Self::rebuild), and says after every part that it is done.
    ///
    /// # Errors
    /// As [`rebuild`](Self::rebuild).
    pub fn rebuild_watched(&mut self, a: &SystemOperator, done: &mut dyn FnMut(Part)) -> Result<(), SetupFailure> {
        hierarchy!(&mut self.0, h => h.rebuild(a, done))
    }

    /// `z = B r`, reduced vectors, B symmetric positive definite: one V-cycle.
    pub fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        self.apply_watched(r, z, &mut |_| ());
    }

    /// As [`apply`](Self::apply), and says after every part that it is done.
    pub fn apply_watched(&mut self, r: &[f64], z: &mut [f64], done: &mut dyn FnMut(Part)) {
        hierarchy!(&mut self.0, h => h.apply(r, z, done));
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
    fn new(system: &System, largest_dense: usize) -> Result<Self> {
        let (finest, graph) = Finest::new(system)?;
        let stage = Stage::new(&finest.pattern, &graph, largest_dense)?;
        let zeros = || vec![[0.0; D]; finest.pattern.rows()];
        let (right_hand_side, solution) = (zeros(), zeros());
        Ok(Self { finest, stage, factor: 1.0, right_hand_side, solution })
    }

    fn refill(&mut self, a: &SystemOperator) -> Result<(), SetupFailure> {
        let Self { finest, stage, factor, .. } = self;
        *factor = finest.factor(a);
        stage.update_smoother(&finest.rows(a), *factor).map_err(|refusal| self.explain(a, refusal))
    }

    fn rebuild(&mut self, a: &SystemOperator, done: SpringVisitor) -> Result<(), SetupFailure> {
        let Self { finest, stage, factor, .. } = self;
        stage.update_coarse(&finest.rows(a), *factor, finest, done).map_err(|refusal| self.explain(a, refusal))
    }

    /// A pivot that is not positive means an indefinite matrix only if the matrix is finite.
    fn explain(
        &self,
        a: &SystemOperator,
        NotPositiveDefinite { level, node, pivot }: NotPositiveDefinite,
    ) -> SetupFailure {
        let mut coefficients = a.blocks().iter().flat_map(|block| [block.axial, block.transverse]);
        let has_finite = |block: &nalgebra::Matrix3<f64>| block.iter().all(|entry| entry.is_finite());
        if !a.mass_factor().is_finite() || !a.external().iter().all(has_finite) || !coefficients.all(f64::is_finite) {
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
    fn apply(&mut self, r: &[f64], z: &mut [f64], done: SpringVisitor) {
        if [r.len(), z.len()] != [self.finest.unknowns(); 2] {
            return z.fill(f64::NAN);
        }
        let Self { finest, stage, factor, right_hand_side, solution } = self;
        let scale = near_one(largest(r));
        finest.gather(r, scale, right_hand_side);
        done(Part::Conversion);
        stage.apply(right_hand_side, solution, done);
        finest.scatter(solution, *factor / scale, z);
        done(Part::Conversion);
    }

    fn bytes(&self) -> usize {
        self.finest.bytes()
            + self.stage.bytes()
            + size_of_val(&self.right_hand_side[..])
            + size_of_val(&self.solution[..])
    }
}

#[cfg(test)]
mod tests;
