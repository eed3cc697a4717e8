//! Measures this library for the comparison: `cargo bench --bench compare -- measure KIND SIZE` prints one JSON object a
//! line, `… -- steps KIND SIZE` times whole steps with every solver as the program makes them, `… -- memory KIND SIZE PRECONDITIONER` tells the memory of
//! a run, `… -- export KIND SIZE FOLDER` writes the system for others. `run.py` beside this file calls both.
//!
//! One thread is timed by its processor time, which other programs on the machine do not count into; two threads by the
//! clock. Every figure is the median of repeats, and the floors' bandwidth is measured between them.

#[path = "../scenes.rs"]
mod scenes;

use bytemuck::cast_slice;
use cpu_time::ThreadTime;
use serde_json::json;
use sprung::assembly::{SpringPattern, SystemMatrix};
use sprung::force::{SpringGeometry, add_elastic_force, add_weight};
use sprung::integrate::{ImplicitOptions, LinearBackwardEuler, TimeStepper};
use sprung::linear::{
    CgOutcome, Cholesky, CholeskyPlan, ConjugateGradient, Preconditioner, PreconditionerKind, SolverChoice,
    SolverOptions,
};
use sprung::operator::{Combination, LinearOperator, SystemOperator};
use sprung::plan::parallelism;
use sprung::work::Work;
use sprung::{State, Stiffness, System};
use std::fs::File;
use std::hint::black_box;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The step, in s.
const DT: f64 = 0.01;

/// Particles from which what takes very long is left out.
const HUGE: usize = 200_000;

/// Factorizations of more operations than this are measured on all threads only, and twice.
const LARGE_FACTOR: f64 = 2e11;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    match &arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["steps", kind, size] => steps(kind, size),
        ["memory", kind, size, preconditioner] => memory(kind, size, preconditioner),
        ["export", kind, size, folder] => export(kind, size, Path::new(folder)).expect("files that can be written"),
        ["measure", kind, size] => measure(kind, size, ""),
        ["measure", kind, size, stage] => measure(kind, size, stage),
        // `cargo bench` without arguments runs the kernels; the comparison wants to be asked for.
        _ => eprintln!("compare: run benches/compare/run.py for the comparison with other libraries"),
    }
}

fn scene(kind: &str, size: &str) -> sprung::Scene {
    scenes::scene(kind, size.parse().expect("SIZE is a number")).expect("a scene of that size")
}

fn measure(kind: &str, size: &str, only: &str) {
    let (system, state) = scene(kind, size).build().expect("a valid scene");
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            Measurement { name: format!("{kind} {size}"), system: &system, state: &state, threads, only }.all()
        });
    }
}

/// The step's matrix and right-hand side, and what an assembly or a near-null space needs, as plain arrays:
/// `a.bin` is n and the number of entries of the lower triangle (64 bits), column starts, rows (32 bits), values;
/// `dofs.bin` particle and axis of every row; `springs.bin` ends of every spring, `parameters.bin` its k, l0 and b.
fn export(kind: &str, size: &str, folder: &Path) -> std::io::Result<()> {
    let (system, state) = scene(kind, size).build().expect("a valid scene");
    let extensions = SpringGeometry::at(&system, &state.positions).expect("no coincident ends");
    let operator = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(DT));
    let pattern = Arc::new(SpringPattern::of_stiffness(&system).expect("a matrix that fits"));
    let a = SystemMatrix::assemble(pattern, &operator);
    let a = a.matrix();
    let symbolic = a.pattern().symbolic();
    let write = |name: &str, arrays: &[&[u8]]| {
        let mut file = BufWriter::new(File::create(folder.join(name))?);
        arrays.iter().try_for_each(|array| file.write_all(array)).and_then(|()| file.flush())
    };
    let sizes = [a.pattern().order() as u64, a.values().len() as u64];
    let arrays =
        [cast_slice(&sizes), cast_slice(symbolic.col_ptr()), cast_slice(symbolic.row_idx()), cast_slice(a.values())];
    write("a.bin", &arrays)?;
    write("b.bin", &[cast_slice(&test_vector(system.dofs().len()))])?;
    let dofs: Vec<u32> = system.dofs().iter().flat_map(|dof| [dof.particle as u32, dof.axis as u32]).collect();
    write("dofs.bin", &[cast_slice(&dofs)])?;
    let positions: Vec<f64> = state.positions.iter().flat_map(|x| [x.x, x.y, x.z]).collect();
    write("positions.bin", &[cast_slice(&positions)])?;
    write("masses.bin", &[cast_slice(system.masses())])?;
    let ends: Vec<u32> = system.active().flat_map(|(_, pair, _)| pair.map(|end| end as u32)).collect();
    write("springs.bin", &[cast_slice(&ends)])?;
    let parameters: Vec<f64> = system.active().flat_map(|(.., s)| [s.stiffness, s.rest_length, s.damping]).collect();
    write("parameters.bin", &[cast_slice(&parameters)])
}

/// Whole steps with every solver: five, after five in which an automatic choice has been made.
fn steps(kind: &str, size: &str) {
    let (system, state) = scene(kind, size).build().expect("a valid scene");
    let plan = CholeskyPlan::new(&system, faer::Par::Seq, &mut Work::default());
    let flops = plan.map_or(f64::INFINITY, |plan| plan.size().flops);
    let name = format!("{kind} {size}");
    let solvers = [
        ("auto", SolverChoice::Auto, None),
        ("llt", SolverChoice::Llt, None),
        ("cg block-jacobi", SolverChoice::Cg, Some(PreconditionerKind::BlockJacobi)),
        ("cg multigrid", SolverChoice::Cg, Some(PreconditionerKind::Multigrid)),
    ];
    for (label, solver, preconditioner) in solvers {
        let takes_long = match preconditioner {
            Some(PreconditionerKind::BlockJacobi) => system.particles() > HUGE,
            _ => solver == SolverChoice::Llt && flops > LARGE_FACTOR,
        };
        if takes_long {
            continue;
        }
        let par = parallelism(&system);
        let linear = SolverOptions { solver, preconditioner, par, ..Default::default() };
        let options = ImplicitOptions { stiffness: Stiffness::Tension.into(), linear };
        let mut stepper = LinearBackwardEuler::new(&system, &state, &options).expect("a system that can be stepped");
        let mut moving = state.clone();
        let mut five = || {
            let start = Instant::now();
            (0..5).for_each(|_| stepper.step(&mut moving, DT).expect("a step"));
            start.elapsed()
        };
        let (first, time) = (five(), five());
        let used = stepper.linear_solver().map_or("", |solver| solver.name());
        let line = json!({"scene": name, "particles": system.particles(), "library": "sprung", "threads": 2,
            "stage": format!("five steps, {label}"), "ms": ms(time), "first_five_ms": ms(first), "used": used, "work": stepper.statistics().work});
        println!("{line}");
    }
}

/// What two steps by conjugate gradients hold at once, all in all, a particle.
fn memory(kind: &str, size: &str, preconditioner: &str) {
    let kinds = [PreconditionerKind::BlockJacobi, PreconditionerKind::Multigrid];
    let preconditioner = kinds.into_iter().find(|kind| kind.name() == preconditioner);
    let (system, state) = scene(kind, size).build().expect("a valid scene");
    let resident = || {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let line =
            status.lines().find(|line| line.starts_with("VmRSS:")).and_then(|line| line.split_whitespace().nth(1));
        line.and_then(|kilobytes| kilobytes.parse::<f64>().ok()).unwrap_or(f64::NAN) * 1024.0
    };
    let linear = SolverOptions { solver: SolverChoice::Cg, preconditioner, ..Default::default() };
    let options = ImplicitOptions { stiffness: Stiffness::Tension.into(), linear };
    let mut stepper = LinearBackwardEuler::new(&system, &state, &options).expect("a system that can be stepped");
    let mut moving = state.clone();
    (0..2).for_each(|_| stepper.step(&mut moving, DT).expect("a step"));
    let label = preconditioner.map_or("automatic", PreconditionerKind::name);
    let line = json!({"scene": format!("{kind} {size}"), "particles": system.particles(), "library": "sprung", "threads": 2,
        "stage": format!("memory {label}"), "bytes": resident(), "bytes_per_particle": resident() / system.particles() as f64});
    println!("{line}");
}

fn test_vector(n: usize) -> Vec<f64> {
    (0..n).map(|i| (i as f64 * 1.3).cos()).collect()
}

struct Measurement<'s> {
    name: String,
    system: &'s System,
    state: &'s State,
    threads: usize,
    /// What the names of the measured stages begin with.
    only: &'s str,
}

impl Measurement<'_> {
    fn all(&self) {
        let Self { system, state, .. } = self;
        let extensions = SpringGeometry::at(system, &state.positions).expect("no coincident ends");
        let step = Combination::step(DT);
        let mut operator = SystemOperator::new(system, &extensions, Stiffness::Tension, step);
        let n = system.dofs().len();
        let w: Vec<f64> = (0..n).map(|i| (i as f64 * 0.7).sin()).collect();
        let mut y = vec![0.0; n];
        self.print("product", || operator.apply(&w, &mut y), self.product_bytes());

        let pattern = Arc::new(SpringPattern::of_stiffness(system).expect("a matrix that fits"));
        let mut matrix = SystemMatrix::zeros(pattern);
        matrix.refill(&operator);
        let bytes = self.refill_bytes(matrix.matrix().values().len());
        self.print("refill A", || matrix.refill(&operator), bytes);
        let mut force = vec![nalgebra::Vector3::zeros(); system.particles()];
        let right_hand_side = || {
            for ((b, mass), v) in force.iter_mut().zip(system.masses()).zip(&state.velocities) {
                *b = v * (mass / DT);
            }
            add_weight(system, &mut force);
            add_elastic_force(system, &extensions, &mut force);
        };
        self.print("right-hand side", right_hand_side, self.force_bytes());
        self.print("blocks", || operator.update(&extensions, Stiffness::Tension, step), self.block_bytes());

        let b = test_vector(n);
        let simple = [PreconditionerKind::None, PreconditionerKind::Jacobi].into_iter();
        let better = [PreconditionerKind::BlockJacobi, PreconditionerKind::Multigrid];
        for kind in simple.filter(|_| system.particles() < HUGE).chain(better) {
            if format!("cg {}", kind.name()).starts_with(self.only) {
                self.conjugate_gradients(kind, &operator, &b);
            }
        }
        if ["direct", "analyse"].iter().any(|stage| stage.starts_with(self.only)) {
            self.direct(&matrix, &b);
        }
    }

    /// Set-up and solve with new numbers on memory in use, as in every step but the first.
    fn conjugate_gradients(&self, kind: PreconditionerKind, operator: &SystemOperator, b: &[f64]) {
        let mut preconditioner = Preconditioner::new(kind, self.system).expect("a matrix that fits");
        let mut method = ConjugateGradient::new(b.len(), 1e-10);
        let mut x = vec![0.0; b.len()];
        let mut work = Work::default();
        preconditioner.set_positions(&self.state.positions);
        let mut run = || {
            x.fill(0.0);
            let start = Clock::start(self.threads);
            // Coarse levels are new every time: nothing takes note of what they cost.
            let before = work.multigrid_setups;
            preconditioner.update(operator, &mut work).expect("a definite matrix");
            assert_eq!(work.multigrid_setups - before, u64::from(kind == PreconditionerKind::Multigrid));
            let setup = start.elapsed();
            let report = method.solve(operator, &mut preconditioner, b, &mut x);
            (start.elapsed(), setup, report)
        };
        let first = run();
        let seconds = first.0.as_secs_f64();
        let repeats = (2.0 / seconds).clamp(1.0, 21.0) as usize;
        let first_ms = ms(first.0);
        let mut runs: Vec<_> = if seconds > 10.0 { vec![first] } else { (0..repeats).map(|_| run()).collect() };
        runs.sort_unstable_by_key(|(time, ..)| *time);
        let (time, setup, report) = &runs[runs.len() / 2];
        let solved = report.outcome == CgOutcome::Converged;
        let with =
            json!({"setup_ms": ms(*setup), "first_ms": first_ms, "iterations": report.iterations, "solved": solved});
        self.line(&format!("cg {}", kind.name()), *time, with);
    }

    fn direct(&self, matrix: &SystemMatrix, b: &[f64]) {
        let par = if self.threads == 1 { faer::Par::Seq } else { faer::Par::rayon(self.threads) };
        // As the peer's, without the memory for the factor.
        let start = Clock::start(self.threads);
        let plan = CholeskyPlan::new(self.system, par, &mut Work::default()).expect("a matrix that fits");
        let analysis = start.elapsed();
        let (flops, size) = (plan.size().flops, plan.size());
        let size = json!({"entries": size.entries, "flops": size.flops, "ordering": size.ordering});
        self.line("analyse", analysis, size.clone());
        let is_too_large = flops > LARGE_FACTOR && self.threads == 1;
        if is_too_large || !"direct".starts_with(self.only) {
            return;
        }
        let mut cholesky = Cholesky::analyse(matrix.matrix().pattern(), par).expect("a factor that fits");
        self.time("factor", || cholesky.factor(matrix.matrix()).expect("a definite matrix"), size);
        let mut x = b.to_vec();
        self.time("solve", || cholesky.solve_in_place(&mut x).expect("a vector that fits"), json!({}));
    }

    /// Prints a kernel's time beside its floor: the bytes that it must move over the bandwidth measured between repeats.
    fn print(&self, stage: &str, mut kernel: impl FnMut(), bytes: usize) {
        if !stage.starts_with(self.only) {
            return;
        }
        let mut triad = Triad::new(self.threads);
        let repeats = (400_000_000 / bytes).clamp(15, 401);
        let mut times = Vec::with_capacity(repeats);
        let mut bandwidths = Vec::with_capacity(repeats / 4 + 1);
        kernel();
        for repeat in 0..repeats {
            times.push(self.once(&mut kernel));
            if repeat % 4 == 0 {
                bandwidths.push(triad.bytes() as f64 / self.once(|| triad.run()).as_secs_f64());
            }
        }
        let bandwidth = quantile(&mut bandwidths, 0.5);
        let floor = bytes as f64 / bandwidth;
        times.sort_unstable();
        let time = times[times.len() / 2];
        let ratio = time.as_secs_f64() / floor;
        let best = ms(times[0]);
        let bandwidth = bandwidth * 1e-9;
        self.line(
            stage,
            time,
            json!({"best_ms": best, "floor_ms": floor * 1e3, "ratio": ratio, "gb_per_s": bandwidth}),
        );
    }

    /// The first call, which takes new memory from the system, does not count.
    fn time(&self, stage: &str, mut kernel: impl FnMut(), with: serde_json::Value) {
        let first = self.once(&mut kernel).as_secs_f64();
        let repeats = if first > 10.0 { 1 } else { (1.0 / first).clamp(3.0, 21.0) as usize };
        let mut times: Vec<_> = (0..repeats).map(|_| self.once(&mut kernel)).collect();
        times.sort_unstable();
        self.line(stage, times[times.len() / 2], with);
    }

    fn once(&self, kernel: impl FnOnce()) -> Duration {
        let start = Clock::start(self.threads);
        kernel();
        start.elapsed()
    }

    fn line(&self, stage: &str, time: Duration, with: serde_json::Value) {
        let mut line = json!({"scene": self.name, "particles": self.system.particles(), "library": "sprung",
            "threads": self.threads, "stage": stage, "ms": ms(time)});
        if let (Some(line), serde_json::Value::Object(with)) = (line.as_object_mut(), with) {
            line.extend(with);
        }
        println!("{line}");
    }

    /// Per spring α, g and an index, as four in a row share theirs; per row w and the mass read and y written (which reads its line first).
    fn product_bytes(&self) -> usize {
        36 * self.system.active_springs().len() + 32 * self.system.dofs().len()
    }

    /// Every block read, every value written.
    fn refill_bytes(&self, values: usize) -> usize {
        40 * self.system.active_springs().len() + 16 * values
    }

    /// Extension, parameters and indices of every spring read; b written, masses and velocities read.
    fn force_bytes(&self) -> usize {
        68 * self.system.active_springs().len() + (48 + 8 + 24) * self.system.particles()
    }

    /// Extension, parameters and indices of every spring read; block and record written.
    fn block_bytes(&self) -> usize {
        (68 + 160) * self.system.active_springs().len()
    }
}

/// Processor time of this thread where it works alone, the clock where others work with it.
enum Clock {
    Thread(ThreadTime),
    Wall(Instant),
}

impl Clock {
    fn start(threads: usize) -> Self {
        if threads == 1 { Self::Thread(ThreadTime::now()) } else { Self::Wall(Instant::now()) }
    }

    fn elapsed(&self) -> Duration {
        match self {
            Self::Thread(start) => start.elapsed(),
            Self::Wall(start) => start.elapsed(),
        }
    }
}

/// `a = b + 3 c` on vectors far larger than the caches: what the memory can deliver.
struct Triad {
    threads: usize,
    a: Vec<f64>,
    b: Vec<f64>,
    c: Vec<f64>,
}

impl Triad {
    const LENGTH: usize = 8_000_000;

    fn new(threads: usize) -> Self {
        let vector = |value| vec![value; Self::LENGTH];
        Self { threads, a: vector(0.0), b: vector(1.0), c: vector(2.0) }
    }

    /// Two vectors read, one written, which reads its lines first.
    fn bytes(&self) -> usize {
        32 * Self::LENGTH
    }

    fn run(&mut self) {
        let triad = |a: &mut [f64], b: &[f64], c: &[f64]| {
            for ((a, b), c) in a.iter_mut().zip(b).zip(c) {
                *a = b + 3.0 * c;
            }
        };
        let half = if self.threads == 1 { 0 } else { Self::LENGTH / 2 };
        let ((a0, a1), (b0, b1), (c0, c1)) = (self.a.split_at_mut(half), self.b.split_at(half), self.c.split_at(half));
        if half == 0 {
            triad(a1, b1, c1);
        } else {
            rayon::join(|| triad(a0, b0, c0), || triad(a1, b1, c1));
        }
        black_box(&mut self.a);
    }
}

fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * q) as usize]
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}
