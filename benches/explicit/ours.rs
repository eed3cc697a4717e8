//! Explicit steps of this library beside those of `explicit.c`: `run.py` beside this file calls both.
//!
//! `… export KIND SIZE FOLDER` writes a scene for the program in C, and as `scene.json` for the command. `… serve KIND SIZE` answers every line
//! "KIND STEPS" on its input with the nanoseconds of processor time that a step took, on one thread; `positions FILE` writes
//! where the particles are. `… threads` tells what several threads gain.

#[path = "../scenes.rs"]
mod scenes;

use bytemuck::cast_slice;
use cpu_time::ThreadTime;
use nalgebra::Vector3;
use sprung::force::set_total_force;
use sprung::integrate::{ImplicitOptions, Monitor, MonitorOptions, Schedule, TimeStepper, run_monitored};
use sprung::{Method, State, System, nalgebra};
use std::error::Error;
use std::hint::black_box;
use std::io::{BufRead, Write};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// The step, in s; at it the scenes are stable.
const DT: f64 = 1e-5;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    match &arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["export", kind, size, folder] => export(kind, size.parse()?, Path::new(folder)),
        ["serve", kind, size] => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
            pool.install(|| serve(kind, size.parse().map_err(|_| ())?).map_err(|_| ()))
                .map_err(|()| "cannot serve".into())
        }
        ["threads"] => threads(),
        // `cargo bench` without arguments runs the kernels; this wants to be asked for.
        _ => {
            eprintln!("explicit: run benches/explicit/run.py for the comparison with a program in C");
            Ok(())
        }
    }
}

fn export(kind: &str, size: usize, folder: &Path) -> Result<(), Box<dyn Error>> {
    let scene = scenes::scene(kind, size)?;
    std::fs::write(folder.join("scene.json"), scene.to_json())?;
    let (system, state) = scene.build()?;
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name).with_extension("bin"), bytes);
    let flat = |vectors: &[Vector3<f64>]| vectors.iter().flat_map(|v| [v.x, v.y, v.z]).collect::<Vec<f64>>();
    write("positions", cast_slice(&flat(&state.positions)))?;
    write("velocities", cast_slice(&flat(&state.velocities)))?;
    write("gravity", cast_slice(&flat(&[system.gravity()])))?;
    write("masses", cast_slice(system.masses()))?;
    write("springs", cast_slice(system.pairs()))?;
    let parameters: Vec<f64> = system.springs().iter().flat_map(|s| [s.stiffness, s.rest_length, s.damping]).collect();
    write("parameters", cast_slice(&parameters))?;
    let held: Vec<u32> =
        system.prescribed().iter().filter(|(dof, ..)| dof.axis == 0).map(|(dof, ..)| dof.particle as u32).collect();
    Ok(write("held", cast_slice(&held))?)
}

/// What steps are made with.
struct Runner<'s> {
    system: &'s System,
    stepper: Box<dyn TimeStepper + 's>,
    monitor: Monitor<'s>,
    state: State,
}

impl<'s> Runner<'s> {
    fn new(system: &'s System, start: &State, method: Method) -> sprung::Result<Self> {
        Ok(Self {
            system,
            stepper: method.stepper(system, start, &ImplicitOptions::default())?,
            monitor: Monitor::new(system, start, MonitorOptions::ENERGY)?,
            state: start.clone(),
        })
    }

    fn step(&mut self, steps: u32) -> Result<(), Box<dyn Error>> {
        Ok((0..steps).try_for_each(|_| self.stepper.step(&mut self.state, DT))?)
    }

    /// Steps as the command makes them, but for records.
    fn step_monitored(&mut self, steps: u32) {
        let Self { stepper, state, monitor, .. } = self;
        let schedule = Schedule::steps(DT, steps.into());
        run_monitored(&mut **stepper, state, &schedule, monitor, |_, _, _| ControlFlow::Continue(()));
    }

    fn force(&self, force: &mut [Vector3<f64>]) -> Result<(), Box<dyn Error>> {
        Ok(set_total_force(self.system, &self.state.moment(), black_box(force))?)
    }
}

fn serve(kind: &str, size: usize) -> Result<(), Box<dyn Error>> {
    let (system, start) = scenes::scene(kind, size)?.build()?;
    let mut euler = Runner::new(&system, &start, Method::SymplecticEuler)?;
    let mut verlet = Runner::new(&system, &start, Method::Verlet)?;
    let mut monitored = Runner::new(&system, &start, Method::Verlet)?;
    let mut force = vec![Vector3::zeros(); system.particles()];
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let Some((kind, what)) = line.split_once(' ') else { continue };
        if kind == "positions" {
            let flat: Vec<f64> = verlet.state.positions.iter().flat_map(|x| [x.x, x.y, x.z]).collect();
            std::fs::write(what, cast_slice(&flat))?;
            println!("0");
            continue;
        }
        let steps: u32 = what.parse()?;
        let begin = ThreadTime::now();
        match kind {
            "forces" => (0..steps).try_for_each(|_| euler.force(&mut force))?,
            "symplectic-euler" => euler.step(steps)?,
            "verlet" => verlet.step(steps)?,
            _ => monitored.step_monitored(steps),
        }
        println!("{:.1}", begin.elapsed().as_secs_f64() * 1e9 / f64::from(steps));
        std::io::stdout().flush()?;
    }
    Ok(())
}

/// Forces on one and on two threads in turn, by the clock: the medians of the quotients.
fn threads() -> Result<(), Box<dyn Error>> {
    println!("| scene | springs | one thread, µs | of that on two |\n|---|---|---|---|");
    let pools = [1, 2].map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build());
    let [one, two] = pools;
    let pools = [one?, two?];
    for (kind, size) in
        [("cloth", 40), ("cloth", 52), ("cloth", 60), ("cloth", 100), ("lattice", 22), ("cloth", 316), ("lattice", 46)]
    {
        let (system, state) = scenes::scene(kind, size)?.build()?;
        let mut forces = [vec![Vector3::zeros(); system.particles()], vec![Vector3::zeros(); system.particles()]];
        let calls = 1_000_000usize.div_ceil(system.springs().len());
        let mut quotients = Vec::new();
        let mut fastest = f64::INFINITY;
        for _ in 0..51 {
            let mut times = [0.0; 2];
            for ((pool, time), force) in pools.iter().zip(&mut times).zip(&mut forces) {
                let done: Result<_, _> = pool.install(|| {
                    let begin = Instant::now();
                    (0..calls).try_for_each(|_| set_total_force(&system, &state.moment(), black_box(force)))?;
                    Ok::<_, sprung::error::DegenerateSpring>(begin.elapsed())
                });
                *time = done?.as_secs_f64() * 1e6 / calls as f64;
            }
            fastest = fastest.min(times[0]);
            quotients.push(times[1] / times[0]);
        }
        if forces[0] != forces[1] {
            return Err("the number of threads is in the result".into());
        }
        quotients.sort_by(f64::total_cmp);
        println!(
            "| {kind} {size} | {} | {fastest:.0} | {:.2} |",
            system.springs().len(),
            quotients[quotients.len() / 2]
        );
    }
    Ok(())
}
