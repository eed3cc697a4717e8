//! The results as a short table for the terminal.

use super::number::{count, pair, plain, share};
use crate::verify::{Check, Entry, Results, worst};
use std::fmt::Write;

/// How many of a check's entries a failure lists.
const LISTED: usize = 5;

/// A line per claim with the check nearest to its bound, then every failure with its numbers and worst entries, and what could not be judged.
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
    for check in &results.not_judged {
        let _ = writeln!(lines, "  {} [{}]: {}", check.name, check.scene, check.why);
    }
    lines
}

/// Everything a reader needs to find one failure: where, which numbers, why the bound, the worst entries.
pub fn failure(check: &Check) -> String {
    let mut lines = format!("{}: {} [{}]\n", check.claim.id(), check.name, check.scene);
    let _ = writeln!(lines, "  {}", comparison(check));
    let _ = writeln!(lines, "  {}", check.why);
    for entry in check.table.iter().take(LISTED) {
        let _ = writeln!(lines, "  {}", self::entry(entry));
    }
    if check.table.len() > LISTED {
        let _ = writeln!(lines, "  … {} more entries", check.table.len() - LISTED);
    }
    lines
}

/// `value 3e-4, bound 1e-8`, and what is wrong where the two alone do not tell.
pub(super) fn comparison(check: &Check) -> String {
    let [value, bound] = pair(plain, check.value, check.bound);
    let hidden = !check.passed() && check.value <= check.bound;
    let reason = match hidden {
        false => "",
        true if check.value.is_finite() && check.bound.is_finite() => ", but a number behind it is NaN",
        true => ", but both must be finite",
    };
    format!("value {value}, bound {bound}{reason}")
}

fn entry(entry: &Entry) -> String {
    let column = entry.column.map(|column| format!(" column {column}")).unwrap_or_default();
    let spring = entry.spring.map(|spring| format!(" spring {spring}")).unwrap_or_default();
    let [analytic, numeric] = [entry.analytic, entry.numeric].map(plain);
    format!("row {}{column}{spring}: analytic {analytic}, numeric {numeric}: {}", entry.row, entry.verdict)
}
