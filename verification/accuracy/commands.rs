//! Whole commands, timed: `sprung run` with an accuracy, beside the one that makes the cheapest single run.

use crate::timing::shortest;
use sprung::accuracy::{Configuration, StepControl};
use sprung::integrate::Equations;
use sprung::scene::Scene;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// The program, and a folder of its own for scenes and results.
pub struct Commands {
    program: PathBuf,
    folder: tempfile::TempDir,
}

/// A scene in a file.
#[derive(Clone, Copy)]
pub struct Timed<'a> {
    commands: &'a Commands,
    scene: &'a Path,
}

impl Commands {
    /// Builds the program.
    pub fn build(root: &Path) -> Result<Self, Box<dyn Error>> {
        let mut cargo = Command::new("cargo");
        let build = cargo.current_dir(root).args(["build", "--release", "--quiet", "--bin", "sprung"]).status()?;
        if !build.success() {
            return Err("the program does not build".into());
        }
        // The tool itself is in the same folder.
        let program = std::env::current_exe()?.with_file_name("sprung");
        Ok(Self { program, folder: tempfile::tempdir()? })
    }

    /// Where the next scene stands.
    pub fn scene(&self, scene: &Scene) -> Result<PathBuf, Box<dyn Error>> {
        let path = self.folder.path().join("scene.json");
        fs::write(&path, scene.to_json())?;
        Ok(path)
    }

    /// The command that runs that scene.
    pub fn on<'a>(&'a self, scene: &'a Path) -> Timed<'a> {
        Timed { commands: self, scene }
    }
}

impl Timed<'_> {
    /// The time of the answer over that of the cheapest run.
    pub fn slower(&self, accuracy: f64, single: &Configuration, pace: StepControl) -> Result<f64, Box<dyn Error>> {
        let answer = self.time(&["--accuracy".into(), format!("{accuracy:e}")])?;
        Ok(answer / self.time(&words(single, pace))?)
    }

    /// In s. A run may end unconfirmed: that is its answer.
    fn time(&self, words: &[String]) -> Result<f64, Box<dyn Error>> {
        let out = self.commands.folder.path().join("out");
        shortest(|| {
            if out.exists() {
                fs::remove_dir_all(&out)?;
            }
            let mut command = Command::new(&self.commands.program);
            command.args(["--quiet", "run", "--threads", "1"]).arg(self.scene).args(words).arg("--out").arg(&out);
            let clock = Instant::now();
            let output = command.output()?;
            let time = clock.elapsed().as_secs_f64();
            if !out.join("summary.json").exists() {
                return Err(format!("{command:?}: {}", String::from_utf8_lossy(&output.stderr)).into());
            }
            Ok(time)
        })
    }
}

/// The arguments for a configuration and a step control.
fn words(Configuration { method, options }: &Configuration, pace: StepControl) -> Vec<String> {
    let mut words = vec!["--method".into(), method.name().into()];
    let mut add = |option: &str, value: String| words.extend([option.into(), value]);
    match pace {
        StepControl::Step(dt) => add("--dt", format!("{dt:e}")),
        StepControl::Adaptive { rtol, .. } => add("--rtol", format!("{rtol:e}")),
    }
    if method.is_implicit() {
        add("--solver", options.linear.solver.name().into());
    }
    if matches!(method.equations(), Equations::Linear | Equations::Nonlinear) {
        add("--stiffness", options.stiffness.name().into());
    }
    words
}
