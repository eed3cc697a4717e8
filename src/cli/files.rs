//! The files of a run, whatever way it goes, and its summary for people.

use super::common::LoadedScene;
use super::time::in_words;
use super::values::positive_count;
use super::view::{self, PAGE};
use sprung::Result;
use sprung::integrate::{Balance, Schedule, percent};
use sprung::output::{
    BUNDLE, ErrorKind, ErrorReport, Frames, OutputFolder, Summary, TRAJECTORY, clear_frames, playback,
};
use std::num::NonZeroU64;
use std::path::Path;

/// Files that every run writes.
pub const FILES: [&str; 3] = ["summary.json", "final.json", "energy.csv"];

/// Files that are written where they are asked for.
#[derive(Debug, clap::Args)]
pub struct Files {
    /// Write every Nth step as a VTK file, from the initial state on, frames.pvd, which opens them as a time series, and
    /// trajectory.npz, all of them in one file for Python
    #[arg(long, value_name = "N", value_parser = positive_count)]
    pub frames: Option<NonZeroU64>,

    /// Write view.html, a page that plays the motion in any browser; without --frames, of about 300 frames, or as many as take a
    /// gigabyte on the way
    #[arg(long)]
    pub view: bool,
}

impl Files {
    /// Writes the page that plays the motion, where it is asked for; names all files of a run.
    ///
    /// # Errors
    /// A page that cannot be written.
    pub fn show(&self, folder: &Path) -> Result<Vec<&'static str>> {
        let mut names = FILES.to_vec();
        if self.frames.is_some() {
            names.push("frames.pvd");
        }
        if self.frames.is_some() || self.view {
            names.push(TRAJECTORY);
        }
        if self.view {
            playback(folder).and_then(|motion| view::write(&folder.join(PAGE), &motion))?;
            names.push(PAGE);
        }
        Ok(names)
    }

    /// The frames that are to be kept, if any, in a folder.
    ///
    /// # Errors
    /// A folder that cannot be written.
    pub fn kept(&self, folder: &Path, schedule: &Schedule, scene: &LoadedScene) -> Result<Option<Frames>> {
        let kept = view::frames(folder, self.frames, self.view, schedule, &scene.system, None)?;
        Ok(kept.map(|frames| frames.with_triangles(scene.triangles.clone())))
    }

    /// Removes what an earlier run has left that this one has nothing in place of.
    pub fn clear_older(&self, folder: &OutputFolder) -> Result<()> {
        if self.frames.is_none() {
            clear_frames(folder)?;
        }
        if self.frames.is_none() && !self.view {
            folder.remove(TRAJECTORY)?;
        }
        if !self.view {
            folder.remove(PAGE)?;
        }
        folder.remove_inside("failure", |name| BUNDLE.contains(&name))
    }
}

/// The summary for people.
pub fn text(summary: &Summary, folder: &Path, files: &[&str]) -> String {
    let Summary { scene, method, stiffness, solver, steps, time, wall_seconds, energy, statistics, .. } = summary;
    let Summary { particles, springs, dofs, .. } = summary;
    let work = &statistics.work;
    let status = summary.status.name();
    let mut lines =
        vec![format!("{scene}: {status} after {steps} steps, at t = {time} s, in {}", in_words(*wall_seconds))];
    lines.push(format!("  system    {particles} particles, {springs} springs, {dofs} degrees of freedom"));
    if *solver == "none" {
        lines.push(format!("  method    {method}, {} force evaluations", work.force_evaluations));
    } else {
        let with =
            if summary.preconditioner == "none" { String::new() } else { format!(" with {}", summary.preconditioner) };
        lines.push(format!("  method    {method}, stiffness {stiffness}, solver {solver}{with}"));
        if let Some(choice) = &summary.solver_choice {
            lines.push(format!("  chosen    {choice}"));
        }
        lines.push(format!(
            "  work      {} solves, {} factorizations, {} CG iterations, {} Newton iterations",
            work.solves, work.factorizations, work.cg_iterations, work.newton_iterations,
        ));
        let asked = statistics.max_tolerance;
        let asked = if asked > 0.0 { format!("; asked for {asked:.1e} or less") } else { String::new() };
        lines.push(format!(
            "  residual  at most {:.1e} of the right-hand side{asked}",
            statistics.max_relative_residual
        ));
    }
    if let Some(choice) = &summary.choice {
        lines.push(format!("  chosen    {}", choice.reason));
    }
    if statistics.rejected_steps > 0 {
        lines.push(format!("  rejected  {} steps with too large an error", statistics.rejected_steps));
    }
    if statistics.softened_solves > 0 {
        let each = statistics.dropped_terms as f64 / statistics.softened_solves as f64;
        lines.push(format!(
            "  dropped   {each:.1} transverse terms on average in {} solves where A was indefinite",
            statistics.softened_solves
        ));
    }
    lines.push(format!("  energy    {:.6e} J at the start, {:.6e} J at the end", energy.initial, energy.last));
    if let Some(ErrorReport { estimate, kind }) = summary.error {
        let how = match kind {
            ErrorKind::Confirmed => "confirmed",
            ErrorKind::Indicator => "an estimate: right to about ten times",
        };
        lines.push(format!("  error     about {} of the extent ({how})", percent(estimate)));
    }
    let Balance { work, dissipated, imbalance } = energy.balance;
    lines.push(format!(
        "  balance   {work:.3e} J of work by moving constraints, {dissipated:.3e} J dissipated, {imbalance:.3e} J unexplained"
    ));
    lines.push(format!("  files     {} in {}", files.join(", "), folder.display()));
    lines.join("\n")
}
