//! Multigrid: few iterations whatever the size, a symmetric positive definite preconditioner whatever the system.

mod common;

use nalgebra::Vector3;
use sprung::force::Extensions;
use sprung::linear::*;
use sprung::multigrid::Multigrid;
use sprung::operator::{Combination, SystemOperator};
use sprung::scene::builtin;
use sprung::work::Work;
use sprung::{Scene, State, Stiffness, System};
use std::time::Instant;

/// A ready scene without damping, every coordinate moved by up to 3 % of the spacing.
fn noisy(mut scene: Scene, spacing: f64, stiffer: f64) -> (System, State) {
    scene.springs.damping = None;
    if let Some(stiffness) = &mut scene.springs.stiffness {
        let sprung::scene::Values::Uniform(k) = stiffness else { panic!() };
        *k *= stiffer;
    }
    let (system, state) = scene.build().unwrap();
    let mut builder = rebuild(&system, &state);
    let mut seed = 1u64;
    for x in &mut builder.positions {
        *x += Vector3::from_fn(|_, _| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            0.03 * spacing * (2.0 * (seed >> 11) as f64 / (1u64 << 53) as f64 - 1.0)
        });
    }
    builder.build().unwrap()
}

fn rebuild(system: &System, state: &State) -> sprung::SystemBuilder {
    let mut builder = sprung::SystemBuilder::new();
    builder.positions = state.positions.clone();
    builder.velocities = state.velocities.clone();
    builder.masses = system.masses().to_vec();
    builder.pairs = system.pairs().to_vec();
    builder.springs = system.springs().to_vec();
    let held = |p: &usize| system.dofs().free_axes(*p) != sprung::system::Axes::ALL;
    (0..system.particles()).filter(held).for_each(|p| {
        builder.hold(p);
    });
    builder
}

fn cloth(n: usize, stiffer: f64) -> (System, State) {
    noisy(builtin::cloth(n).unwrap(), 0.05, stiffer)
}

fn lattice(n: usize, stiffer: f64) -> (System, State) {
    noisy(builtin::lattice(n).unwrap(), 0.01, stiffer)
}

/// Nanoseconds that this thread has computed, whatever else the machine does.
fn cpu() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    text.split_whitespace().next().unwrap().parse::<f64>().unwrap() / 1e6
}

#[test]
#[ignore = "a measurement"]
fn measure() {
    let threads = std::env::var("THREADS").map_or(1, |t| t.parse().unwrap());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(measure_inside);
}

fn clock() -> f64 {
    static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    if rayon::current_num_threads() == 1 {
        cpu()
    } else {
        START.get_or_init(Instant::now).elapsed().as_secs_f64() * 1e3
    }
}

fn measure_inside() {
    let wanted = std::env::var("SCENES").unwrap_or("cloth 32,cloth 100,lattice 10,lattice 22".into());
    for scene in wanted.split(',') {
        let words: Vec<&str> = scene.split_whitespace().collect();
        let n: usize = words[1].parse().unwrap();
        let stiffer = words.get(2).map_or(1.0, |w| w.parse().unwrap());
        let option = words.get(3).map_or(Stiffness::Tension, |_| Stiffness::Axial);
        let (system, state) = if words[0] == "cloth" { cloth(n, stiffer) } else { lattice(n, stiffer) };
        let extensions = Extensions::at(&system, &state.positions).unwrap();
        let operator = SystemOperator::new(&system, &extensions, option, Combination::step(0.01));
        let start = clock();
        let mut multigrid = Multigrid::new(&system).unwrap();
        let analysed = clock() - start;
        multigrid.place(&state.positions);
        let mut times = Vec::new();
        for _ in 0..3 {
            let start = clock();
            multigrid.refill(&operator).unwrap();
            let refilled = clock();
            multigrid.rebuild(&operator).unwrap();
            times.push((refilled - start, clock() - refilled));
        }
        let b = common::test_vector(system.dofs().len(), 1);
        let mut z = b.clone();
        let start = clock();
        for _ in 0..5 {
            multigrid.apply(&b, &mut z);
        }
        let cycle = (clock() - start) / 5.0;
        let start = clock();
        for _ in 0..5 {
            sprung::operator::LinearOperator::apply(&operator, &b, &mut z);
        }
        let product = (clock() - start) / 5.0;
        let sizes = multigrid.levels();
        let complexity = sizes.iter().map(|s| s.entries).sum::<usize>() as f64 / sizes[0].entries as f64;
        let bytes = multigrid.bytes() / system.particles();
        drop(multigrid);
        let mut solver = CgSolver::matrix_free(&system, PreconditionerKind::Multigrid, 1e-10).unwrap();
        let mut work = Work::default();
        solver.place(&state.positions);
        let start = clock();
        solver.prepare(&operator, &mut work).unwrap();
        let mut x = vec![0.0; b.len()];
        let solution = solver.solve(&operator, &b, &mut x, &mut work).unwrap();
        let solved = clock() - start;
        println!(
            "{scene}: {} iterations, residual {:.1e}, analyse {analysed:.1}, refill/rebuild {times:.1?} ms, cycle {cycle:.2} ms, product {product:.2} ms, setup+solve {solved:.1} ms, complexity {complexity:.2}, {bytes} B/particle, nodes {:?}",
            work.cg_iterations,
            solution.relative_residual,
            sizes.iter().map(|s| s.nodes).collect::<Vec<_>>()
        );
    }
}
