//! The streamed product without a matrix against the obvious sum over springs, for any number of threads.

use crate::systems::{systems, test_vector};
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;
use sprung::force::{SpringGeometry, add_damping_force, add_elastic_force};
use sprung::operator::{Combination, LinearOperator, SystemOperator};
use sprung::scene::builtin::{cloth, lattice, network};
use sprung::spring::{Extension, SpringBlock};
use sprung::{Scene, State, Stiffness, System};

fn operator<'s>(system: &'s System, state: &State, option: Stiffness, combination: Combination) -> SystemOperator<'s> {
    let extensions = SpringGeometry::at(system, &state.positions).expect("no coincident ends");
    SystemOperator::new(system, &extensions, option, combination)
}

/// `m w + Σ B (w_i − w_j)`, spring by spring through 3×3 matrices, and the bound of the rounding errors of this and of the
/// streamed product together.
///
/// With u the unit roundoff, a spring's part of the streamed product carries at most 33 u, its part through the matrix at
/// most 10 u of `(|α| |I − nnᵀ| + |β| |nnᵀ|) (|w_i| + |w_j|)`, and adding up k of them k u more in either product.
fn reference(operator: &SystemOperator, w: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let system = operator.system();
    let dofs = system.dofs();
    let (mut y, mut bound) = (vec![0.0; w.len()], vec![0.0; w.len()]);
    for (particle, mass) in system.masses().iter().enumerate() {
        let inertia = dofs.get(w, particle) * (operator.mass_factor() * mass);
        dofs.add(&mut y, particle, &inertia);
        dofs.add(&mut bound, particle, &inertia.abs());
    }
    let mut ends = vec![0.0; system.particles()];
    for ((_, [i, j], _), block) in system.active().zip(operator.blocks()) {
        let (wi, wj) = (dofs.get(w, i), dofs.get(w, j));
        let s = block.matrix() * (wi - wj);
        dofs.add(&mut y, i, &s);
        dofs.add(&mut y, j, &-s);
        let magnitude = magnitudes(block) * (wi.abs() + wj.abs());
        for end in [i, j] {
            dofs.add(&mut bound, end, &magnitude);
            ends[end] += 1.0;
        }
    }
    for (row, dof) in dofs.iter().enumerate() {
        bound[row] *= (43.0 + 2.0 * ends[dof.particle]) * 0.5 * f64::EPSILON;
    }
    (y, bound)
}

/// `|α| |I − nnᵀ| + |β| |nnᵀ|`.
fn magnitudes(block: &SpringBlock) -> Matrix3<f64> {
    let across = SpringBlock { axial: 0.0, ..*block }.matrix().abs();
    let along = SpringBlock { transverse: 0.0, ..*block }.matrix().abs();
    across + along
}

fn assert_within_bound(operator: &SystemOperator, w: &[f64]) {
    let mut y = vec![f64::NAN; w.len()];
    operator.apply(w, &mut y);
    let (expected, bound) = reference(operator, w);
    for row in 0..w.len() {
        let error = (y[row] - expected[row]).abs();
        assert!(error <= bound[row], "row {row}: {} {}, error {error:e} of {:e}", y[row], expected[row], bound[row]);
    }
}

const COMBINATIONS: [Combination; 3] =
    [Combination { mass: 1e4, damping: -100.0, stiffness: -1.0 }, Combination::STIFFNESS, Combination::DAMPING];

proptest! {
    #[test]
    fn streamed_product_is_the_sum_over_springs((system, state) in systems(), seed in 0u64..1000) {
        let w = test_vector(system.dofs().len(), seed);
        for (option, combination) in Stiffness::ALL.into_iter().flat_map(|o| COMBINATIONS.map(|c| (o, c))) {
            assert_within_bound(&operator(&system, &state, option, combination), &w);
        }
    }

    /// Springs far shorter than at rest along an axis: α is large against β, which the product must not lose.
    #[test]
    fn nearly_collapsed_springs_keep_their_axial_part(length in crate::systems::log_uniform(1e-9, 1.0), axis in 0usize..3) {
        let mut builder = sprung::SystemBuilder::new();
        let mut end = [0.0; 3];
        end[axis] = length;
        builder.particle([0.0; 3], 1.0);
        builder.particle(end, 1.0);
        builder.spring(0, 1, sprung::Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
        let (system, state) = builder.build().unwrap();
        let operator = operator(&system, &state, Stiffness::Full, Combination::STIFFNESS);
        let mut w = vec![0.0; 6];
        w[axis] = 1.0;
        assert_within_bound(&operator, &w);
    }
}

/// With its particles moved a little, so that no spring lies along an axis and some are compressed.
fn shaken(scene: Scene) -> (System, State) {
    let (system, mut state) = scene.build().unwrap();
    for (p, x) in state.positions.iter_mut().enumerate() {
        let noise = |axis: usize| 0.002 * ((3 * p + axis) as f64 * 0.754_877_666).sin();
        *x += Vector3::from_fn(|axis, _| noise(axis));
    }
    (system, state)
}

/// Large enough for several parts: regular, with wide cuts, and without any order of the particles.
#[test]
fn product_is_the_same_to_the_bit_for_any_number_of_threads() {
    for scene in [cloth(90), lattice(16), network(20_000, 1)] {
        let (system, state) = shaken(scene.unwrap());
        assert!(system.active_springs().len() > 3 * 8192, "the scene must be large enough to be cut");
        let w = test_vector(system.dofs().len(), 5);
        let product = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let operator = operator(&system, &state, Stiffness::Full, Combination::step(0.01));
                assert_within_bound(&operator, &w);
                let mut y = vec![0.0; w.len()];
                operator.apply(&w, &mut y);
                y
            })
        };
        let one = product(1);
        for threads in [2, 3, 4] {
            let several = product(threads);
            assert!(one.iter().zip(&several).all(|(a, b)| a.to_bits() == b.to_bits()), "{threads} threads");
        }
    }
}

/// Sums over springs that several threads share are those of one thread, to the bit, and right.
#[test]
fn forces_do_not_depend_on_the_number_of_threads() {
    let (system, mut state) = sprung::scene::builtin::cloth(64).unwrap().build().unwrap();
    for (p, (x, v)) in state.positions.iter_mut().zip(&mut state.velocities).enumerate() {
        let noise = |k: usize| ((5 * p + k) as f64 * 12.9898).sin();
        *x += Vector3::new(noise(0), noise(1), noise(2)) * 0.002;
        *v = Vector3::new(noise(3), noise(4), noise(0));
    }
    let mut expected = vec![Vector3::zeros(); system.particles()];
    for (&[i, j], spring) in system.pairs().iter().zip(system.springs()) {
        let (i, j) = (i as usize, j as usize);
        let at = Extension::between(&state.positions[i], &state.positions[j]).unwrap();
        let v = state.velocities[i] - state.velocities[j];
        let f = spring.elastic_force(&at);
        expected[i] += f;
        expected[j] -= f;
        let f = spring.damping_force(&at, &v);
        expected[i] += f;
        expected[j] -= f;
    }
    let forces = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
            let (mut elastic, mut damping) = (vec![Vector3::zeros(); system.particles()], expected.clone());
            damping.fill(Vector3::zeros());
            add_elastic_force(&system, &extensions, &mut elastic);
            add_damping_force(&system, &extensions, &state.velocities, &mut damping);
            (elastic, damping)
        })
    };
    let one = forces(1);
    for threads in [2, 3] {
        assert_eq!(forces(threads), one, "{threads} threads");
    }
    for (p, expected) in expected.iter().enumerate() {
        // Springs between two held particles are left out: there are none here.
        assert!((one.0[p] + one.1[p] - expected).norm() <= 1e-9, "particle {p}");
    }
}
