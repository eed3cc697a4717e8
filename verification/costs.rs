//! Measures what the operations of a step cost, for the cost model to be held to: writes `verification/costs.json`.
//!
//! `cargo xtask costs` times every operation on ready scenes of 2 to 10⁵ particles: one thread, its own time, a short one
//! of many repetitions. The test `costs` holds [`sprung::linear::CostModel`] to what is stored: its unit is a force evaluation, so only
//! ratios of these times count, and they hardly depend on the machine.

#[path = "costs/row.rs"]
mod row;

use cpu_time::ThreadTime;
use row::Row;
use sprung::force::Extensions;
use sprung::integrate::{ImplicitOptions, Method};
use sprung::linear::{
    CgSolver, CholeskyGlance, CholeskySolver, LinearSolver, OrderingMethod, Preconditioner, PreconditionerKind,
    Prepare, ReusedMultigrid,
};
use sprung::operator::{Combination, LinearOperator, SystemOperator};
use sprung::scene::{Kind, builtin};
use sprung::work::Work;
use sprung::{State, Stiffness, System};
use std::hint::black_box;
use std::path::Path;
use std::time::Duration;

/// Sizes of each kind, up to 10⁵ particles.
const SCENES: [(Kind, &[usize]); 6] = [
    (Kind::Chain, &[2, 10, 100, 1000, 10_000]),
    (Kind::Cloth, &[4, 10, 20, 32, 64, 100, 316]),
    (Kind::Lattice, &[3, 5, 8, 10, 16, 22, 46]),
    (Kind::Network, &[12, 50, 400, 2000, 10_000]),
    (Kind::Column, &[9, 300]),
    (Kind::Pendulum, &[1]),
];

/// Operations of a factorization that takes seconds at most; longer ones are not timed.
const MOST_FLOPS: f64 = 1e11;

/// All is measured so many times, minutes apart: other programs on the machine slow a processor down for seconds.
const ROUNDS: usize = 3;

/// Every operation is repeated for so long.
const LONG_ENOUGH: Duration = Duration::from_millis(120);

/// A short time of an operation, in ns: a twentieth of its times are shorter. (The clock of a thread that moves to another processor may
/// stand still for a while, so that the shortest time can be none.) What is too short for the clock is done in batches.
fn short(mut operation: impl FnMut()) -> f64 {
    // The first time takes new memory and asks what the processor can do.
    operation();
    let begin = ThreadTime::now();
    operation();
    let first = begin.elapsed().as_nanos().max(1) as f64;
    let batch = (20_000.0 / first).ceil().clamp(1.0, 1000.0) as usize;
    let mut times = Vec::new();
    let begin = ThreadTime::now();
    while times.len() < 3 || begin.elapsed() < LONG_ENOUGH {
        let start = ThreadTime::now();
        for _ in 0..batch {
            operation();
        }
        let time = start.elapsed().as_nanos() as f64 / batch as f64;
        if time > 0.0 {
            times.push(time);
        }
    }
    times.sort_by(f64::total_cmp);
    times[times.len() / 20]
}

/// Moves every coordinate by up to 3 % of the shortest spring, so that no spring lies along an axis.
fn shake(system: &System, state: &mut State) {
    let lengths = system.active().map(|(_, [i, j], _)| (state.positions[i] - state.positions[j]).norm());
    let spacing = lengths.fold(f64::INFINITY, f64::min);
    for (p, x) in state.positions.iter_mut().enumerate() {
        for axis in 0..system.dimension() {
            x[axis] += 0.03 * spacing * ((3 * p + axis) as f64 * 12.9898).sin();
        }
    }
    state.prescribe(system);
}

fn measure(kind: Kind, size: usize) -> Result<Row, Box<dyn std::error::Error>> {
    let (system, mut state) = builtin(kind, size)?.build()?;
    shake(&system, &mut state);
    let n = system.dofs().len();
    let mut extensions = Extensions::at(&system, &state.positions)?;
    let mut operator = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.01));
    let (b, mut x) = (vec![1.0; n], vec![0.0; n]);

    let mut explicit = Method::SymplecticEuler.stepper(&system, &state, &ImplicitOptions::default())?;
    let mut moving = state.clone();
    let force = short(|| {
        let _ = black_box(explicit.step(&mut moving, 1e-12));
    });
    let product = short(|| operator.apply(&b, black_box(&mut x)));
    let assembly = short(|| {
        let _ = extensions.update(&system, &state.positions);
        operator.update(&extensions, Stiffness::Tension, Combination::step(0.01));
    });
    let mut work = Work::default();
    let glance = short(|| drop(CholeskyGlance::new(&system, &mut work)));
    let analysis = short(|| drop(CholeskySolver::new(&system, faer::Par::Seq, &mut work)));
    let mut direct = CholeskySolver::new(&system, faer::Par::Seq, &mut work)?;
    let factor = direct.size();
    let mut factorization = None;
    let mut solve = None;
    if factor.flops <= MOST_FLOPS {
        factorization = Some(short(|| {
            let _ = black_box(direct.prepare(&operator, &mut work).is_ok());
        }));
        let mut direct = direct.prepare(&operator, &mut work)?;
        solve = Some(short(|| {
            let _ = black_box(direct.solve(&b, &mut x, &mut work));
        }));
    }

    // Right-hand sides that converge late: what is timed are iterations up to a limit.
    let rough: Vec<f64> = (0..n).map(|row| ((row * row) as f64 * 0.7).sin()).collect();
    let mut solves = |kind: PreconditionerKind, more: u64| -> Result<[f64; 2], sprung::Error> {
        let mut solver = CgSolver::matrix_free(&system, Some(kind), 1e-300)?;
        solver.place(&state.positions);
        let mut solver =
            solver.prepare(&operator, &mut work).map_err(|failure| sprung::Error::Unsupported(failure.to_string()))?;
        let mut with = |limit: u64| {
            solver.method().iteration_limit = limit;
            let mut done = 0;
            let time = short(|| {
                x.fill(0.0);
                x[0] = 1e-3;
                let before = work.cg_iterations;
                let _ = black_box(solver.solve(&rough, &mut x, &mut work));
                done = work.cg_iterations - before;
            });
            (time, done as f64)
        };
        let ((one, few), (long, many)) = (with(1), with(1 + more));
        Ok([(long - one) / (many - few).max(1.0), one])
    };
    let many = (n as u64 / 2).clamp(1, 30);
    let [iteration_none, _] = solves(PreconditionerKind::None, many)?;
    let [iteration_jacobi, _] = solves(PreconditionerKind::Jacobi, many)?;
    let [iteration_block_jacobi, solve_of_one_iteration] = solves(PreconditionerKind::BlockJacobi, many)?;
    let [iteration_multigrid, _] = solves(PreconditionerKind::Multigrid, many.min(6))?;
    let mut multigrid = ReusedMultigrid::new(&system)?;
    multigrid.place(&state.positions);
    multigrid.update(&operator, &mut work).map_err(|failure| sprung::Error::Unsupported(failure.to_string()))?;
    let multigrid_setup = short(|| {
        let _ = black_box(multigrid.rebuild(&operator, &mut work));
    });
    // Coarse levels that have been used and are not old are kept.
    multigrid.record(10, 10.0);
    let finest_level = short(|| {
        let _ = black_box(multigrid.update(&operator, &mut work));
    });
    let mut block_jacobi = Preconditioner::new(PreconditionerKind::BlockJacobi, &system)?;
    let blocks = short(|| {
        let _ = black_box(block_jacobi.update(&operator, &mut work));
    });
    Ok(Row {
        scene: kind.name().into(),
        size,
        factor_entries: factor.entries,
        factor_flops: factor.flops,
        dissected: factor.ordering == OrderingMethod::NestedDissection,
        force,
        product,
        assembly,
        glance,
        analysis,
        factorization,
        solve,
        iteration_none,
        iteration_jacobi,
        iteration_block_jacobi,
        iteration_multigrid,
        blocks,
        finest_level,
        multigrid_setup,
        solve_of_one_iteration,
    })
}

/// Of two measurements of a scene, the shorter time of each operation. Its sizes are the same in both.
fn shorter(one: &Row, other: &Row) -> serde_json::Result<Row> {
    let (mut row, other) = (serde_json::to_value(one)?, serde_json::to_value(other)?);
    for (name, value) in row.as_object_mut().into_iter().flatten() {
        if value.as_f64().zip(other[name.as_str()].as_f64()).is_some_and(|(one, other)| other < one) {
            *value = other[name.as_str()].clone();
        }
    }
    serde_json::from_value(row)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let mut rows: Vec<Row> = Vec::new();
    for round in 0..ROUNDS {
        let scenes = SCENES.into_iter().flat_map(|(kind, sizes)| sizes.iter().map(move |&size| (kind, size)));
        for (scene, (kind, size)) in scenes.enumerate() {
            eprintln!("{} of {ROUNDS}: {} {size}", round + 1, kind.name());
            let row = pool.install(|| measure(kind, size).map_err(|error| error.to_string()))?;
            match rows.get_mut(scene) {
                Some(shortest) => *shortest = shorter(shortest, &row)?,
                None => rows.push(row),
            }
        }
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("verification/costs.json");
    std::fs::write(path, serde_json::to_string_pretty(&rows)? + "\n")?;
    Ok(())
}
