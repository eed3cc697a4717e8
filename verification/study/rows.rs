//! Rows and numbers of the page's tables.

use super::cases::Case;
use super::record::Record;
use super::runs::{Ask, Run};
use std::collections::BTreeMap;

/// At most so many are listed.
const LISTED: usize = 25;

/// A table of the first of these cases, under a title.
pub fn offenders(title: &str, cases: &[Case]) -> String {
    if cases.is_empty() {
        return format!("\n{title}: none.\n");
    }
    let mut text = format!(
        "\n{title} ({} of {}):\n\n| scene | method | asked | ended | error | estimate | growth | Ω | warning |\n|---|---|---|---|---|---|---|---|---|\n",
        cases.len().min(LISTED),
        cases.len()
    );
    for case in cases.iter().take(LISTED) {
        text.push_str(&row(case));
    }
    text
}

fn row(case: &Case) -> String {
    let Case { record, run } = case;
    let asked = match run.ask {
        Ask::Dt(dt) => format!("dt T/{}", number(record.duration / dt)),
        Ask::Rtol(rtol) => format!("rtol {rtol:e}"),
        Ask::Accuracy(accuracy) => format!("accuracy {accuracy:e}"),
    };
    let warning = run.warnings.first().map_or("", String::as_str);
    format!(
        "| {} | {} | {asked} | {} | {} | {} | {} | {} | {} |\n",
        record.scene,
        way(run),
        run.status,
        run.error.map_or("–".into(), number),
        run.estimate.map_or("–".into(), number),
        record.amplification.map_or("–".into(), number),
        record.pace.map_or("–".into(), number),
        warning.chars().take(60).collect::<String>(),
    )
}

/// One scene, run by run.
pub fn scene(record: &Record) -> String {
    let mut text = format!(
        "{}: {} particles in {} dimensions, {} s, Ω {}, damped {}, moved {}\nreference: error {}, growth {}, shortest spring {} of its rest length\n",
        record.scene,
        record.particles,
        record.dimension,
        number(record.duration),
        record.pace.map_or("–".into(), number),
        record.damped,
        record.moved,
        record.reference_error.map_or("none".into(), number),
        record.amplification.map_or("–".into(), number),
        record.shortest.map_or("–".into(), number),
    );
    for run in &record.runs {
        text.push_str(&row(&Case { record, run }));
    }
    text
}

/// Method and stiffness option, where that is not the default.
pub fn way(run: &Run) -> String {
    format!("{} {}", run.method, run.stiffness).trim_end_matches(" none").trim_end_matches(" on-demand").to_owned()
}

/// Cases by method and option.
pub fn by_way<'r>(cases: &[Case<'r>]) -> BTreeMap<String, Vec<Case<'r>>> {
    by(cases, |case| way(case.run))
}

/// Cases by any key.
pub fn by<'r, K: Ord>(cases: &[Case<'r>], key: impl Fn(&Case) -> K) -> BTreeMap<K, Vec<Case<'r>>> {
    let mut groups = BTreeMap::<K, Vec<Case>>::new();
    for case in cases {
        groups.entry(key(case)).or_default().push(*case);
    }
    groups
}

/// In ascending order.
pub fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values
}

/// The smallest value that a part of them does not exceed.
pub fn quantile(sorted: &[f64], part: f64) -> f64 {
    let at = (part * sorted.len() as f64).ceil() as usize;
    sorted.get(at.saturating_sub(1)).copied().unwrap_or(f64::NAN)
}

/// Median, nine tenths and the largest.
pub fn spread(values: Vec<f64>) -> String {
    let values = sorted(values);
    [0.5, 0.9, 1.0].map(|part| number(quantile(&values, part))).join(", ")
}

/// A count, with its share of the whole.
pub fn share(part: usize, whole: usize) -> String {
    if whole == 0 { format!("{part}") } else { format!("{part} ({:.1} %)", 100.0 * part as f64 / whole as f64) }
}

/// Two digits.
pub fn number(value: f64) -> String {
    if value.is_nan() {
        "–".into()
    } else if value == 0.0 || (0.01..1000.0).contains(&value.abs()) {
        let digits = if value.abs() >= 10.0 {
            0
        } else if value.abs() >= 1.0 {
            1
        } else {
            3
        };
        format!("{value:.digits$}")
    } else {
        format!("{value:.1e}")
    }
}
