//! A system's M, G, K and A as assembled matrices.

use super::SymmetricMatrix;
use super::fill::Filling;
use super::spring_pattern::SpringPattern;
use super::triplets::{BlockTriplet, assemble};
use crate::error::Result;
use crate::memory;
use crate::operator::SystemOperator;
use nalgebra::Matrix3;
use std::sync::Arc;

/// A system's matrix with the slot map that refills it.
///
/// # Examples
/// ```
/// use sprung::Stiffness;
/// use sprung::assembly::{SpringPattern, SystemMatrix};
/// use sprung::force::Extensions;
/// use sprung::operator::{Combination, SystemOperator};
/// use std::sync::Arc;
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, state) = builder.build()?;
/// // Once: the pattern, and where every spring's block goes.
/// let mut matrix = SystemMatrix::zeros(Arc::new(SpringPattern::of_stiffness(&system)?));
/// // As often as the values change: no search, no sort, no allocation.
/// let extensions = Extensions::at(&system, &state.positions)?;
/// for dt in [0.1, 0.5] {
///     let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(dt));
///     matrix.refill(&a);
/// }
/// assert_eq!(matrix.matrix().values()[0], 4.0 + 10.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct SystemMatrix {
    springs: Arc<SpringPattern>,
    matrix: SymmetricMatrix,
}

impl SystemMatrix {
    /// The zero matrix on a pattern.
    pub fn zeros(springs: Arc<SpringPattern>) -> Self {
        let matrix = SymmetricMatrix::zeros(springs.shared_pattern());
        Self { springs, matrix }
    }

    /// As [`zeros`](Self::zeros), if there is room for it.
    ///
    /// # Errors
    /// [`Error::TooLarge`](crate::Error::TooLarge).
    pub fn try_zeros(springs: Arc<SpringPattern>) -> Result<Self> {
        memory::ensure(8 * springs.pattern().entries() as u64, "the matrix")?;
        Ok(Self::zeros(springs))
    }

    /// The assembled operator, on the pattern that fits its blocks.
    pub fn assemble(springs: Arc<SpringPattern>, operator: &SystemOperator) -> Self {
        let mut matrix = Self::zeros(springs);
        matrix.refill(operator);
        matrix
    }

    /// Recomputes all values from the operator's blocks, without sorting, searching or allocating; in parallel, with the
    /// same bits for any number of threads.
    pub fn refill(&mut self, operator: &SystemOperator) {
        Filling { springs: &self.springs, operator }.fill_all(self.matrix.values_mut());
    }

    /// The matrix.
    pub fn matrix(&self) -> &SymmetricMatrix {
        &self.matrix
    }

    /// Takes the matrix out.
    pub fn into_matrix(self) -> SymmetricMatrix {
        self.matrix
    }
}

/// Assembles an operator afresh, by the simple path: all block triplets, sorted and added up.
///
/// Slow and obvious; [`SystemMatrix::refill`] is held to it bit by bit.
pub fn assemble_afresh(operator: &SystemOperator) -> Vec<super::triplets::MatrixEntry> {
    let system = operator.system();
    let masses = system.masses().iter().enumerate();
    let mass = |(p, m): (usize, &f64)| BlockTriplet {
        row: p,
        column: p,
        block: Matrix3::from_diagonal_element(operator.mass_factor() * m),
    };
    let mut triplets: Vec<BlockTriplet> = masses.map(mass).collect();
    for ((_, [i, j], _), block) in system.active().zip(operator.blocks()) {
        let block = block.matrix();
        triplets.push(BlockTriplet { row: i, column: i, block });
        triplets.push(BlockTriplet { row: j, column: j, block });
        triplets.push(BlockTriplet { row: i, column: j, block: -block });
        triplets.push(BlockTriplet { row: j, column: i, block: -block });
    }
    assemble(system.dofs(), &triplets)
}
