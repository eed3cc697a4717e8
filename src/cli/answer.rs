//! `sprung run --accuracy R`: a search for an answer, every run of which is recorded.

use super::common::{LoadedScene, claim};
use super::console::{Console, warning};
use super::files::{FILES, Files, text};
use super::recorder::{Recorder, bar};
use super::{Stop, interrupt};
use indicatif::ProgressBar;
use sprung::accuracy::{AccuracyOptions, Observer, SearchProgress, run_to_accuracy};
use sprung::force::Energy;
use sprung::integrate::{Monitor, Schedule};
use sprung::output::{Checkpoint, EnergyChange, Summary, clear_frames, write_final_state};
use sprung::{Error, Result, State, System};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use tempfile::TempDir;

/// Thousandths, in which the progress bar counts.
const PARTS: u64 = 1000;

/// What is kept of a run until it is known whether it is the answer: its files, in a folder of their own.
pub struct Kept {
    recorder: Recorder,
    folder: TempDir,
    initial: Energy,
    /// That at the end, and where energy went.
    energy: EnergyChange,
}

/// Records runs and shows how the search gets on.
struct RunRecorder<'a> {
    files: &'a Files,
    folder: &'a Path,
    schedule: Schedule,
    scene: &'a LoadedScene,
    bar: ProgressBar,
}

impl Observer for RunRecorder<'_> {
    type Records = Kept;

    fn begin(&mut self, monitor: &Monitor) -> Result<Kept> {
        let folder = tempfile::Builder::new()
            .prefix(".sprung-")
            .tempdir_in(self.folder)
            .map_err(|source| Error::io(self.folder, source))?;
        let frames = self.files.kept(folder.path(), &self.schedule, self.scene)?;
        let recorder = Recorder::silent(folder.path(), frames, &self.scene.system, &self.scene.state, monitor)?;
        let initial = monitor.initial();
        let energy = EnergyChange::between(&initial, &initial, monitor.balance());
        Ok(Kept { recorder, folder, initial, energy })
    }

    fn record(&mut self, kept: &mut Kept, number: u64, state: &State, monitor: &Monitor) -> Result<()> {
        kept.energy = EnergyChange::between(&kept.initial, &monitor.energy(), monitor.balance());
        kept.recorder.record(&self.scene.system, state, number, monitor)
    }

    fn progress(&mut self, progress: &SearchProgress<'_>) {
        let SearchProgress { run, part, spent } = progress;
        self.bar.set_position((part * PARTS as f64) as u64);
        self.bar.set_message(format!("{run}; {spent:.0} force evaluations in the runs before"));
    }
}

impl Kept {
    /// Completes the files and moves them to where results belong.
    fn publish(self, system: &System, folder: &Path) -> Result<()> {
        self.recorder.finish(system)?;
        let from = self.folder.path();
        let frames = from.join("frames");
        if frames.is_dir() {
            move_files(&frames, &folder.join("frames"))?;
        }
        move_files(from, folder)
    }
}

/// Moves the files of a folder, not those of folders in it, into another one.
fn move_files(from: &Path, to: &Path) -> Result<()> {
    std::fs::create_dir_all(to).map_err(|source| Error::io(to, source))?;
    let entries = std::fs::read_dir(from).map_err(|source| Error::io(from, source))?;
    for entry in entries {
        let path = entry.map_err(|source| Error::io(from, source))?.path();
        if let Some(name) = path.file_name().filter(|_| path.is_file()) {
            let target = to.join(name);
            std::fs::rename(&path, &target).map_err(|source| Error::io(target, source))?;
        }
    }
    Ok(())
}

/// What is asked for, and where its results go.
pub struct AccuracyCommand<'a> {
    pub files: &'a Files,
    pub options: AccuracyOptions,
    pub folder: PathBuf,
    pub interrupted: &'a AtomicBool,
}

impl AccuracyCommand<'_> {
    /// Searches, writes and reports the answer.
    pub fn answer(&self, console: &Console, scene: &LoadedScene) -> Result<Summary, Stop> {
        let Self { files, options, folder, interrupted } = self;
        let LoadedScene { file, name, system, state: start, .. } = scene;
        interrupt::keep();
        let claimed = claim(folder, &FILES, false)?;
        Checkpoint::forget(&claimed)?;
        let clock = Instant::now();
        let go_on = || !interrupted.load(Ordering::Relaxed);
        let schedule = Schedule::duration(options.interval, options.duration);
        let bar = bar(console, PARTS, "{wide_bar} {msg}");
        let mut recorder = RunRecorder { files, folder, schedule, scene, bar };
        let found = run_to_accuracy(system, start, options, &mut recorder, &go_on);
        recorder.bar.finish_and_clear();
        let Some(found) = found.map_err(|error| error.in_file(file))? else {
            let why = if go_on() { "no run comes to the end of this motion" } else { "interrupted" };
            let accuracy = options.accuracy;
            return Err(Stop::Computation(format!("{why}: there is no answer to an accuracy of {accuracy:e}")));
        };
        let wall_seconds = clock.elapsed().as_secs_f64();
        let energy = found.records.energy;
        let summary = Summary::of_answer(name.clone(), system, &found, options, energy, wall_seconds);
        let state = &found.state;
        let records = found.records;
        let final_state = folder.join("final.json");
        let written = clear_frames(&claimed)
            .and_then(|()| records.publish(system, folder))
            .and_then(|()| files.clear_older(&claimed))
            .and_then(|()| write_final_state(final_state, &summary.scene, system, summary.steps, state))
            .and_then(|()| summary.write(folder.join("summary.json")));
        written.map_err(Stop::Broken)?;
        let names = files.show(folder).map_err(Stop::Broken)?;
        console.result(&summary, text(&summary, folder, &names))?;
        summary.warnings.iter().for_each(warning);
        Ok(summary)
    }
}
