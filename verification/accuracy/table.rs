//! Tables of what answers cost.

use crate::motion::{ACCURACIES, Row};
use std::fmt::Write;

/// The value below which the given part of a list lies.
fn quantile(values: &[f64], part: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().saturating_sub(1) as f64;
    sorted.get((part * last).round() as usize).copied().unwrap_or(f64::NAN)
}

/// The cost of an accuracy on some scenes, one accuracy a line and all together.
pub fn table(rows: &[Row]) -> Result<String, std::fmt::Error> {
    let mut text = String::from(
        "| accuracy | answers | confirmed | of these wrong | cost over the cheapest run: median, 90 %, most | above 3.5 | above 8 | over the cheapest that is right for sure: median, 90 % | time of the search over that of the bare run: median, 90 % | of the command over that of the command: median, 90 % |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
    );
    for accuracy in ACCURACIES.into_iter().map(Some).chain([None]) {
        let these: Vec<&Row> = rows.iter().filter(|row| accuracy.is_none_or(|a| row.accuracy == a)).collect();
        let ratios: Vec<f64> = these.iter().map(|row| row.total / row.least).collect();
        let for_sure: Vec<f64> = these.iter().map(|row| row.total / row.least_for_sure).collect();
        let times: Vec<f64> = these.iter().map(|row| row.slower).collect();
        let commands: Vec<f64> = these.iter().filter_map(|row| row.command_slower).collect();
        let confirmed = these.iter().filter(|row| row.confirmed);
        let part = |above: f64| {
            let count = ratios.iter().filter(|ratio| **ratio > above).count();
            format!("{:.0} %", 100.0 * count as f64 / ratios.len().max(1) as f64)
        };
        writeln!(
            text,
            "| {} | {} | {} | {} | {:.2}, {:.2}, {:.1} | {} | {} | {:.2}, {:.2} | {:.2}, {:.2} | {} |",
            accuracy.map_or("all".into(), |accuracy| format!("{accuracy:.0e}")),
            these.len(),
            confirmed.clone().count(),
            confirmed.filter(|row| row.error > row.accuracy).count(),
            quantile(&ratios, 0.5),
            quantile(&ratios, 0.9),
            quantile(&ratios, 1.0),
            part(3.5),
            part(8.0),
            quantile(&for_sure, 0.5),
            quantile(&for_sure, 0.9),
            quantile(&times, 0.5),
            quantile(&times, 0.9),
            if commands.is_empty() {
                "–".into()
            } else {
                format!("{:.2}, {:.2}", quantile(&commands, 0.5), quantile(&commands, 0.9))
            },
        )?;
    }
    Ok(text)
}

/// One answer, a line of a table.
pub fn line(scene: &str, row: &Row) -> String {
    format!(
        "| {scene} | {:.0e} | {} | {}{} | {:.1e} | {:.0} | {:.0} | {} {:.0} | {:.1} | {:.1} | {} |",
        row.accuracy,
        row.method,
        row.estimate.map_or("–".into(), |error| format!("{error:.1e}")),
        if row.confirmed { "" } else { ", unconfirmed" },
        row.error,
        row.cost,
        row.total,
        row.cheapest,
        row.least,
        row.total / row.least,
        row.slower,
        row.command_slower.map_or("–".into(), |slower| format!("{slower:.1}")),
    )
}

/// The head of a table of answers.
pub const HEADER: &str = "| scene | accuracy | answer by | estimated error | achieved | work of the run | of everything | cheapest run, its work | ratio | of times | of commands |\n\
                      |---|---|---|---|---|---|---|---|---|---|---|\n";
