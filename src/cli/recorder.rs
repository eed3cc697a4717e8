//! What is written and shown while a run is under way.

use super::console::Console;
use super::number;
use super::time::roughly;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use sprung::integrate::{Monitor, Schedule};
use sprung::output::{Checkpoint, EnergyLog, Frames, LogPosition};
use sprung::{Result, State, System};
use std::fmt::Write;
use std::path::Path;

/// Energies, frames and the progress bar.
pub struct Recorder {
    energies: EnergyLog,
    frames: Option<Frames>,
    progress: ProgressBar,
}

impl Recorder {
    /// Records the initial state.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn start(
        console: &Console,
        energies: EnergyLog,
        frames: Option<Frames>,
        schedule: &Schedule,
        system: &System,
        state: &State,
        monitor: &Monitor,
    ) -> Result<Self> {
        let mut recorder = Self { energies, frames, progress: progress_bar(console, schedule.len()) };
        recorder.record(system, state, 0, monitor)?;
        Ok(recorder)
    }

    /// As [`start`](Self::start), of a run whose progress is shown otherwise.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn silent(
        folder: &Path,
        frames: Option<Frames>,
        system: &System,
        state: &State,
        monitor: &Monitor,
    ) -> Result<Self> {
        let energies = EnergyLog::create(folder.join("energy.csv"))?;
        let mut recorder = Self { energies, frames, progress: ProgressBar::hidden() };
        recorder.record(system, state, 0, monitor)?;
        Ok(recorder)
    }

    /// Goes on where a checkpoint was written.
    ///
    /// # Errors
    /// An `energy.csv` that is not there, or not the one that the checkpoint knows.
    pub fn resume(
        console: &Console,
        folder: &Path,
        frames: Option<Frames>,
        schedule: &Schedule,
        checkpoint: &Checkpoint,
    ) -> Result<Self> {
        Ok(Self {
            energies: EnergyLog::resume(folder.join("energy.csv"), &checkpoint.energies)?,
            frames,
            progress: progress_bar(console, schedule.len()),
        })
    }

    /// How far the files are, for a checkpoint.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn position(&mut self) -> Result<(LogPosition, Vec<(f64, u64)>)> {
        let frames = self.frames.as_mut().map_or_else(|| Ok(Vec::new()), Frames::position)?;
        Ok((self.energies.position()?, frames))
    }

    /// Records a state, as a rule the one that the monitor entered last.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn record(&mut self, system: &System, state: &State, number: u64, monitor: &Monitor) -> Result<()> {
        let (energy, balance) = monitor.energy_at(state);
        self.energies.push(state.time, &energy, &balance)?;
        if let Some(frames) = &mut self.frames {
            frames.record(system, state, number)?;
        }
        if !self.progress.is_hidden() {
            self.progress.set_position(number);
            self.progress.set_message(format!("t = {} s", number::number(state.time)));
        }
        Ok(())
    }

    /// Completes the files.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn finish(self, system: &System) -> Result<()> {
        self.progress.finish_and_clear();
        self.energies.finish()?;
        self.frames.map_or(Ok(()), |frames| frames.finish(system))
    }
}

/// A bar on stderr; indicatif shows it only on a terminal.
pub fn progress_bar(console: &Console, steps: u64) -> ProgressBar {
    bar(console, steps, "{wide_bar} step {pos} of {len}, {msg}, {eta}").with_message("at the start")
}

/// A bar of another look.
pub fn bar(console: &Console, length: u64, template: &str) -> ProgressBar {
    let target = if console.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(length), target);
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style.with_key("eta", |state: &ProgressState, text: &mut dyn Write| {
            // Nothing is known before the first part is done.
            let left = if state.pos() == 0 { "time unknown".into() } else { format!("{} left", roughly(state.eta())) };
            let _ = text.write_str(&left);
        })),
        Err(_) => bar,
    }
}
