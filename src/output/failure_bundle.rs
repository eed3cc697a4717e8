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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::{Spring, Stiffness};
    use crate::system::SystemBuilder;

    /// 1 kg on a spring of 100 N, pressed to half its length, and a step of 1 s: along the spring A is 1 + 100, across it 1 − 100, and
    /// nothing couples the two. The spring pushes with 50 N. The scene repeats one step, of the length that the run had.
    #[test]
    fn a_bundle_has_the_step_that_failed() {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        builder.particle([0.0; 3], 1.0);
        builder.particle([0.5, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
        builder.hold(0);
        let (system, state) = builder.build().unwrap();
        let inspection = Inspection::at(&system, &state, 1.0, Stiffness::Full, faer::Par::Seq).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let step =
            FailedStep { scene: "s", system: &system, state: &state, steps: 3, dt: 0.25, inspection: &inspection };
        step.write(folder.path()).unwrap();
        let text = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
        assert!(BUNDLE.iter().all(|name| !text(name).is_empty()));
        let time = Scene::load(folder.path().join("scene.toml")).unwrap().time;
        assert_eq!((time.dt, time.duration), (Some(0.25), Some(0.25)));
        let numbers = |name: &str| -> Vec<f64> {
            let text = text(name);
            let lines = text.lines().filter(|line| !line.starts_with('%'));
            lines.flat_map(str::split_whitespace).map(|word| word.parse().unwrap()).collect()
        };
        // Order and number of entries, then row, column and value of each.
        assert_eq!(numbers("A.mtx"), [2.0, 2.0, 2.0, 1.0, 1.0, 101.0, 2.0, 2.0, -99.0]);
        assert_eq!(numbers("b.mtx"), [2.0, 1.0, 50.0, 0.0]);
    }
}
