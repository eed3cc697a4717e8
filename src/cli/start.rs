//! The state that a command works at, where that is not the scene's own start.

use super::common::LoadedScene;
use super::console::Console;
use super::interrupt;
use super::recorder::progress_bar;
use sprung::integrate::{Outcome, Schedule, run};
use sprung::output::read_final_state;
use sprung::plan::{Plan, RunOptions};
use sprung::{Result, State, System};
use std::ops::ControlFlow;
use std::path::PathBuf;

/// A state from a file.
#[derive(Debug, clap::Args)]
pub struct At {
    /// Start at the state of a final.json, as a run writes it, its time included: paths, gravity and rest lengths in time go on from there.
    /// Everything else is the scene's, which may have been changed since; rest lengths that it does not give are still the distances of its own
    /// positions. A prescribed coordinate that is not where its motion has it at that time moves on from where it is
    #[arg(long, value_name = "FILE")]
    at: Option<PathBuf>,
}

impl At {
    /// The scene at the state of the file, if one is given.
    ///
    /// # Errors
    /// A file that cannot be read, or a state that does not fit the scene.
    pub fn place(&self, scene: LoadedScene) -> Result<LoadedScene> {
        let Some(file) = &self.at else { return Ok(scene) };
        let mut state = read_final_state(file, &scene.system)?;
        let system = scene.system.continued_from(&state);
        system.prescribed().set_velocities(state.time, &mut state.velocities);
        Ok(LoadedScene { system, state, at: Some(file.clone()), ..scene })
    }

    /// Whether a file is given.
    pub fn is_given(&self) -> bool {
        self.at.is_some()
    }
}

/// Advances a state as `sprung run --steps N --dt S` does: by linearised backward Euler with on-demand stiffness. `look` sees the state
/// after every step, with its number, and may end it, as an interruption does.
///
/// # Errors
/// Coincident ends of a spring; a matrix that is too large.
pub fn advance(
    console: &Console,
    (system, state): (&System, &mut State),
    (dt, steps): (f64, u64),
    doing: &'static str,
    mut look: impl FnMut(u64, &State) -> ControlFlow<()>,
) -> Result<Outcome> {
    let run_options = RunOptions { interrupt: interrupt::request(), ..RunOptions::default() };
    let Plan { configuration, .. } = run_options.plan(system, state, [dt, dt * steps as f64], None)?;
    let mut stepper = configuration.method.stepper(system, state, &configuration.options)?;
    let bar = progress_bar(console, steps).with_message(doing);
    let outcome = run(stepper.as_mut(), state, &Schedule::steps(dt, steps), |step, state: &State| {
        bar.set_position(step);
        match look(step, state) {
            ControlFlow::Continue(()) if !interrupt::is_requested() => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        }
    });
    bar.finish_and_clear();
    Ok(outcome)
}
