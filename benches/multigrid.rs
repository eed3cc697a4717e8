//! Multigrid in work units, and through a motion.
//!
//! `cargo bench --bench multigrid -- [solve] [THREADS [SCENE SIZE [STIFFER [OPTION]]]…]`, for example `solve 2 cloth 316 1 tension`: a
//! solve to 1e-10, set-up included, in products A·w of the same matrix. A product is timed beside every cycle and every set-up, so that
//! what else the machine does slows both; with one thread times are those that it computed, not those that elapsed.
//!
//! `… -- motion THREADS DT STEPS SCENE…`, for example `motion 1 0.01 60 cloth:100 rough:100 verification/scenes/bunny.toml`: iterations to
//! 1e-10 and set-ups of each step of linear backward Euler. `cloth` and `lattice` swing down from rest, `rough` is the cloth of the
//! solves: stiff, and crumpled by 3 % of its spacing.
//!
//! `… -- export FOLDER DT STEPS SCENE` makes the same steps with one thread and writes the systems that they solve into the folder, for other
//! libraries, and what they took: `pattern.bin` has the order and the number of entries (64 bits), where rows begin and the columns of
//! both triangles (32 bits), `dofs.bin` particle and axis of every row, and for every step k `values-k.bin`, `b-k.bin` and
//! `positions-k.bin`; `steps.json` iterations, set-ups and milliseconds of every step. `benches/compare/gamg.py` reads it.

#[path = "scenes.rs"]
mod scenes;

use bytemuck::cast_slice;
use cpu_time::ThreadTime;
use sprung::force::SpringGeometry;
use sprung::integrate::{ImplicitOptions, LinearBackwardEuler, StepMatrices, TimeStepper};
use sprung::linear::{
    CgSolver, CustomPreconditioner, PreconditionerKind, Prepare, SolveFailure, SolverChoice, SolverOptions,
};
use sprung::multigrid::Multigrid;
use sprung::operator::{Combination, LinearOperator, SystemOperator};
use sprung::scene::builtin;
use sprung::work::Work;
use sprung::{Scene, State, Stiffness, System};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Instant;

const SCENES: [&str; 6] = ["cloth 32", "cloth 100", "cloth 316", "lattice 10", "lattice 22", "lattice 46"];

/// Products beside a set-up.
const PRODUCTS: usize = 10;

/// A solve is timed so often that at least this many particles are solved for, and the cheapest counts.
const PARTICLES: usize = 300_000;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let mut words = arguments.iter().map(String::as_str).peekable();
    if let ["export", folder, dt, steps, scene] = words.clone().collect::<Vec<_>>()[..] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        return pool.install(|| motion(scene, dt.parse().unwrap(), steps.parse().unwrap(), Some(Path::new(folder))));
    }
    let is_motion = words.next_if(|word| matches!(*word, "solve" | "motion")) == Some("motion");
    let threads = words.next().map_or(1, |threads| threads.parse().unwrap());
    let rest: Vec<&str> = words.collect();
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
        if is_motion {
            let [dt, steps, scenes @ ..] = &rest[..] else { panic!("DT STEPS SCENE…") };
            scenes.iter().for_each(|scene| motion(scene, dt.parse().unwrap(), steps.parse().unwrap(), None));
        } else if rest.len() < 4 {
            SCENES.iter().for_each(|scene| solve(scene.split_once(' ').unwrap(), 1.0, "tension"));
        } else {
            rest.chunks_exact(4).for_each(|scene| solve((scene[0], scene[1]), scene[2].parse().unwrap(), scene[3]));
        }
    });
}

/// Time of this thread if it does all the work, else time of day.
#[derive(Debug, Clone, Copy)]
enum Clock {
    Thread(ThreadTime),
    Day(Instant),
}

impl Clock {
    fn now() -> Self {
        if rayon::current_num_threads() == 1 { Self::Thread(ThreadTime::now()) } else { Self::Day(Instant::now()) }
    }

    /// Milliseconds since then; starts anew.
    fn lap(&mut self) -> f64 {
        let passed = match self {
            Self::Thread(start) => start.elapsed(),
            Self::Day(start) => start.elapsed(),
        };
        *self = Self::now();
        passed.as_secs_f64() * 1e3
    }
}

/// Parts of a set-up and a solve.
const ROWS: [&str; 4] = ["set-up: smoother", "set-up: coarse levels", "cycles", "conjugate gradients"];

/// Rows of the set-up.
const SETUP: usize = 2;

/// Milliseconds by rows, and those of products beside the set-up and beside the cycles.
#[derive(Debug, Clone, Default)]
struct Times {
    rows: [f64; ROWS.len()],
    setup_products: Vec<f64>,
    products: Vec<f64>,
}

impl Times {
    /// The rows in products.
    fn units(&self) -> [f64; ROWS.len()] {
        let mean = |products: &[f64]| products.iter().sum::<f64>() / products.len() as f64;
        let (setup, solve) = (mean(&self.setup_products), mean(&self.products));
        std::array::from_fn(|row| self.rows[row] / if row < SETUP { setup } else { solve })
    }
}

/// Multigrid that is timed, with a product beside it.
#[derive(Debug)]
struct Timed {
    multigrid: Multigrid,
    a: SystemOperator<'static>,
    w: Vec<f64>,
    y: Vec<f64>,
    times: Arc<Mutex<Times>>,
}

impl CustomPreconditioner for Timed {
    fn name(&self) -> &'static str {
        "timed multigrid"
    }

    fn update(&mut self, a: &SystemOperator, _: &mut Work) -> Result<(), SolveFailure> {
        let mut times = self.times.lock().unwrap();
        *times = Times::default();
        let mut clock = Clock::now();
        for part in 0..2 {
            for _ in 0..PRODUCTS / 2 {
                self.a.apply(&self.w, &mut self.y);
                let time = clock.lap();
                times.setup_products.push(time);
            }
            if part == 0 {
                self.multigrid.refill(a).unwrap();
                times.rows[0] = clock.lap();
                self.multigrid.rebuild(a).unwrap();
                times.rows[1] = clock.lap();
            }
        }
        Ok(())
    }

    fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        let mut times = self.times.lock().unwrap();
        let mut clock = Clock::now();
        self.multigrid.apply(r, z);
        times.rows[2] += clock.lap();
        self.a.apply(&self.w, &mut self.y);
        times.products.push(clock.lap());
    }
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

fn solve((kind, size): (&str, &str), stiffer: f64, option: &str) {
    let (system, state) = scene(kind, size.parse().unwrap(), stiffer);
    // The preconditioner keeps the matrix for its products.
    let system: &'static System = Box::leak(Box::new(system));
    let option = Stiffness::ALL.into_iter().find(|o| o.name() == option).unwrap();
    let extensions = SpringGeometry::at(system, &state.positions).unwrap();
    let a = SystemOperator::new(system, &extensions, option, Combination::step(0.01));
    let b: Vec<f64> = (0..system.dofs().len()).map(|i| (i as f64 * 0.754_877_666).sin()).collect();

    let mut clock = Clock::now();
    let mut multigrid = Multigrid::new(system).unwrap();
    let analysis = clock.lap();
    multigrid.set_positions(&state.positions);
    let levels = multigrid.levels();
    // Its memory is touched for the first time here.
    multigrid.refill(&a).and_then(|()| multigrid.rebuild(&a)).unwrap();
    let first = clock.lap();

    let times = Arc::new(Mutex::new(Times::default()));
    let timed = Timed { multigrid, a: a.clone(), w: b.clone(), y: b.clone(), times: times.clone() };
    let mut solver = CgSolver::with_preconditioner(system, Box::new(timed), 1e-10);
    let mut best: Option<(Times, f64)> = None;
    let mut iterations = 0;
    for _ in 0..PARTICLES.div_ceil(system.particles()).clamp(1, 5) {
        let mut work = Work::default();
        let mut solver = solver.prepare(&a, &mut work).unwrap();
        let mut x = vec![0.0; b.len()];
        // From zeros it would start from the last solution.
        x[0] = 1e-300;
        clock.lap();
        solver.solve(&b, &mut x, &mut work).unwrap();
        let whole = clock.lap();
        let mut times = times.lock().unwrap().clone();
        times.rows[3] = whole - times.rows[2] - times.products.iter().sum::<f64>();
        let units = times.units().iter().sum();
        if best.as_ref().is_none_or(|&(_, least)| units < least) {
            best = Some((times, units));
        }
        iterations = work.cg_iterations;
    }
    let (times, whole) = best.unwrap();
    let units = times.units();
    let product = times.products.iter().sum::<f64>() / times.products.len() as f64;
    println!(
        "{kind} {size} ×{stiffer} {}: {iterations} iterations, {whole:.0} products: set-up {:.0}, solve {:.0} ({:.2} an iteration); a product \
         {product:.2} ms; analysis {:.0} products, first set-up {:.0}; nodes {:?}, entries {:.2}",
        option.name(),
        units[..SETUP].iter().sum::<f64>(),
        units[SETUP..].iter().sum::<f64>(),
        units[SETUP..].iter().sum::<f64>() / iterations as f64,
        analysis / product,
        first / product,
        levels.iter().map(|level| level.nodes).collect::<Vec<_>>(),
        levels.iter().map(|level| level.entries).sum::<usize>() as f64 / levels[0].entries as f64,
    );
    for (row, (name, units)) in ROWS.iter().zip(units).enumerate() {
        let each = if row < SETUP { String::new() } else { format!(", {:.2} an iteration", units / iterations as f64) };
        println!("    {name}: {units:.1}{each}");
    }
}

fn motion(name: &str, dt: f64, steps: usize, folder: Option<&Path>) {
    let (system, mut state) = match name.split_once(':') {
        Some(("cloth", size)) => builtin::cloth(size.parse().unwrap()).unwrap().build().unwrap(),
        Some(("lattice", size)) => builtin::lattice(size.parse().unwrap()).unwrap().build().unwrap(),
        Some((_, size)) => scene("cloth", size.parse().unwrap(), 1.0),
        None => Scene::load(name).unwrap().build().unwrap(),
    };
    let preconditioner = Some(PreconditionerKind::Multigrid);
    let linear = SolverOptions { solver: SolverChoice::Cg, preconditioner, ..Default::default() };
    let options = ImplicitOptions { stiffness: Stiffness::Tension.into(), linear };
    let mut stepper = LinearBackwardEuler::new(&system, &state, &options).unwrap();
    let mut before = Work::default();
    let (mut iterations, mut setups, mut times) = (Vec::new(), Vec::new(), Vec::new());
    for step in 0..steps {
        if let Some(folder) = folder {
            export(&system, &state, dt, step, folder).unwrap();
        }
        let mut clock = Clock::now();
        stepper.step(&mut state, dt).unwrap();
        times.push(clock.lap());
        let work = stepper.statistics().work;
        iterations.push(work.cg_iterations - before.cg_iterations);
        setups.push(work.multigrid_setups - before.multigrid_setups);
        before = work;
    }
    if let Some(folder) = folder {
        let ours = serde_json::json!({ "iterations": iterations, "setups": setups, "ms": times });
        std::fs::write(folder.join("steps.json"), ours.to_string()).unwrap();
    }
    println!(
        "{name}, dt {dt}: {} iterations, {} set-ups; most {}; by steps {iterations:?}; set-ups {setups:?}",
        before.cg_iterations,
        before.multigrid_setups,
        iterations.iter().max().unwrap(),
    );
}

/// Writes the system of a step; that of the first with its pattern.
fn export(system: &System, state: &State, dt: f64, step: usize, folder: &Path) -> std::io::Result<()> {
    let matrices = StepMatrices::assemble(system, state, Stiffness::Tension, dt).unwrap();
    let a = matrices.a.whole_columns().unwrap();
    let write = |name: String, arrays: &[&[u8]]| {
        let mut file = BufWriter::new(File::create(folder.join(name))?);
        arrays.iter().try_for_each(|array| file.write_all(array)).and_then(|()| file.flush())
    };
    if step == 0 {
        let sizes = [matrices.b.len() as u64, a.rows.len() as u64];
        write("pattern.bin".into(), &[cast_slice(&sizes), cast_slice(&a.starts), cast_slice(&a.rows)])?;
        let dofs: Vec<u32> = system.dofs().iter().flat_map(|dof| [dof.particle as u32, dof.axis as u32]).collect();
        write("dofs.bin".into(), &[cast_slice(&dofs)])?;
    }
    let positions: Vec<f64> = state.positions.iter().flat_map(|x| [x.x, x.y, x.z]).collect();
    write(format!("values-{step}.bin"), &[cast_slice(&a.values)])?;
    write(format!("b-{step}.bin"), &[cast_slice(&matrices.b)])?;
    write(format!("positions-{step}.bin"), &[cast_slice(&positions)])
}
