//! What a run that ended with an indefinite matrix says about itself.

use super::console::{Console, error, help};
use sprung::inspect::Inspection;
use sprung::output::FailedStep;
use sprung::plan::parallelism;
use sprung::report::inspection::explain;
use sprung::{Result, State, Stiffness, System};
use std::path::Path;

/// The step that could not be done.
pub struct Failed<'a> {
    pub scene: &'a str,
    pub system: &'a System,
    pub state: &'a State,
    /// Steps done before it.
    pub steps: u64,
    /// Its length, in s.
    pub step: f64,
    /// Whether transverse terms were dropped on demand.
    pub is_on_demand: bool,
    /// The arguments with which it was done.
    pub repeat: String,
}

/// Degrees of freedom beyond which a failure is not inspected: it would take longer than a user waits.
const LARGEST_INSPECTED: usize = 200_000;

impl Failed<'_> {
    /// Says in three lines what is wrong and what would carry on, and writes the files to look into it.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn explain(&self, console: &Console, option: Stiffness, matrix_dt: f64, folder: &Path) -> Result<()> {
        let Self { scene, system, state, steps, step, is_on_demand, ref repeat } = *self;
        if system.dofs().len() > LARGEST_INSPECTED {
            console.note("the system is too large to be inspected here: see sprung inspect");
            return Ok(());
        }
        let inspection = Inspection::at(system, state, matrix_dt, option, parallelism(system))?;
        let (causes, remedy) = explain(&inspection, step);
        causes.into_iter().for_each(error);
        // What carries on under another policy is no help where that one was at work.
        if let Some(remedy) = remedy.filter(|_| !is_on_demand) {
            help(remedy);
        }
        FailedStep { scene, system, state, steps, dt: step, inspection: &inspection }.write(folder)?;
        let file = folder.join("scene.toml");
        let command = format!("sprung run '{}' {repeat}", file.display());
        console.note(format_args!("{} has A, b and the culprits", folder.display()));
        help(format_args!("this repeats the step: {command}"));
        Ok(())
    }
}
