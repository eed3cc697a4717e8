//! Multigrid on cloths and lattices: set-up, cycle and solve beside the product with A.
//!
//! `cargo bench --bench multigrid -- [THREADS [SCENE SIZE [STIFFER [OPTION]]]…]`, for example `2 cloth 316 1 tension`. Times are
//! the least of several, in milliseconds, elapsed and (with one thread) computed: the latter counts on a busy machine.

#[path = "scenes.rs"]
mod scenes;

use sprung::force::Extensions;
use sprung::linear::{CgSolver, LinearSolver, PreconditionerKind, Prepare};
use sprung::multigrid::Multigrid;
use sprung::operator::{Combination, LinearOperator, SystemOperator};
use sprung::work::Work;
use sprung::{State, Stiffness, System};
use std::time::Instant;

const SCENES: [(&str, &str, &str, &str); 6] = [
    ("cloth", "32", "1", "tension"),
    ("cloth", "100", "1", "tension"),
    ("cloth", "316", "1", "tension"),
    ("lattice", "10", "1", "tension"),
    ("lattice", "22", "1", "tension"),
    ("lattice", "46", "1", "tension"),
];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let threads = arguments.first().map_or(1, |threads| threads.parse().unwrap());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        if arguments.len() < 5 {
            SCENES.into_iter().for_each(measure);
        }
        for scene in arguments[1.min(arguments.len())..].chunks_exact(4) {
            measure((&scene[0], &scene[1], &scene[2], &scene[3]));
        }
    });
}

/// Elapsed milliseconds, and those that this thread computed where the system tells.
fn clocks() -> [f64; 2] {
    thread_local!(static START: Instant = Instant::now());
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let computed = text.split_whitespace().next().and_then(|nanoseconds| nanoseconds.parse::<f64>().ok());
    [START.with(|start| start.elapsed().as_secs_f64() * 1e3), computed.unwrap_or(f64::NAN) / 1e6]
}

/// The least elapsed and computed time of some repeats.
fn time(repeats: usize, mut f: impl FnMut()) -> String {
    let mut least = [f64::INFINITY; 2];
    for _ in 0..repeats {
        let start = clocks();
        f();
        let end = clocks();
        for k in 0..2 {
            least[k] = least[k].min(end[k] - start[k]);
        }
    }
    format!("{:.1}/{:.1}", least[0], least[1])
}

/// Without damping, `stiffer` times as stiff.
fn scene(kind: &str, size: usize, stiffer: f64) -> (System, State) {
    let mut builder = scenes::scene(kind, size).unwrap().builder().unwrap();
    for spring in &mut builder.springs {
        spring.damping = 0.0;
        spring.stiffness *= stiffer;
    }
    builder.build().unwrap()
}

fn measure((kind, size, stiffer, option): (&str, &str, &str, &str)) {
    let (system, state) = scene(kind, size.parse().unwrap(), stiffer.parse().unwrap());
    let option = Stiffness::ALL.into_iter().find(|o| o.name() == option).unwrap();
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let a = SystemOperator::new(&system, &extensions, option, Combination::step(0.01));
    let b: Vec<f64> = (0..system.dofs().len()).map(|i| (i as f64 * 0.754_877_666).sin()).collect();
    let mut z = b.clone();

    let analyse = time(1, || drop(Multigrid::new(&system).unwrap()));
    let mut multigrid = Multigrid::new(&system).unwrap();
    multigrid.place(&state.positions);
    multigrid.refill(&a).unwrap();
    let first = time(1, || multigrid.rebuild(&a).unwrap());
    let refill = time(3, || multigrid.refill(&a).unwrap());
    let rebuild = time(3, || multigrid.rebuild(&a).unwrap());
    let cycle = time(10, || multigrid.apply(&b, &mut z));
    let product = time(10, || a.apply(&b, &mut z));
    let levels = multigrid.levels();
    let bytes = multigrid.bytes() / system.particles();
    drop(multigrid);

    let mut work = Work::default();
    let mut solver = CgSolver::matrix_free(&system, Some(PreconditionerKind::Multigrid), 1e-10).unwrap();
    solver.place(&state.positions);
    let mut solver = solver.prepare(&a, &mut work).unwrap();
    z.fill(0.0);
    // Once: the next time it would start from this solution.
    let solve = time(1, || _ = solver.solve(&b, &mut z, &mut work).unwrap());
    println!(
        "{kind} {size} ×{stiffer} {}: {} iterations; analyse {analyse}, first set-up {first}, refill {refill}, rebuild \
         {rebuild}, solve {solve}, cycle {cycle}, product {product}; {bytes} B a particle, nodes {:?}",
        option.name(),
        work.cg_iterations,
        levels.iter().map(|level| level.nodes).collect::<Vec<_>>(),
    );
}
