//! `sprung verify`: the verification suite on scenes.

use super::Stop;
use super::common::{claim, folder_of, read_scene};
use super::console::Console;
use super::threads::Threads;
use serde_json::Value;
use sprung::Error;
use sprung::output::write_report;
use sprung::report;
use sprung::verify::{Check, FAMILIES, Results, TestCase, built_in};
use std::path::PathBuf;
use std::sync::Arc;

/// Check the program on scenes: derivatives, solvers, definiteness, conservation, convergence, failure
///
/// Holds forces to their energy, matrices to the forces, steps to their equations, solvers to each other and methods to their order, each number to a
/// bound that an analysis gives, and writes report.html, report.json and junit.xml. A scene's own dt is used; a scene without one is checked at a
/// step that resolves its vibrations. What the numbers of a scene do not allow to be judged, as where a particle is so far away that its spring is
/// lost in the rounding of coordinates, is said with the reason, and counts neither as passed nor as failed.
#[derive(Debug, clap::Args)]
pub struct Verify {
    /// The scenes: TOML, JSON or NumPy (.npz) files [default: the built-in ones]
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
    pub fn execute(&self, console: &Console) -> Result<(), Stop> {
        let cases = self.cases()?;
        let name = match &cases[..] {
            [case] => &case.name,
            _ => "verification",
        };
        let folder = self.out.clone().unwrap_or_else(|| folder_of(name));
        let _claimed = claim(&folder, &FILES, false)?;
        let (results, is_complete) = self.measure(Arc::new(cases), console)?;
        if results.checks.is_empty() && !is_complete {
            return Err(Stop::Computation("interrupted before anything was checked".into()));
        }
        write_report(&folder, &results).map_err(Stop::Broken)?;
        let broken = |source| Stop::Broken(Error::io(folder.join(FILES[1]), source));
        let json = report::json(&results).map_err(broken)?;
        let json: Value = serde_json::from_str(&json).map_err(|error| broken(error.into()))?;
        let text = format!("{}report: {}", report::text(&results), folder.join(FILES[0]).display());
        console.result(&json, text)?;
        if !is_complete {
            let message = "interrupted: the report has the checks that were made until then";
            return Err(Stop::Computation(message.into()));
        }
        if results.all_passed() { Ok(()) } else { Err(Stop::Reported) }
    }

    fn cases(&self) -> Result<Vec<TestCase>, Error> {
        if self.scenes.is_empty() {
            return built_in();
        }
        let case = |file: &PathBuf| {
            let (scene, source) = read_scene(file)?;
            TestCase::of_scene(&scene).map_err(|error| error.in_file(&source))
        };
        self.scenes.iter().map(case).collect()
    }

    /// Makes all checks, or those until an interruption and `false`.
    fn measure(&self, cases: Arc<Vec<TestCase>>, console: &Console) -> Result<(Results, bool), Stop> {
        let pairs = FAMILIES.iter().flat_map(|family| (0..cases.len()).map(move |case| (family, case)));
        let tasks: Vec<_> = pairs.filter(|&(family, case)| (family.applies)(&cases[case])).collect();
        let names: Vec<String> =
            tasks.iter().map(|&(family, case)| format!("{}, {}", family.name, cases[case].name)).collect();
        let bar = console.bar(tasks.len() as u64, "{bar:30} {pos}/{len}, {eta}, {msg}");
        let name = |number: u64| names.get(number as usize).cloned().unwrap_or_default();
        bar.set_message(name(0));
        let mut checks = Vec::new();
        let ended = self.threads.attend(
            move |tell| tasks.into_iter().for_each(|(family, case)| tell(family.check(&cases[case]))),
            |made: Vec<Check>| {
                checks.extend(made);
                bar.inc(1);
                bar.set_message(name(bar.position()));
            },
        )?;
        bar.finish_and_clear();
        Ok((checks.into_iter().collect(), ended.is_some()))
    }
}
