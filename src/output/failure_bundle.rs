//! What is needed to look into a run that ended with an indefinite matrix.

use super::{AtomicFile, write_dofs, write_symmetric, write_vector};
use crate::error::Result;
use crate::inspect::Inspection;
use crate::integrate::StepMatrices;
use crate::operator::LinearOperator;
use crate::report::inspection::InspectionRecord;
use crate::scene::{Scene, TimeSettings};
use crate::system::{State, System};
use std::io::{self, Write};
use std::path::Path;

/// A step that failed because its matrix is indefinite.
#[derive(Debug, Clone, Copy)]
pub struct FailedStep<'a> {
    /// The scene's name.
    pub scene: &'a str,
    /// The system.
    pub system: &'a System,
    /// The state at the start of the step.
    pub state: &'a State,
    /// Steps done before it.
    pub steps: u64,
    /// Its length, in s.
    pub dt: f64,
    /// The inspection of that state, for the dt of the step's matrix.
    pub inspection: &'a Inspection,
}

/// Names of the files of a bundle.
pub const BUNDLE: [&str; 5] = ["scene.toml", "A.mtx", "b.mtx", "dofs.csv", "culprits.json"];

impl FailedStep<'_> {
    /// Writes `scene.toml`, which starts at the state and fails in its first step, `A.mtx` and `b.mtx` of that step's linear
    /// system as linearised backward Euler has it, `dofs.csv` to read them by, and `culprits.json`, the inspection.
    ///
    /// # Errors
    /// A file that cannot be written; a matrix that is too large.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let Self { scene: name, system, state, dt, inspection, .. } = *self;
        let scene = Scene {
            time: TimeSettings { dt: Some(dt), duration: Some(dt) },
            ..Scene::snapshot(&format!("{name} at failure"), system, state)
        };
        AtomicFile::write(folder.join("scene.toml"), |file| file.write_all(scene.to_toml().as_bytes()))?;
        let StepMatrices { a, b, .. } = StepMatrices::assemble(system, state, inspection.option, inspection.dt)?;
        let how = format!("dt = {:?} s, stiffness {}", inspection.dt, inspection.option.name());
        let comment = format!("A = M/dt^2 - G/dt - K, in N/m; {how}\nrows and columns as in dofs.csv");
        let entries = || a.iter().filter(|(_, _, value)| *value != 0.0);
        write_symmetric(folder.join("A.mtx"), &comment, a.order(), entries().count(), entries())?;
        let comment = format!("b = M v/dt + M gravity + f_elastic - A_fc dx_c, in N; {how}\nrows as in dofs.csv");
        write_vector(folder.join("b.mtx"), &comment, &b)?;
        write_dofs(folder.join("dofs.csv"), system.dofs())?;
        let record = InspectionRecord::new(name, self.steps, state.time, inspection);
        AtomicFile::write(folder.join("culprits.json"), |file| {
            serde_json::to_writer_pretty(&mut *file, &record).map_err(io::Error::from)?;
            file.write_all(b"\n")
        })
    }
}
