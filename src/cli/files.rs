//! The files of a run, whatever way it goes, and its summary for people.

use super::common::LoadedScene;
use super::number::{count, number};
use super::time::in_words;
use super::values::positive_count;
use super::view::{self, PAGE};
use sprung::Result;
use sprung::integrate::{Balance, Schedule, percent};
use sprung::output::{
    BUNDLE, ErrorKind, ErrorReport, Frames, OutputFolder, Summary, TRAJECTORY, clear_frames, playback,
};
use std::fmt::{self, Display};
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

/// The summary for people: what a person wants to know first, or (`{:#}`) everything.
pub fn text<'a>(summary: &'a Summary, folder: &'a Path, files: &'a [&'static str]) -> impl Display + 'a {
    MonitorCheckpoint { summary, folder, files }
}

struct MonitorCheckpoint<'a> {
    summary: &'a Summary,
    folder: &'a Path,
    files: &'a [&'static str],
}

impl Display for MonitorCheckpoint<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { summary, folder, files } = self;
        let Summary { scene, status, steps, time, wall_seconds, .. } = summary;
        let (status, steps, time) = (status.name(), count(*steps, "step"), number(*time));
        writeln!(f, "{scene}: {status} at t = {time} s after {steps}, in {}", in_words(*wall_seconds))?;
        if let Some(error) = &summary.error {
            writeln!(f, "  error     {}", error_line(error))?;
        }
        writeln!(f, "  method    {}", method(summary))?;
        if f.alternate() {
            self.bookkeeping(f)?;
        }
        writeln!(f, "  files     {} in {}", files.join(", "), folder.display())?;
        if files.contains(&PAGE) {
            write!(f, "open {}", folder.join(PAGE).display())
        } else {
            write!(f, "  motion    not kept; with --view the run writes a page that plays it")
        }
    }
}

/// How wrong a run is, and how well that is known.
fn error_line(error: &ErrorReport) -> String {
    let how = match error.kind {
        ErrorKind::Confirmed => "confirmed",
        ErrorKind::Indicator => "an estimate: right to about ten times",
    };
    format!("about {} of the extent ({how})", percent(error.estimate))
}

/// The method, and the matrices that it takes.
fn method(summary: &Summary) -> String {
    let Summary { method, stiffness, solver, preconditioner, .. } = summary;
    if *solver == "none" {
        return (*method).to_owned();
    }
    let with = if *preconditioner == "none" { String::new() } else { format!(" with {preconditioner}") };
    format!("{method}, stiffness {stiffness}, solver {solver}{with}")
}

impl MonitorCheckpoint<'_> {
    /// What the computation took and why it was done so, and where the energy went.
    fn bookkeeping(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Summary { solver, energy, statistics, particles, springs, dofs, .. } = self.summary;
        let work = &statistics.work;
        let mut line = |name: &str, text: String| writeln!(f, "  {name:<9} {text}");
        let [particles, springs] =
            [(particles, "particle"), (springs, "spring")].map(|(&n, noun)| count(n as u64, noun));
        line("system", format!("{particles}, {springs}, {dofs} degrees of freedom"))?;
        if let Some(choice) = &self.summary.choice {
            line("chosen", choice.reason.clone())?;
        }
        if let Some(choice) = &self.summary.solver_choice {
            line("chosen", choice.clone())?;
        }
        if *solver == "none" {
            line("work", count(work.force_evaluations, "force evaluation"))?;
        } else {
            let counts = [
                (work.solves, "solve"),
                (work.factorizations, "factorization"),
                (work.cg_iterations, "CG iteration"),
                (work.newton_iterations, "Newton iteration"),
            ];
            line("work", counts.map(|(n, noun)| count(n, noun)).join(", "))?;
            let asked = statistics.max_tolerance;
            let asked = if asked > 0.0 { format!("; asked for {asked:.1e} or less") } else { String::new() };
            let residual = statistics.max_relative_residual;
            line("residual", format!("at most {residual:.1e} of the right-hand side{asked}"))?;
        }
        if statistics.rejected_steps > 0 {
            line("rejected", format!("{} with too large an error", count(statistics.rejected_steps, "step")))?;
        }
        if statistics.softened_solves > 0 {
            let each = statistics.dropped_terms as f64 / statistics.softened_solves as f64;
            let solves = count(statistics.softened_solves, "solve");
            line("dropped", format!("{each:.1} transverse terms on average in {solves} where A was indefinite"))?;
        }
        line("energy", format!("{} J at the start, {} J at the end", number(energy.initial), number(energy.last)))?;
        let Balance { work, dissipated, imbalance } = energy.balance;
        line(
            "balance",
            format!(
                "{} J of work by moving constraints, {} J dissipated, {} J unexplained",
                number(work),
                number(dissipated),
                number(imbalance)
            ),
        )
    }
}
