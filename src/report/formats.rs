//! The results of a verification as text for the terminal, as JSON, and as JUnit for build servers.

use super::number::{count, pair, plain, share};
use crate::verify::{Check, Entry, Results, worst};
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use serde::Serialize;
use std::fmt::Write;
use std::io;

/// A line per claim with the check nearest to its bound, then every failure with its worst entries, and what could not be judged.
pub fn text(results: &Results) -> String {
    let mut lines = format!("{:<60} {:>6} {:>6} {:>17}  verdict\n", "claim", "checks", "failed", "worst value/bound");
    for (claim, checks) in results.by_claim() {
        let failed = checks.iter().filter(|check| !check.passed()).count();
        let share = share(plain, worst(checks.iter().map(|check| check.share())));
        let verdict = if failed == 0 { "holds" } else { "FAILS" };
        let _ = writeln!(lines, "{:<60} {:>6} {failed:>6} {share:>17}  {verdict}", claim.title(), checks.len());
    }
    for check in results.failures() {
        let _ = write!(lines, "\nFAILED {}", failure(check));
    }
    let _ = write!(lines, "\n{} passed, {} failed", count(results.passed(), "check"), results.failed());
    if results.not_judged.is_empty() {
        lines.push('\n');
        return lines;
    }
    let _ = writeln!(lines, ", {} not judged:", results.not_judged.len());
    // A scene mostly has one reason, which its checks share.
    let mut reasons: Vec<(&Check, usize)> = Vec::new();
    for check in &results.not_judged {
        match reasons.iter_mut().find(|(first, _)| (&first.scene, &first.why) == (&check.scene, &check.why)) {
            Some((_, checks)) => *checks += 1,
            None => reasons.push((check, 1)),
        }
    }
    for (first, checks) in reasons {
        let more = if checks > 1 { format!(" and {} more", checks - 1) } else { String::new() };
        let _ = writeln!(lines, "  {}{more} [{}]: {}", first.name, first.scene, first.why);
    }
    lines
}

/// Everything that a reader needs to find one failure: where, which numbers, why the bound, the worst entries.
pub fn failure(check: &Check) -> String {
    let mut lines = format!("{}: {} [{}]\n", check.claim.id(), check.name, check.scene);
    let _ = writeln!(lines, "  {}\n  {}", comparison(check), check.why);
    for entry in check.table.iter().take(5) {
        let Entry { row, verdict, .. } = entry;
        let column = entry.column.map(|column| format!(" column {column}")).unwrap_or_default();
        let spring = entry.spring.map(|spring| format!(" spring {spring}")).unwrap_or_default();
        let [analytic, numeric] = [entry.analytic, entry.numeric].map(plain);
        let _ = writeln!(lines, "  row {row}{column}{spring}: analytic {analytic}, numeric {numeric}: {verdict}");
    }
    if check.table.len() > 5 {
        let _ = writeln!(lines, "  … {} more entries", check.table.len() - 5);
    }
    lines
}

/// `value 3e-4, bound 1e-8`, and what is wrong where the two alone do not tell.
fn comparison(check: &Check) -> String {
    let [value, bound] = pair(plain, check.value, check.bound);
    let reason = match !check.passed() && check.value <= check.bound {
        false => "",
        true if check.value.is_finite() && check.bound.is_finite() => ", but a number behind it is NaN",
        true => ", but both must be finite",
    };
    format!("value {value}, bound {bound}{reason}")
}

/// The results as the content of `report.json`: `{"passed", "failed", "checks": [{"name", "scene", "claim", "value", "bound", "passed", "why"}…],
/// "not_judged": [{"name", "scene", "claim", "why"}…]}`. Of a number that is not finite, which is `null`, `why` begins with what it was.
pub fn json(results: &Results) -> io::Result<String> {
    #[derive(Serialize)]
    struct Document<'a> {
        passed: usize,
        failed: usize,
        checks: Vec<Record<'a>>,
        not_judged: Vec<Record<'a>>,
    }
    let checks = results.checks.iter().map(|check| Record::of(check, true)).collect();
    let not_judged = results.not_judged.iter().map(|check| Record::of(check, false)).collect();
    let document = Document { passed: results.passed(), failed: results.failed(), checks, not_judged };
    Ok(serde_json::to_string_pretty(&document)? + "\n")
}

#[derive(Serialize)]
struct Record<'a> {
    name: &'a str,
    scene: &'a str,
    claim: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    value: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    bound: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    passed: Option<bool>,
    why: String,
}

impl<'a> Record<'a> {
    fn of(check: &'a Check, judged: bool) -> Self {
        let Check { name, scene, claim, value, bound, why, .. } = check;
        let notes = [("value", *value), ("bound", *bound)]
            .map(|(name, x)| if judged && !x.is_finite() { format!("{name} is {x}; ") } else { String::new() });
        Self {
            name,
            scene,
            claim: claim.id(),
            value: judged.then_some(*value),
            bound: judged.then_some(*bound),
            passed: judged.then(|| check.passed()),
            why: notes.concat() + why,
        }
    }
}

/// The results as a JUnit document: a suite per claim, a case per check; what could not be judged is skipped.
pub fn junit(results: &Results) -> io::Result<String> {
    let case = |check: &Check, status| {
        let mut case = TestCase::new(format!("{} [{}]", check.name, check.scene), status);
        case.set_classname(check.claim.id());
        case
    };
    let judged = |check: &Check| {
        let mut status = TestCaseStatus::success();
        if !check.passed() {
            status = TestCaseStatus::non_success(NonSuccessKind::Failure);
            status.set_message(comparison(check)).set_description(failure(check));
        }
        case(check, status)
    };
    let skipped = |check: &Check| {
        let mut status = TestCaseStatus::skipped();
        status.set_message(check.why.as_str());
        case(check, status)
    };
    let mut report = Report::new("sprung verify");
    for (claim, checks) in results.by_claim() {
        let mut suite = TestSuite::new(claim.title());
        suite.add_test_cases(checks.into_iter().map(judged));
        report.add_test_suite(suite);
    }
    if !results.not_judged.is_empty() {
        let mut suite = TestSuite::new("Not judged on these scenes");
        suite.add_test_cases(results.not_judged.iter().map(skipped));
        report.add_test_suite(suite);
    }
    report.to_string().map_err(io::Error::other)
}
