//! `sprung matrix`: the linear system of a step as Matrix Market files.

use super::Stop;
use super::common::{At, LoadedScene, Process, SceneFile, advance, choice, claim, positive, whole};
use super::console::{Console, count, number};
use super::threads::{end_in_order, is_interrupted};
use serde_json::json;
use sprung::assembly::SymmetricMatrix;
use sprung::integrate::{Outcome, StepMatrices};
use sprung::output::{write_dofs, write_symmetric, write_vector};
use sprung::{Result, Stiffness};
use std::ops::ControlFlow;
use std::path::Path;

/// Write the matrices of a step as Matrix Market files
///
/// Assembles A δx = b of the linearised backward Euler step at the initial state, after --steps, or at the state of a file, with A = M/dt² − G/dt −
/// K, over the free degrees of freedom, ordered by particle, then axis. Writes A.mtx (N/m), M.mtx (kg), G.mtx (N·s/m), K.mtx (N/m) and b.mtx (N), and
/// dofs.csv, which says for every row its particle and axis, counted from 0. Of the symmetric matrices the lower triangle is written. G and K are
/// negative semidefinite where nothing is compressed; prescribed motion has been moved to b.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Matrix {
    #[command(flatten)]
    scene: SceneFile,

    /// Time step, in seconds [default: the scene's time.dt, or 0.01]
    #[arg(long, value_name = "S", value_parser = positive)]
    dt: Option<f64>,

    /// Assemble at the state after so many steps, those of `sprung run --steps N`, from the start or the state of --at
    #[arg(long, value_name = "N", value_parser = whole, default_value = "0")]
    steps: u64,

    #[command(flatten)]
    at: At,

    /// Which part of every spring's stiffness enters K and A
    #[arg(long, value_name = "OPTION", default_value = "full", value_parser = choice(&STIFFNESSES, Stiffness::name))]
    stiffness: Stiffness,

    #[command(flatten)]
    process: Process,
}

const STIFFNESSES: [(Stiffness, &str); 4] = [
    (Stiffness::Full, "the exact stiffness; A may be indefinite when springs are compressed"),
    (Stiffness::Tension, "drop the transverse terms of compressed springs; A is positive definite"),
    (Stiffness::Axial, "drop all transverse terms; A is positive definite"),
    (Stiffness::Absolute, "the transverse terms of compressed springs with the other sign; A is positive definite"),
];

const FILES: [&str; 6] = ["A.mtx", "M.mtx", "G.mtx", "K.mtx", "b.mtx", "dofs.csv"];

impl Matrix {
    pub fn execute(&self, console: &Console) -> Result<(), Stop> {
        let mut scene = self.at.place(self.scene.load(console)?)?;
        let dt = scene.step_or_default(console, self.dt);
        if self.steps > 0 {
            end_in_order();
        }
        let matrices = self.process.threads.install(|| {
            self.advance(console, &mut scene, dt)?;
            let matrices = StepMatrices::assemble(&scene.system, &scene.state, self.stiffness, dt);
            Ok(matrices.map_err(|error| error.in_file(&scene.file))?)
        })?;
        if let Some(name) = not_finite(&matrices) {
            let message = format!("{name} has entries that are not finite numbers (dt = {} s)", number(dt));
            return Err(Stop::Computation(message));
        }
        let folder = self.process.folder(&scene);
        end_in_order();
        let _claimed = claim(&folder, &FILES, false)?;
        let how = format!("t = {:?} s, dt = {dt:?} s, stiffness {}", scene.state.time, self.stiffness.name());
        let written = write(&folder, &scene, &matrices, &how);
        if is_interrupted() {
            return Err(Stop::Computation("interrupted: not every matrix was written".into()));
        }
        written.map_err(Stop::Broken)?;
        let LoadedScene { name, system, state, .. } = &scene;
        let [a, g, k] = [&matrices.a, &matrices.g, &matrices.k].map(|matrix| nonzeros(matrix).count());
        let report = json!({
            "scene": name,
            "time": state.time,
            "dt": dt,
            "stiffness": self.stiffness.name(),
            "particles": system.particles(),
            "springs": system.springs().len(),
            "dofs": system.dofs().len(),
            // Nonzero entries of the lower triangles.
            "entries": {"A": a, "M": matrices.m.len(), "G": g, "K": k},
            "out": folder.display().to_string(),
        });
        let text = format!(
            "{name} at t = {} s: {}, {a} entries in the lower triangle of A\n\
             A.mtx, M.mtx, G.mtx, K.mtx, b.mtx and dofs.csv are in {}",
            number(state.time),
            count(system.dofs().len() as u64, "degree of freedom"),
            folder.display(),
        );
        console.result(&report, text)
    }

    fn advance(&self, console: &Console, scene: &mut LoadedScene, dt: f64) -> Result<(), Stop> {
        if self.steps == 0 {
            return Ok(());
        }
        let LoadedScene { file, system, state, .. } = scene;
        let outcome =
            advance(console, (system, state), (dt, self.steps), "on the way", |_, _| ControlFlow::Continue(()));
        match outcome.map_err(|error| error.in_file(file))? {
            Outcome { end: Ok(ControlFlow::Continue(())), .. } => Ok(()),
            Outcome { end: Ok(ControlFlow::Break(())), steps } => {
                Err(Stop::Computation(format!("interrupted after step {steps}: no matrix was written")))
            }
            Outcome { end: Err(failure), .. } => Err(failure.into()),
        }
    }
}

fn not_finite(matrices: &StepMatrices) -> Option<&'static str> {
    let StepMatrices { a, m, g, k, b } = matrices;
    let parts = [("M", m.as_slice()), ("G", g.values()), ("K", k.values()), ("A", a.values()), ("b", b)];
    parts.into_iter().find(|(_, values)| !values.iter().all(|value| value.is_finite())).map(|(name, _)| name)
}

/// The entries of a file: by the format's definition the nonzero ones.
fn nonzeros(matrix: &SymmetricMatrix) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
    matrix.iter().filter(|&(_, _, value)| value != 0.0)
}

fn write(folder: &Path, scene: &LoadedScene, matrices: &StepMatrices, how: &str) -> Result<()> {
    let matrix = |name: &str, meaning: &str, matrix: &SymmetricMatrix| {
        let comment = format!("{meaning}; {how}\nrows and columns as in dofs.csv");
        // An interruption makes the file fail for want of entries.
        let entries = nonzeros(matrix).take_while(|_| !is_interrupted());
        write_symmetric(folder.join(name), &comment, matrix.dofs().len(), nonzeros(matrix).count(), entries)
    };
    matrix("A.mtx", "A = M/dt^2 - G/dt - K, in N/m", &matrices.a)?;
    let comment = format!("M, the masses, in kg; {how}\nrows and columns as in dofs.csv");
    let masses = matrices.m.iter().enumerate().map(|(row, mass)| (row, row, *mass));
    write_symmetric(folder.join("M.mtx"), &comment, masses.len(), masses.len(), masses)?;
    matrix("G.mtx", "G = d f_damping/d v, in N s/m", &matrices.g)?;
    matrix("K.mtx", "K = d f_elastic/d x, in N/m", &matrices.k)?;
    let comment = format!("b = M v/dt + M gravity + f_elastic - A_fc dx_c, in N; {how}\nrows as in dofs.csv");
    write_vector(folder.join("b.mtx"), &comment, &matrices.b)?;
    write_dofs(folder.join("dofs.csv"), scene.system.dofs())
}
