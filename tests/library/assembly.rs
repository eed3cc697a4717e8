//! The assembled matrices against the matrix-free product, the simple path, dense algebra and each other.

use crate::systems::{systems, test_vector};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use proptest::prelude::*;
use sprung::assembly::triplets::{BlockTriplet, MatrixEntry, assemble};
use sprung::assembly::{BlockPattern, SpringPattern, SymmetricMatrix, SystemMatrix, assemble_afresh};
use sprung::force::SpringGeometry;
use sprung::integrate::StepMatrices;
use sprung::linear::Cholesky;
use sprung::operator::{BlockDiagonal, Combination, LinearOperator, SystemOperator};
use sprung::system::{Dof, DofMap};
use sprung::{State, Stiffness, System};
use std::sync::Arc;

fn operator<'s>(system: &'s System, state: &State, option: Stiffness, combination: Combination) -> SystemOperator<'s> {
    let extensions = SpringGeometry::at(system, &state.positions).expect("no coincident ends");
    SystemOperator::new(system, &extensions, option, combination)
}

fn assembled(system: &System, operator: &SystemOperator) -> SymmetricMatrix {
    let pattern = Arc::new(SpringPattern::of_stiffness(system).expect("a small system"));
    SystemMatrix::assemble(pattern, operator).into_matrix()
}

fn dense(matrix: &SymmetricMatrix) -> DMatrix<f64> {
    DMatrix::from(&matrix.to_csc())
}

/// Full, then every option, for A at a few step sizes, K and G.
fn cases() -> Vec<(Stiffness, Combination)> {
    let steps = [1e-3, 0.1, 10.0].map(Combination::step);
    let combinations = steps.into_iter().chain([Combination::STIFFNESS, Combination::DAMPING, Combination::MASS]);
    combinations.flat_map(|c| Stiffness::ALL.map(|option| (option, c))).collect()
}

proptest! {
    #[test]
    fn refill_equals_fresh_assembly_bitwise_and_is_symmetric((system, state) in systems()) {
        for (option, combination) in cases() {
            let operator = operator(&system, &state, option, combination);
            let fresh = assemble_afresh(&operator);
            let at = |row, column| fresh.iter().find(|e| (e.row, e.column) == (row, column)).map(|e| e.value.to_bits());
            let pattern = Arc::new(SpringPattern::of_stiffness(&system).unwrap());
            let mut matrix = SystemMatrix::zeros(pattern);
            // Twice: a refill must forget what was there.
            matrix.refill(&operator);
            matrix.refill(&operator);
            let mut stored = 0;
            for (row, column, value) in matrix.matrix().iter() {
                prop_assert_eq!(at(row, column), Some(value.to_bits()));
                prop_assert_eq!(at(column, row), Some(value.to_bits()), "the transpose");
                stored += if row == column { 1 } else { 2 };
            }
            prop_assert_eq!(stored, fresh.len());
        }
    }

    #[test]
    fn assembled_and_matrix_free_products_agree((system, state) in systems(), seed in 0u64..1000) {
        let n = system.dofs().len();
        let w = test_vector(n, seed);
        for (option, combination) in cases() {
            let operator = operator(&system, &state, option, combination);
            let matrix = assembled(&system, &operator);
            let (mut free, mut stored) = (vec![0.0; n], vec![0.0; n]);
            operator.apply(&w, &mut free);
            matrix.apply(&w, &mut stored);
            // (|A| |w|) with the magnitudes of the contributions, not of their sums: what rounding acts on.
            let mut magnitudes = vec![0.0; n];
            for (row, column, value) in contributions(&operator) {
                magnitudes[row] += (value * w[column]).abs();
            }
            for row in 0..n {
                let bound = 30.0 * 0.5 * f64::EPSILON * magnitudes[row];
                prop_assert!((free[row] - stored[row]).abs() <= bound, "row {row}: {} {}", free[row], stored[row]);
            }
        }
    }

    #[test]
    fn tension_and_axial_are_always_positive_definite((system, state) in systems(), dt in crate::systems::log_uniform(1e-4, 1e2)) {
        for option in [Stiffness::Tension, Stiffness::Axial] {
            let matrix = assembled(&system, &operator(&system, &state, option, Combination::step(dt)));
            let mut cholesky = Cholesky::analyse(matrix.pattern(), faer::Par::Seq).unwrap();
            prop_assert!(cholesky.factor(&matrix).is_ok());
        }
    }

    #[test]
    fn translations_are_in_the_null_space_of_k_and_g((system, state) in systems()) {
        let dofs = DofMap::unconstrained(system.particles());
        for combination in [Combination::STIFFNESS, Combination::DAMPING] {
            for option in Stiffness::ALL {
                let operator = operator(&system, &state, option, combination);
                let k = on_all_axes(&system, &dofs, &operator, |entry| entry);
                // For the springs, not for their sums: stretched and compressed ones cancel, their roundings do not.
                let magnitudes = on_all_axes(&system, &dofs, &operator, f64::abs);
                for axis in 0..3 {
                    let translation = DVector::from_fn(3 * system.particles(), |row, _| f64::from(row % 3 == axis));
                    let moved = &k * &translation;
                    let magnitudes = &magnitudes * &translation;
                    for row in 0..moved.len() {
                        prop_assert!(moved[row].abs() <= 30.0 * f64::EPSILON * magnitudes[row]);
                    }
                }
            }
        }
    }

    #[test]
    fn tension_is_full_when_nothing_is_compressed((system, state) in crate::systems::stretched_systems()) {
        let step = Combination::step(0.1);
        let full = assembled(&system, &operator(&system, &state, Stiffness::Full, step));
        let tension = assembled(&system, &operator(&system, &state, Stiffness::Tension, step));
        prop_assert_eq!(full.values(), tension.values());
    }

    #[test]
    fn a_is_the_combination_of_m_g_and_k((system, state) in systems(), dt in crate::systems::log_uniform(1e-3, 10.0)) {
        let StepMatrices { a, m, g, k, .. } = StepMatrices::assemble(&system, &state, Stiffness::Full, dt).unwrap();
        let (a, m, g, k) = (dense(&a), DMatrix::from_diagonal(&DVector::from_vec(m)), dense(&g), dense(&k));
        let expected = &m / (dt * dt) - &g / dt - &k;
        let scale = (&m / (dt * dt)).abs() + (&g / dt).abs() + k.abs();
        approx::assert_abs_diff_eq!(a, expected, epsilon = 1e-13 * scale.amax().max(1.0));
        prop_assert_eq!(&a, &a.transpose());
    }

    #[test]
    fn diagonal_blocks_agree((system, state) in systems()) {
        let operator = operator(&system, &state, Stiffness::Full, Combination::step(0.05));
        let matrix = assembled(&system, &operator);
        let zeros = || vec![Matrix3::zeros(); system.particles()];
        let (mut free, mut stored) = (zeros(), zeros());
        operator.diagonal_blocks(&mut free);
        matrix.diagonal_blocks(&mut stored);
        for (free, stored) in free.iter().zip(&stored) {
            approx::assert_relative_eq!(free, stored, epsilon = 1e-9, max_relative = 1e-12);
        }
    }

    #[test]
    fn dof_map_goes_both_ways((system, state) in systems()) {
        let dofs = system.dofs();
        let listed: Vec<Dof> = dofs.iter().collect();
        prop_assert_eq!(listed.len(), dofs.len());
        for (row, dof) in listed.into_iter().enumerate() {
            prop_assert_eq!(dofs.dof(row), dof);
            prop_assert_eq!(dofs.row(dof), Some(row));
        }
        let mut reduced = vec![0.0; dofs.len()];
        dofs.gather(&state.positions, &mut reduced);
        let mut back = vec![Vector3::repeat(7.0); system.particles()];
        dofs.scatter(&reduced, &mut back);
        for (p, back) in back.iter().enumerate() {
            let free = dofs.free_axes(p);
            for axis in 0..3 {
                let expected = if free.contains(axis) { state.positions[p][axis] } else { 7.0 };
                prop_assert_eq!(back[axis], expected);
            }
            let expected = Vector3::from_fn(|axis, _| if free.contains(axis) { state.positions[p][axis] } else { 0.0 });
            prop_assert_eq!(dofs.get(&reduced, p), expected);
        }
    }
}

/// Every contribution to every entry of an operator, repeats listed.
fn contributions(operator: &SystemOperator) -> Vec<(usize, usize, f64)> {
    let system = operator.system();
    let dofs = system.dofs();
    let mut list: Vec<_> = dofs
        .iter()
        .zip(0..)
        .map(|(dof, row)| (row, row, operator.mass_factor() * system.masses()[dof.particle]))
        .collect();
    for ((_, [i, j], _), block) in system.active().zip(operator.blocks()) {
        let block = block.matrix();
        for (p, q, sign) in [(i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)] {
            for (r, c) in (0..3).flat_map(|r| (0..3).map(move |c| (r, c))) {
                let row = dofs.row(Dof { particle: p, axis: r });
                let column = dofs.row(Dof { particle: q, axis: c });
                list.extend(row.zip(column).map(|(row, column)| (row, column, sign * block[(r, c)])));
            }
        }
    }
    list
}

/// The operator's spring part over all three axes of all particles, held or not, as a dense matrix.
fn on_all_axes(system: &System, dofs: &DofMap, operator: &SystemOperator, entry: fn(f64) -> f64) -> DMatrix<f64> {
    let mut triplets = Vec::new();
    for ((_, [i, j], _), block) in system.active().zip(operator.blocks()) {
        let block = block.matrix();
        for (row, column, block) in [(i, i, block), (j, j, block), (i, j, -block), (j, i, -block)] {
            triplets.push(BlockTriplet { row, column, block: block.map(entry) });
        }
    }
    let mut k = DMatrix::zeros(dofs.len(), dofs.len());
    for MatrixEntry { row, column, value } in assemble(dofs, &triplets) {
        k[(row, column)] = value;
    }
    k
}

/// A caller's own element: three particles coupled by a block that is not symmetric. Nothing of springs is used.
#[test]
fn own_blocks_can_be_assembled() {
    let free = [sprung::system::Axes::ALL, sprung::system::Axes::of(&[1]), sprung::system::Axes::of(&[0, 2])];
    let dofs = DofMap::new(free.to_vec());
    let pattern = Arc::new(BlockPattern::new(&dofs, [[2, 0], [0, 1], [0, 2]].into_iter()).unwrap());
    assert_eq!((pattern.order(), pattern.slot(1, 2)), (6, None));
    let mut matrix = SymmetricMatrix::zeros(pattern.clone());
    let block = Matrix3::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0);
    let mut triplets = vec![];
    for [i, j] in [[2, 0], [0, 1], [0, 2]] {
        matrix.add_block(pattern.slot(i, j).unwrap(), &block);
        triplets.push(BlockTriplet { row: i, column: j, block });
        triplets.push(BlockTriplet { row: j, column: i, block: block.transpose() });
    }
    let diagonal = block + block.transpose();
    matrix.add_diagonal_block(0, &diagonal);
    triplets.push(BlockTriplet { row: 0, column: 0, block: diagonal });
    let mut expected = DMatrix::zeros(6, 6);
    for MatrixEntry { row, column, value } in assemble(&dofs, &triplets) {
        expected[(row, column)] = value;
    }
    assert_eq!(dense(&matrix), expected);
    assert_ne!(expected[(3, 0)], 0.0);
}

#[test]
fn a_bad_pair_is_named() {
    let dofs = DofMap::unconstrained(3);
    let message = |pairs: [[usize; 2]; 2]| BlockPattern::new(&dofs, pairs.into_iter()).unwrap_err().to_string();
    assert_eq!(message([[0, 1], [1, 3]]), "pairs[1] = [1, 3]: must join two different particles below 3");
    assert_eq!(message([[2, 2], [0, 1]]), "pairs[0] = [2, 2]: must join two different particles below 3");
}

/// One spring along x at length 2 with l0 = 1 and k = 3: every sign and factor by hand.
#[test]
fn signs_of_k_g_and_a_by_hand() {
    let mut builder = sprung::SystemBuilder::new();
    builder.particle([2.0, 0.0, 0.0], 5.0);
    builder.particle([0.0, 0.0, 0.0], 7.0);
    builder.spring(0, 1, sprung::Spring { stiffness: 3.0, rest_length: 1.0, damping: 0.5 });
    builder.hold(1);
    let (system, state) = builder.build().unwrap();
    let dt = 0.5;
    let StepMatrices { a, m, g, k, b } = StepMatrices::assemble(&system, &state, Stiffness::Full, dt).unwrap();
    let diagonal = |x, y, z| DMatrix::from_diagonal(&DVector::from_vec(vec![x, y, z]));
    // K^s = 3 (1 − 1/2) (I − nnᵀ) + 3 nnᵀ.
    assert_eq!(dense(&k), diagonal(-3.0, -1.5, -1.5));
    assert_eq!(dense(&g), diagonal(-0.5, 0.0, 0.0));
    assert_eq!(m, [5.0, 5.0, 5.0]);
    assert_eq!(dense(&a), diagonal(20.0 + 1.0 + 3.0, 20.0 + 1.5, 20.0 + 1.5));
    // f = −k (l/l0 − 1) n.
    assert_eq!(b, vec![-3.0, 0.0, 0.0]);
}
