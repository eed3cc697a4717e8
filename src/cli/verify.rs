//! `sprung verify`: the verification suite on scenes.

use super::common::{Threads, check_writable, folder_of, read_scene};
use super::console::Console;
use super::{Exit, Stop};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::Value;
use sprung::Error;
use sprung::report;
use sprung::verify::{FAMILIES, Results, Subject, built_in};
use std::path::PathBuf;

/// Check the program on scenes: derivatives, solvers, definiteness, conservation, convergence, failure
///
/// Holds forces to their energy, matrices to the forces, steps to their equations, solvers to each other and methods to
/// their order, each number to a bound that an analysis gives, and writes report.html, report.json and junit.xml. A
/// scene's own dt is used; a scene without one is checked at a step that resolves its vibrations.
#[derive(Debug, clap::Args)]
pub struct Verify {
    /// The scenes: TOML or JSON files [default: the built-in ones]
    #[arg(value_name = "SCENE")]
    scenes: Vec<PathBuf>,

    #[command(flatten)]
    threads: Threads,

    /// Folder for the report [default: out/<scene name>, out/verification for several scenes]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

const FILES: [&str; 3] = ["report.html", "report.json", "junit.xml"];

impl Verify {
    pub fn execute(&self, console: &Console) -> Result<Exit, Stop> {
        let subjects = self.subjects()?;
        let folder = self.folder(&subjects);
        let _claimed = check_writable(&folder, &FILES)?;
        let results = self.threads.install(|| Ok(measure(&subjects, console)))?;
        report::write(&folder, &results).map_err(Stop::Broken)?;
        let json = report::json(&results).map_err(|source| Stop::Broken(Error::io(folder.join(FILES[1]), source)))?;
        let json: Value = serde_json::from_str(&json)
            .map_err(|error| Stop::Broken(Error::io(folder.join(FILES[1]), error.into())))?;
        let text = format!("{}report: {}", report::text(&results), folder.join(FILES[0]).display());
        console.result(&json, text)?;
        Ok(if results.all_passed() { Exit::Done } else { Exit::Failed })
    }

    fn subjects(&self) -> Result<Vec<Subject>, Error> {
        if self.scenes.is_empty() {
            return built_in();
        }
        let subject = |file: &PathBuf| {
            let (scene, source) = read_scene(file)?;
            Subject::of_scene(&scene).map_err(|error| error.in_file(&source))
        };
        self.scenes.iter().map(subject).collect()
    }

    fn folder(&self, subjects: &[Subject]) -> PathBuf {
        let name = match subjects {
            [subject] => &subject.name,
            _ => "verification",
        };
        self.out.clone().unwrap_or_else(|| folder_of(name))
    }
}

fn measure(subjects: &[Subject], console: &Console) -> Results {
    let tasks: Vec<_> = FAMILIES
        .iter()
        .flat_map(|family| subjects.iter().filter(|subject| (family.applies)(subject)).map(move |s| (family, s)))
        .collect();
    let target = if console.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(tasks.len() as u64), target);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len}, about {eta} left, {msg}") {
        bar.set_style(style);
    }
    let results = tasks
        .into_iter()
        .flat_map(|(family, subject)| {
            bar.set_message(format!("{}, {}", family.name, subject.name));
            let checks = family.check(subject);
            bar.inc(1);
            checks
        })
        .collect();
    bar.finish_and_clear();
    results
}
