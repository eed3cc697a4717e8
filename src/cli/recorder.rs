//! What is written and shown while a run is under way.

use super::console::Console;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use sprung::force::Energy;
use sprung::integrate::Schedule;
use sprung::output::{EnergyChange, EnergyLog, Frames};
use sprung::{Result, State, System};
use std::num::NonZeroU64;
use std::path::Path;

/// Energies, frames and the progress bar.
pub struct Recorder {
    energies: EnergyLog,
    frames: Option<Frames>,
    progress: ProgressBar,
    initial: Energy,
    last: Energy,
}

impl Recorder {
    /// Starts the files and records the initial state.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn start(
        console: &Console,
        folder: &Path,
        frames: Option<NonZeroU64>,
        schedule: &Schedule,
        system: &System,
        state: &State,
    ) -> Result<Self> {
        let initial = Energy::of(system, state);
        let mut recorder = Self {
            energies: EnergyLog::create(folder.join("energy.csv"))?,
            frames: frames.map(|every| Frames::new(folder, every)),
            progress: progress_bar(console, schedule.len()),
            initial,
            last: initial,
        };
        recorder.record(system, state, 0)?;
        Ok(recorder)
    }

    /// Records the state after `step` steps.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn record(&mut self, system: &System, state: &State, step: u64) -> Result<()> {
        self.last = Energy::of(system, state);
        self.energies.push(state.time, &self.last)?;
        if let Some(frames) = &mut self.frames {
            frames.record(system, state, step)?;
        }
        if !self.progress.is_hidden() {
            self.progress.set_position(step);
            self.progress.set_message(format!("t = {:.4} s", state.time));
        }
        Ok(())
    }

    /// Energy at the start and now.
    pub fn energy(&self) -> EnergyChange {
        EnergyChange::between(&self.initial, &self.last)
    }

    /// Completes the files.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn finish(self) -> Result<()> {
        self.progress.finish_and_clear();
        self.energies.finish()?;
        self.frames.map_or(Ok(()), Frames::finish)
    }
}

/// A bar on stderr; indicatif shows it only on a terminal.
fn progress_bar(console: &Console, steps: u64) -> ProgressBar {
    let target = if console.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(steps), target);
    match ProgressStyle::with_template("{wide_bar} step {pos} of {len}, {msg}, {eta} left") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
