//! Factorizations on any number of threads.

use faer::Par;
use sprung::faer;
use sprung::integrate::StepMatrices;
use sprung::linear::{Cholesky, Ldlt};
use sprung::plan::parallelism;
use sprung::scene::builtin::cloth;
use sprung::{State, Stiffness, System};

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
}

/// A cloth that is shaken a little.
fn moved(size: usize) -> (System, State) {
    let (system, mut state) = cloth(size).and_then(|scene| scene.build()).expect("a scene of that size");
    for (p, x) in state.positions.iter_mut().enumerate() {
        *x += sprung::nalgebra::Vector3::from_fn(|axis, _| 5e-4 * (p as f64 * 12.9898 + axis as f64).sin());
    }
    (system, state)
}

/// Solutions of an LLᵀ and an LDLᵀ factorization that are split alike.
fn solutions(a: &sprung::assembly::SymmetricMatrix, par: Par) -> Vec<f64> {
    let b: Vec<f64> = (0..a.pattern().order()).map(|row| (row as f64 * 12.9898).sin()).collect();
    let mut x = [b.clone(), b];
    let mut cholesky = Cholesky::analyse(a.pattern(), par).expect("a factor that fits");
    cholesky.factor(a).expect("a definite matrix");
    cholesky.solve_in_place(&mut x[0]).unwrap();
    let mut ldlt = Ldlt::analyse(a.pattern(), par).expect("a factor that fits");
    ldlt.factor(a).expect("a regular matrix");
    ldlt.solve_in_place(&mut x[1]).unwrap();
    x.concat()
}

/// The split of a factorization depends on the system alone; so do its bits, on fewer threads than it is split for and on more.
#[test]
fn factorizations_are_the_same_to_the_bit_for_any_number_of_threads() {
    let (system, state) = moved(104);
    let a = StepMatrices::assemble(&system, &state, Stiffness::Tension, 0.01).expect("matrices that fit").a;
    let par = parallelism(&system);
    assert!(matches!(par, Par::Rayon(_)), "large enough to be split");
    let one = pool(1).install(|| solutions(&a, par));
    for threads in [2, 3, 16] {
        let several = pool(threads).install(|| solutions(&a, par));
        assert!(one.iter().zip(&several).all(|(a, b)| a.to_bits() == b.to_bits()), "{threads} threads");
    }
}
