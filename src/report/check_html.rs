//! Checks of one name on a page: their numbers, figures and worst entries.

use super::number::{self, count, pretty, short_pair, typeset};
use super::{drawing, page, plot};
use crate::verify::{Check, Entry, worst};
use maud::{Markup, html};

/// Of so many failed checks of a name figures are shown.
const FAILURES: usize = 12;

/// The scenes of all checks without what was varied on them, by which a page is filtered.
pub(super) struct Scenes(Vec<String>);

impl Scenes {
    pub fn of(checks: &[Check]) -> Self {
        let mut names: Vec<String> = checks.iter().map(|check| base(&check.scene).to_owned()).collect();
        names.sort_unstable();
        names.dedup();
        Self(names)
    }

    pub fn names(&self) -> &[String] {
        &self.0
    }

    fn number(&self, scene: &str) -> Option<usize> {
        self.0.binary_search_by(|name| name.as_str().cmp(base(scene))).ok()
    }
}

/// `cloth` of `cloth, full, dt = 0.01`.
fn base(scene: &str) -> &str {
    scene.split(',').next().unwrap_or(scene).trim()
}

/// The address of a check on the page.
pub(super) fn anchor(index: usize) -> String {
    format!("check-{index}")
}

/// ✓ or ✗, with a word for those who hear the page.
pub(super) fn mark(passed: bool) -> Markup {
    html! {
        @if passed { span.passed role="img" aria-label="holds" { "✓" } }
        @else { span.failed role="img" aria-label="fails" { "✗" } }
    }
}

/// The same check on all its scenes, the worst first. Where all passed everything but the worst share is folded away. Of `narrowest`
/// passed ones, those nearest their bounds, figures and worst entries are shown.
pub(super) fn group(name: &str, checks: &[(usize, &Check)], narrowest: usize, scenes: &Scenes) -> Markup {
    let mut sorted = checks.to_vec();
    sorted.sort_by(|(_, a), (_, b)| worst_first(a, b));
    let (failed, passed): (Vec<_>, Vec<_>) = sorted.iter().partition(|(_, check)| !check.passed());
    let worst = number::share(pretty, worst(checks.iter().map(|(_, check)| check.share())));
    let body = html! {
        @if !passed.is_empty() { (values(name, &passed, scenes)) }
        @for (_, check) in nearest(&passed, narrowest, |check| !check.table.is_empty()) {
            h4 { "Worst entries on " (check.scene) }
            (entries(check))
        }
        (pictures(&failed, &passed, narrowest))
    };
    html! {
        div.group {
            h3 { (mark(failed.is_empty())) " " (name) }
            @if !failed.is_empty() { (values(name, &failed, scenes)) }
            @for (_, check) in failed.iter().filter(|(_, check)| !check.table.is_empty()) {
                p { "Worst entries on " b { (check.scene) } ":" }
                (entries(check))
            }
            (page::folded(&format!("{} passed, the worst value / bound is {worst}", count(passed.len(), "check")), &body))
        }
    }
}

/// Failed ones before passed ones, larger shares of the bound before smaller ones.
fn worst_first(a: &Check, b: &Check) -> std::cmp::Ordering {
    a.passed().cmp(&b.passed()).then(b.share().total_cmp(&a.share()))
}

/// The numbers, those with the same reason for their bound together below it.
fn values(name: &str, checks: &[(usize, &Check)], scenes: &Scenes) -> Markup {
    let mut reasons: Vec<&str> = Vec::new();
    for (_, check) in checks {
        if !reasons.contains(&check.why.as_str()) {
            reasons.push(&check.why);
        }
    }
    let table = html! {
        table.full.checks {
            thead { tr {
                th scope="col" { "scene" }
                th.number scope="col" { "value" }
                th.number scope="col" { "bound" }
                th.number scope="col" { "value / bound" }
                td.bar {}
                th scope="col" { span.word { "verdict" } }
            } }
            @for why in reasons {
                tbody {
                    tr.why { td colspan="6" { "Bound: " (typeset(why)) } }
                    @for &(index, check) in checks.iter().filter(|(_, check)| check.why == why) { (value_row(index, check, scenes)) }
                }
            }
        }
    };
    page::scrolling(name, &table)
}

/// A row, short since there are thousands: the style sheet knows its cells by their place, and adds the word to the mark. All digits
/// are in `report.json`.
fn value_row(index: usize, check: &Check, scenes: &Scenes) -> Markup {
    let [value, bound] = short_pair(check.value, check.bound);
    html! {
        tr id=(anchor(index)) class=[(!check.passed()).then_some("failed-row")] data-s=[scenes.number(&check.scene)] {
            td { (check.scene) }
            td { (value) }
            td { (bound) }
            td { (number::share(pretty, check.share())) }
            td { (meter(check)) }
            td {
                @if check.passed() { "✓" } @else { "✗" }
                @if !check.passed() && check.value <= check.bound { br; "not finite" }
            }
        }
    }
}

/// All digits.
fn exact(value: f64) -> String {
    format!("{value:e}")
}

/// The share of the bound as a bar on a logarithmic scale from 1e-6 to 100, with a line at the bound, at 75 %.
fn meter(check: &Check) -> Markup {
    let length = (12.5 * (check.share().log10() + 6.0)).clamp(0.0, 100.0);
    // A NaN fills the bar: it is beyond every bound.
    let length = if length.is_nan() { 100.0 } else { length };
    html! { i style=(format!("--v:{length:.0}%")) {} }
}

fn entries(check: &Check) -> Markup {
    let has = |wanted: fn(&Entry) -> bool| check.table.iter().any(wanted);
    let (columns, springs) = (has(|entry| entry.column.is_some()), has(|entry| entry.spring.is_some()));
    let index = |index: Option<usize>| index.map(|index| index.to_string()).unwrap_or_default();
    let table = html! {
        table.cards {
            thead { tr {
                th scope="col" { "in words" }
                @if springs { th.number scope="col" { "spring" } }
                th.number scope="col" { "row" }
                @if columns { th.number scope="col" { "column" } }
                th.number scope="col" { "analytic" }
                th.number scope="col" { "numeric" }
                th.number scope="col" { "difference" }
                th.number scope="col" { "relative" }
            } }
            tbody {
                @for entry in &check.table {
                    tr {
                        td.words { (entry.verdict) }
                        @if springs { td.number data-of="spring" { (index(entry.spring)) } }
                        td.number data-of="row" { (entry.row) }
                        @if columns { td.number data-of="column" { (index(entry.column)) } }
                        td.number data-of="analytic" title=(exact(entry.analytic)) { (pretty(entry.analytic)) }
                        td.number data-of="numeric" title=(exact(entry.numeric)) { (pretty(entry.numeric)) }
                        td.number data-of="difference" { (pretty(entry.absolute)) }
                        td.number data-of="relative" { (pretty(entry.relative)) }
                    }
                }
            }
        }
    };
    page::scrolling(&format!("Worst entries on {}", check.scene), &table)
}

/// Figures of the failed checks, then of those that passed most narrowly; the numbers of all others are in the table.
fn pictures(failed: &[(usize, &Check)], passed: &[(usize, &Check)], narrowest: usize) -> Markup {
    let with_figures = |checks: &[&(usize, &Check)]| checks.iter().filter(|(_, check)| has_pictures(check)).count();
    let shown: Vec<&(usize, &Check)> =
        failed.iter().take(FAILURES).chain(nearest(passed, narrowest, has_pictures)).collect();
    let all: Vec<&(usize, &Check)> = failed.iter().chain(passed).collect();
    let left_out = with_figures(&all) - with_figures(&shown);
    let figures: Vec<Markup> = shown.iter().flat_map(|(_, check)| pictures_of(check)).collect();
    html! {
        (page::figures(&figures))
        @if left_out > 0 {
            p.quiet { "Figures of " (count(left_out, "further check")) " are left out; those nearest their bounds are shown." }
        }
    }
}

fn has_pictures(check: &Check) -> bool {
    !check.curves.is_empty() || check.drawing.is_some()
}

/// The few checks nearest their bounds among those that fulfil a condition, nearest first.
fn nearest<'a, 'c>(
    passed: &'a [(usize, &'c Check)],
    count: usize,
    condition: fn(&Check) -> bool,
) -> Vec<&'a (usize, &'c Check)> {
    let mut chosen: Vec<_> = passed.iter().filter(|(_, check)| condition(check)).collect();
    chosen.sort_by(|(_, a), (_, b)| b.share().total_cmp(&a.share()));
    chosen.truncate(count);
    chosen
}

fn pictures_of(check: &Check) -> Vec<Markup> {
    let caption = html! { (mark(check.passed())) " " (check.scene) };
    let plots = check.curves.iter().map(plot::svg);
    let drawings = check.drawing.iter().map(drawing::svg);
    plots.chain(drawings).map(|svg| page::figure(svg, &caption)).collect()
}
