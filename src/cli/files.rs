//! The files of a run while it is under way: energies, frames and the page.

use super::common::{LoadedScene, claim, positive_count};
use super::console::number;
use super::view::{PAGE, write_page};
use indicatif::ProgressBar;
use sprung::integrate::{Monitor, Schedule, Status};
use sprung::output::{
    BUNDLE, Checkpoint, EnergyLog, Frames, LogPosition, OutputFolder, Summary, TRAJECTORY, WAITING, clear_frames,
    playback, write_final_state,
};
use sprung::plan::RECORDS;
use sprung::{Result, State, System};
use std::num::NonZeroU64;
use std::path::Path;

pub const FILES: [&str; 3] = ["summary.json", "final.json", "energy.csv"];

/// Optional files of a run.
#[derive(Debug, clap::Args)]
pub struct Files {
    /// Write every Nth step as a VTK file, from the initial state on, frames.pvd, which opens them as a time series, and
    /// trajectory.npz, all of them in one file for Python
    #[arg(long, value_name = "N", value_parser = positive_count::<NonZeroU64>)]
    pub frames: Option<NonZeroU64>,

    /// Write view.html, a page that plays the motion in any browser; without --frames, of about 300 frames, or as many as take a gigabyte on the way
    #[arg(long)]
    pub view: bool,
}

impl Files {
    /// Creates and locks the folder of a run, and checks that nothing there is in the way of any of its files.
    pub fn claim(&self, folder: &Path, goes_on: bool) -> Result<OutputFolder> {
        let claimed = claim(folder, &[FILES, self.optional().map(|(name, _)| name)].concat(), goes_on)?;
        let frames = self.frames.map(|_| "frames");
        frames.into_iter().chain(["failure"]).try_for_each(|inner| claimed.check_inside(inner))?;
        Ok(claimed)
    }

    /// Writes what is left to write at the end of a run, and removes files of an earlier one; returns the names of all files.
    pub fn finish(
        &self,
        claimed: &OutputFolder,
        system: &System,
        state: &State,
        summary: &Summary,
    ) -> Result<Vec<&'static str>> {
        let folder = claimed.path();
        write_final_state(folder.join("final.json"), &summary.scene, system, summary.steps, state)?;
        self.remove_older(claimed)?;
        summary.write(folder.join("summary.json"))?;
        if summary.status == Status::Completed {
            // The last checkpoint stays for a longer run; its frames are in the trajectory.
            Checkpoint::finish(claimed)?;
            claimed.remove(WAITING)?;
            claimed.tidy();
        }
        if self.view {
            playback(folder).and_then(|motion| write_page(&folder.join(PAGE), &motion))?;
        }
        let optional = self.optional().into_iter().filter(|(_, is_written)| *is_written).map(|(name, _)| name);
        Ok(FILES.into_iter().chain(optional).collect())
    }

    /// The files that a run writes if requested, and removes otherwise, with whether they are.
    fn optional(&self) -> [(&'static str, bool); 3] {
        let has_frames = self.frames.is_some();
        [("frames.pvd", has_frames), (TRAJECTORY, has_frames || self.view), (PAGE, self.view)]
    }

    /// The frames of a run in a folder, if requested; those of a page have no files for VTK.
    pub fn start_frames(
        &self,
        folder: &Path,
        schedule: &Schedule,
        scene: &LoadedScene,
        from: Option<&Checkpoint>,
    ) -> Result<Option<Frames>> {
        let Some(every) = self.interval(schedule, &scene.system) else { return Ok(None) };
        let frames = match from {
            Some(checkpoint) => Frames::resume(folder, every, checkpoint.frames.clone(), &scene.system)?,
            None => Frames::create(folder, every)?,
        };
        let frames = frames.with_triangles(scene.triangles.clone());
        Ok(Some(if self.frames.is_some() { frames } else { frames.without_vtk() }))
    }

    /// The number of steps between frames, if requested: for a page, as many frames as look smooth and take at most a gigabyte.
    pub fn interval(&self, schedule: &Schedule, system: &System) -> Option<NonZeroU64> {
        let smooth = || {
            let bytes = 6 * size_of::<f64>() * system.particles().max(1);
            let frames = (1_000_000_000 / bytes).clamp(30, RECORDS as usize) as u64;
            NonZeroU64::new(schedule.len().div_ceil(frames)).unwrap_or(NonZeroU64::MIN)
        };
        self.frames.or_else(|| self.view.then(smooth))
    }

    pub fn removed(&self, folder: &Path) -> Vec<&'static str> {
        let files = self.optional().into_iter().filter(|(name, is_kept)| !is_kept && folder.join(name).exists());
        files.map(|(name, _)| name).collect()
    }

    fn remove_older(&self, folder: &OutputFolder) -> Result<()> {
        if self.frames.is_none() {
            clear_frames(folder)?;
        }
        self.optional().iter().filter(|(_, is_kept)| !is_kept).try_for_each(|(name, _)| folder.remove(name))?;
        folder.remove_inside("failure", |name| BUNDLE.contains(&name))
    }
}

pub struct Recorder {
    pub energies: EnergyLog,
    pub frames: Option<Frames>,
    pub progress: ProgressBar,
}

impl Recorder {
    pub fn position(&mut self) -> Result<(LogPosition, Vec<(f64, u64)>)> {
        let frames = self.frames.as_mut().map_or_else(|| Ok(Vec::new()), Frames::position)?;
        Ok((self.energies.position()?, frames))
    }

    pub fn record(&mut self, system: &System, state: &State, step: u64, monitor: &Monitor) -> Result<()> {
        let (energy, balance) = monitor.energy_at(state);
        self.energies.push(state.time, &energy, &balance)?;
        if let Some(frames) = &mut self.frames {
            frames.record(system, state, step)?;
        }
        if !self.progress.is_hidden() {
            self.progress.set_position(step);
            self.progress.set_message(format!("t = {} s", number(state.time)));
        }
        Ok(())
    }

    pub fn finish(self, system: &System) -> Result<()> {
        self.progress.finish_and_clear();
        self.energies.finish()?;
        self.frames.map_or(Ok(()), |frames| frames.finish(system))
    }
}
