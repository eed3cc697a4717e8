//! Makes tests of checks and keeps what they measured for the report.

use libtest_mimic::{Failed, Trial};
use sprung::report::{self, failure};
use sprung::verify::{Check, Claim, Results};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// The checks of each test, by its number.
type Gathered = Vec<(usize, Vec<Check>)>;

/// Gathers the checks of all tests in the order in which the tests were listed.
#[derive(Default)]
pub struct Collector {
    listed: usize,
    checks: Arc<Mutex<Gathered>>,
}

impl Collector {
    /// A test that passes if every check of `measure` does. A panic, which the code under test must not cause, is a failed
    /// check.
    pub fn trial(
        &mut self,
        claim: Claim,
        name: String,
        measure: impl FnOnce() -> Vec<Check> + Send + 'static,
    ) -> Trial {
        let (number, gathered) = (self.listed, self.checks.clone());
        self.listed += 1;
        Trial::test(name.clone(), move || {
            let checks = catch_unwind(AssertUnwindSafe(measure)).unwrap_or_else(|panic| {
                let why = panic.downcast_ref::<String>().cloned();
                let why = why.or(panic.downcast_ref::<&str>().map(ToString::to_string)).unwrap_or_default();
                vec![Check::new(claim, &name, "", f64::NAN, 0.0, format!("panicked: {why}"))]
            });
            let verdict = verdict(&checks);
            gathered.lock().unwrap_or_else(PoisonError::into_inner).push((number, checks));
            verdict
        })
    }

    /// Writes the report and prints the table.
    pub fn report(&self) {
        let mut gathered = std::mem::take(&mut *self.checks.lock().unwrap_or_else(PoisonError::into_inner));
        gathered.sort_by_key(|(number, _)| *number);
        let results: Results = gathered.into_iter().flat_map(|(_, checks)| checks).collect();
        // CARGO_TARGET_TMPDIR lies in the target folder, wherever that has been moved to.
        let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap_or(Path::new("."));
        let folder = target.join("verification");
        if let Err(error) = sprung::output::write_report(&folder, &results) {
            eprintln!("no report: {error}");
            std::process::exit(1);
        }
        print!("{}", report::text(&results));
        println!("report: {}", folder.join("report.html").display());
    }
}

/// Passes, or names every check that does not.
fn verdict(checks: &[Check]) -> Result<(), Failed> {
    let failures: Vec<String> = checks.iter().filter(|check| !check.passed()).map(failure).collect();
    if failures.is_empty() && !checks.is_empty() { Ok(()) } else { Err(failures.concat().into()) }
}

/// A name as part of a test's name: small letters, digits and underscores.
pub fn slug(name: &str) -> String {
    let words = name.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    words.collect::<Vec<_>>().join("_").to_ascii_lowercase()
}
