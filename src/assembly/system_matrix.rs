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
/// use sprung::force::SpringGeometry;
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
/// let extensions = SpringGeometry::at(&system, &state.positions)?;
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
    let mass = |p| BlockTriplet {
        row: p,
        column: p,
        block: Matrix3::from_diagonal_element(operator.mass_factor() * system.masses()[p]),
    };
    let mut triplets: Vec<BlockTriplet> = (0..system.particles()).map(mass).collect();
    for ((_, [i, j], _), block) in system.active().zip(operator.blocks()) {
        let block = block.matrix();
        triplets.push(BlockTriplet { row: i, column: i, block });
        triplets.push(BlockTriplet { row: j, column: j, block });
        triplets.push(BlockTriplet { row: i, column: j, block: -block });
        triplets.push(BlockTriplet { row: j, column: i, block: -block });
    }
    let external = operator.external().iter().enumerate();
    triplets.extend(external.map(|(p, block)| BlockTriplet { row: p, column: p, block: *block }));
    assemble(system.dofs(), &triplets)
}

#[cfg(test)]
mod tests {
    use super::{SpringPattern, SystemMatrix, assemble_afresh};
    use crate::force::SpringGeometry;
    use crate::operator::{BlockDiagonal, Combination, LinearOperator, SystemOperator};
    use crate::spring::{Spring, Stiffness};
    use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
    use nalgebra::{Matrix3, Vector3};
    use std::sync::Arc;

    /// A crooked chain, long enough to be filled in pieces, with springs to the next and the third particle, some of them twice, in
    /// either direction, some damped; here and there a particle is held, or on rails.
    fn chain(dimension: usize) -> (System, State) {
        const PARTICLES: usize = 2500;
        let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
        for i in 0..PARTICLES {
            let place = [1.0 * i as f64, 0.3 * (i % 3) as f64, 0.2 * (i % 5) as f64];
            let modelled = std::array::from_fn(|axis| if axis < dimension { place[axis] } else { 0.0 });
            builder.particle(modelled, 1.0 + (i % 4) as f64);
        }
        for i in 0..PARTICLES - 3 {
            let spring = Spring { stiffness: 10.0 + (i % 6) as f64, rest_length: 1.5, damping: (i % 2) as f64 };
            builder.spring(i, i + 1, spring);
            builder.spring(i + 3, i, spring);
            if i % 7 == 0 {
                builder.spring(i + 1, i, spring);
                builder.spring(i, i + 3, spring);
            }
        }
        let every = |step| (0..PARTICLES).step_by(step).collect::<Vec<_>>();
        builder.constrain(Constraint { particles: every(11), axes: Axes::of(&[0, 2]), motion: Motion::Held });
        builder.constrain(Constraint { particles: every(50), axes: Axes::ALL, motion: Motion::Held });
        builder.build().unwrap()
    }

    #[test]
    fn the_matrix_is_the_sum_of_its_triplets() {
        for dimension in [1, 2, 3] {
            let (system, state) = chain(dimension);
            let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
            let a = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(0.1));
            let pattern = Arc::new(SpringPattern::of_stiffness(&system).unwrap());
            let mut matrix = SystemMatrix::assemble(pattern, &a);
            // A second time, over what is there.
            matrix.refill(&a);
            let triplets = assemble_afresh(&a);
            let lower = triplets.iter().filter(|entry| entry.row >= entry.column);
            let expected: Vec<_> = lower.map(|entry| (entry.row, entry.column, entry.value)).collect();
            assert!(matrix.matrix().iter().eq(expected), "{dimension}");
            let (whole, csc) = (matrix.matrix().whole_columns().unwrap(), matrix.matrix().to_csc());
            assert!(whole.rows.iter().map(|&row| row as usize).eq(csc.row_indices().iter().copied()), "{dimension}");
            assert_eq!(whole.values, csc.values());
            // Products, of the matrix and of the operator.
            let order = system.dofs().len();
            let w: Vec<f64> = (0..order).map(|row| ((row * 7) % 11) as f64 - 5.0).collect();
            let mut product = vec![0.0; order];
            triplets.iter().for_each(|entry| product[entry.row] += entry.value * w[entry.column]);
            for operator in [&a as &dyn LinearOperator, matrix.matrix()] {
                let mut found = vec![9.0; order];
                operator.apply(&w, &mut found);
                let difference = found.iter().zip(&product).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(difference < 1e-10, "{dimension}: {difference:e}");
            }
            let blocks = |operator: &dyn BlockDiagonal| {
                let mut blocks = vec![Matrix3::zeros(); system.particles()];
                operator.diagonal_blocks(&mut blocks);
                blocks
            };
            let (of_operator, of_matrix) = (blocks(&a), blocks(matrix.matrix()));
            let is_near = |(a, b): (&Matrix3<f64>, &Matrix3<f64>)| (a - b).amax() < 1e-12 * (1.0 + b.amax());
            assert!(of_operator.iter().zip(&of_matrix).all(is_near), "{dimension}");
        }
    }

    /// The pattern of G has the damped springs alone: every other particle's first and third neighbour.
    #[test]
    fn springs_without_damping_have_no_place_in_the_damping_matrix() {
        let (system, state) = chain(2);
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let g = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::DAMPING);
        let pattern = Arc::new(SpringPattern::of_damping(&system).unwrap());
        let matrix = SystemMatrix::assemble(pattern, &g);
        let stored: Vec<_> = matrix.matrix().iter().filter(|entry| entry.2 != 0.0).collect();
        let triplets = assemble_afresh(&g);
        let lower = triplets.iter().filter(|entry| entry.row >= entry.column && entry.value != 0.0);
        assert_eq!(stored, lower.map(|entry| (entry.row, entry.column, entry.value)).collect::<Vec<_>>());
        let all = SpringPattern::of_stiffness(&system).unwrap();
        assert!(
            stored.len() < matrix.matrix().values().len() && matrix.matrix().values().len() < all.pattern().entries()
        );
    }

    /// What prescribed coordinates do to the free ones: the columns that the matrix does not have.
    #[test]
    fn the_coupling_is_what_the_whole_matrix_has_beside_the_free_one() {
        let (system, state) = chain(3);
        let (whole, _) = {
            let mut builder =
                SystemBuilder { dimension: 3, positions: state.positions.clone(), ..SystemBuilder::new() };
            builder.velocities = vec![Vector3::zeros(); system.particles()];
            builder.masses = system.masses().to_vec();
            (builder.pairs, builder.springs) = (system.pairs().to_vec(), system.springs().to_vec());
            builder.build().unwrap()
        };
        let operator = |system| {
            let extensions = SpringGeometry::at(system, &state.positions).unwrap();
            SystemOperator::new(system, &extensions, Stiffness::Full, Combination::step(0.1))
        };
        let (a, all) = (operator(&system), operator(&whole));
        // Prescribed coordinates alone are displaced.
        let mut displacement: Vec<Vector3<f64>> =
            (0..system.particles()).map(|p| Vector3::new(1.0, -2.0, (p % 3) as f64)).collect();
        system.dofs().scatter(&vec![0.0; system.dofs().len()], &mut displacement);
        let flat: Vec<f64> = displacement.iter().flatten().copied().collect();
        let mut product = vec![0.0; flat.len()];
        all.apply(&flat, &mut product);
        let product: Vec<Vector3<f64>> = product.chunks(3).map(Vector3::from_column_slice).collect();
        let mut expected = vec![0.0; system.dofs().len()];
        system.dofs().gather(&product, &mut expected);
        let mut found = vec![1.0; system.dofs().len()];
        a.subtract_coupling(&displacement, &mut found);
        // b loses it.
        let difference = found.iter().zip(&expected).map(|(b, coupled)| (b - 1.0 + coupled).abs()).fold(0.0, f64::max);
        assert!(difference < 1e-10, "{difference:e}");
        assert!(expected.iter().any(|entry| entry.abs() > 1.0));
    }
}
