//! `sprung run --accuracy R`: a search for an answer, every run of which is recorded.

use super::Stop;
use super::common::LoadedScene;
use super::console::{Console, PARTS};
use super::files::{Files, Recorder};
use super::summary::SummaryText;
use super::threads::{end_in_order, is_interrupted};
use indicatif::ProgressBar;
use sprung::accuracy::{AccuracyOptions, Observer, SearchProgress, run_to_accuracy};
use sprung::integrate::{Monitor, Schedule};
use sprung::output::{Checkpoint, EnergyChange, EnergyLog, Summary, clear_frames};
use sprung::{Error, Result, State, System};
use std::path::Path;
use std::time::Instant;
use tempfile::TempDir;

/// The files of a run that may become the answer, in a temporary folder.
pub struct RecordedRun {
    recorder: Recorder,
    folder: TempDir,
    energy: EnergyChange,
}

struct ProgressObserver<'a> {
    files: &'a Files,
    folder: &'a Path,
    schedule: Schedule,
    scene: &'a LoadedScene,
    bar: ProgressBar,
}

impl Observer for ProgressObserver<'_> {
    type Records = RecordedRun;

    fn begin(&mut self, monitor: &Monitor) -> Result<RecordedRun> {
        let folder = tempfile::Builder::new().prefix(".sprung-").tempdir_in(self.folder);
        let folder = folder.map_err(|source| Error::io(self.folder, source))?;
        let mut recorder = Recorder {
            energies: EnergyLog::create(folder.path().join("energy.csv"))?,
            frames: self.files.start_frames(folder.path(), &self.schedule, self.scene, None)?,
            progress: ProgressBar::hidden(),
        };
        recorder.record(&self.scene.system, &self.scene.state, 0, monitor)?;
        Ok(RecordedRun { recorder, folder, energy: EnergyChange::of(monitor) })
    }

    fn record(&mut self, run: &mut RecordedRun, number: u64, state: &State, monitor: &Monitor) -> Result<()> {
        run.energy = EnergyChange::of(monitor);
        run.recorder.record(&self.scene.system, state, number, monitor)
    }

    fn progress(&mut self, progress: &SearchProgress<'_>) {
        let SearchProgress { run, part, spent } = progress;
        self.bar.set_position((part * PARTS as f64) as u64);
        self.bar.set_message(format!("{run}; {spent:.0} force evaluations in the runs before"));
    }
}

impl RecordedRun {
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

/// Moves the files of a folder, not its inner folders.
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

pub fn search(
    console: &Console,
    scene: &LoadedScene,
    files: &Files,
    options: &AccuracyOptions,
    folder: &Path,
) -> Result<Summary, Stop> {
    let LoadedScene { file, name, system, state: start, .. } = scene;
    end_in_order();
    let claimed = files.claim(folder, false)?;
    Checkpoint::forget(&claimed)?;
    let clock = Instant::now();
    let schedule = Schedule::duration(options.interval, options.duration);
    let bar = console.bar(PARTS, "{wide_bar} {msg}");
    let mut observer = ProgressObserver { files, folder, schedule, scene, bar };
    let found = run_to_accuracy(system, start, options, &mut observer, &|| !is_interrupted());
    observer.bar.finish_and_clear();
    let Some(found) = found.map_err(|error| error.in_file(file))? else {
        let why = if is_interrupted() { "interrupted" } else { "no run comes to the end of this motion" };
        let accuracy = options.accuracy;
        return Err(Stop::Computation(format!("{why}: there is no answer to an accuracy of {accuracy:e}")));
    };
    let wall_seconds = clock.elapsed().as_secs_f64();
    let summary = Summary::of_answer(name.clone(), system, &found, options, found.records.energy, wall_seconds);
    let (state, run) = (&found.state, found.records);
    let written = clear_frames(&claimed)
        .and_then(|()| run.publish(system, folder))
        .and_then(|()| files.finish(&claimed, system, state, &summary));
    let names = written.map_err(Stop::Broken)?;
    SummaryText { summary: &summary, system, folder, files: &names }.print(console)?;
    Ok(summary)
}
