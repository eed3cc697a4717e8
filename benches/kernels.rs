//! The kernels of a step, one by one: `cargo bench --bench kernels`. The time of `triad` says what the memory can deliver.

mod scenes;

use divan::Bencher;
use divan::counter::{BytesCount, ItemsCount};
use sprung::assembly::{SpringPattern, SystemMatrix};
use sprung::force::SpringGeometry;
use sprung::linear::{CgSolver, Cholesky, PreconditionerKind, Prepare};
use sprung::operator::{Combination, LinearOperator, SystemOperator};
use sprung::work::Work;
use sprung::{State, Stiffness, System};
use std::sync::Arc;

const SCENES: [(&str, usize); 4] = [("cloth", 32), ("cloth", 100), ("cloth", 316), ("lattice", 22)];

fn main() {
    divan::main();
}

fn system((kind, size): (&str, usize)) -> (System, State) {
    scenes::scene(kind, size).and_then(|scene| scene.build()).expect("a scene of that size")
}

fn operator<'s>(system: &'s System, state: &State) -> SystemOperator<'s> {
    let extensions = SpringGeometry::at(system, &state.positions).expect("no coincident ends");
    SystemOperator::new(system, &extensions, Stiffness::Tension, Combination::step(0.01))
}

fn matrix(system: &System, operator: &SystemOperator) -> SystemMatrix {
    SystemMatrix::assemble(Arc::new(SpringPattern::of_stiffness(system).expect("a matrix that fits")), operator)
}

#[divan::bench]
fn triad(bencher: Bencher) {
    let n = 4_000_000;
    let (mut a, b, c) = (vec![0.0; n], vec![1.0; n], vec![2.0; n]);
    bencher.counter(BytesCount::new(32 * n)).bench_local(|| {
        for ((a, b), c) in a.iter_mut().zip(&b).zip(&c) {
            *a = b + 3.0 * c;
        }
        divan::black_box(&mut a);
    });
}

#[divan::bench(args = SCENES)]
fn product(bencher: Bencher, scene: (&str, usize)) {
    let (system, state) = system(scene);
    let operator = operator(&system, &state);
    let w = vec![1.0; system.dofs().len()];
    let mut y = w.clone();
    bencher.counter(ItemsCount::new(system.active_springs().len())).bench_local(|| operator.apply(&w, &mut y));
}

#[divan::bench(args = SCENES)]
fn blocks(bencher: Bencher, scene: (&str, usize)) {
    let (system, state) = system(scene);
    let mut extensions = SpringGeometry::at(&system, &state.positions).expect("no coincident ends");
    let mut operator = operator(&system, &state);
    bencher.counter(ItemsCount::new(system.active_springs().len())).bench_local(|| {
        extensions.update(&system, &state.positions).expect("no coincident ends");
        operator.update(&extensions, Stiffness::Tension, Combination::step(0.01));
    });
}

#[divan::bench(args = SCENES)]
fn refill(bencher: Bencher, scene: (&str, usize)) {
    let (system, state) = system(scene);
    let operator = operator(&system, &state);
    let mut matrix = matrix(&system, &operator);
    bencher.counter(ItemsCount::new(system.active_springs().len())).bench_local(|| matrix.refill(&operator));
}

#[divan::bench(args = SCENES, sample_count = 5)]
fn factor(bencher: Bencher, scene: (&str, usize)) {
    let (system, state) = system(scene);
    let matrix = matrix(&system, &operator(&system, &state));
    let mut cholesky = Cholesky::analyse(matrix.matrix().pattern(), faer::Par::Seq).expect("a factor that fits");
    bencher.bench_local(|| cholesky.factor(matrix.matrix()).expect("a definite matrix"));
}

#[divan::bench(args = SCENES, sample_count = 5)]
fn solve(bencher: Bencher, scene: (&str, usize)) {
    let (system, state) = system(scene);
    let matrix = matrix(&system, &operator(&system, &state));
    let mut cholesky = Cholesky::analyse(matrix.matrix().pattern(), faer::Par::Seq).expect("a factor that fits");
    cholesky.factor(matrix.matrix()).expect("a definite matrix");
    let mut x = vec![1.0; system.dofs().len()];
    bencher.bench_local(|| cholesky.solve_in_place(&mut x).expect("a vector that fits"));
}

#[divan::bench(args = SCENES, consts = [1, 100], sample_count = 5)]
fn cg_iterations<const ITERATIONS: u64>(bencher: Bencher, scene: (&str, usize)) {
    let (system, state) = system(scene);
    let operator = operator(&system, &state);
    let mut solver =
        CgSolver::matrix_free(&system, PreconditionerKind::BlockJacobi, 1e-10).expect("a system that fits");
    solver.method().iteration_limit = ITERATIONS;
    let mut work = Work::default();
    let mut solver = solver.prepare(&operator, &mut work).expect("a definite matrix");
    let b = vec![1.0; system.dofs().len()];
    let mut x = b.clone();
    bencher.bench_local(|| {
        x.fill(0.0);
        // The limit comes first: the outcome is not asked for.
        divan::black_box(solver.solve(&b, &mut x, &mut work).is_ok())
    });
}
