//! Checks of one name on a page: their numbers, figures and worst entries.

use super::number::{self, count, pair, pretty};
use super::palette::{self, css};
use super::{drawing, page, plot};
use crate::verify::{Check, Entry};
use maud::{Markup, html};

/// More rows than this are folded away.
const ROWS: usize = 12;
/// Of so many failed checks of a name figures are shown.
const FAILURES: usize = 12;

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

/// The same check on all its scenes. Of `narrowest` passed ones, those nearest their bounds, figures and worst entries are
/// shown.
pub(super) fn group(name: &str, checks: &[(usize, &Check)], narrowest: usize) -> Markup {
    let (failed, passed): (Vec<_>, Vec<_>) = checks.iter().partition(|(_, check)| !check.passed());
    let shown = if checks.len() > ROWS { &failed } else { checks };
    let rest = if checks.len() > ROWS { &passed } else { &Vec::new() };
    html! {
        h3 { (name) }
        @if !shown.is_empty() { (values(name, shown)) }
        @if !rest.is_empty() {
            (page::folded(&format!("{} on other scenes, all passed", count(rest.len(), "check")), &values(name, rest)))
        }
        @for (_, check) in failed.iter().filter(|(_, check)| !check.table.is_empty()) {
            p { "Worst entries on " b { (check.scene) } ":" }
            (entries(check))
        }
        @for (_, check) in nearest(&passed, narrowest, |check| !check.table.is_empty()) {
            (page::folded(&format!("Worst entries on {}", check.scene), &entries(check)))
        }
        (pictures(&failed, &passed, narrowest))
    }
}

/// The numbers, those with the same reason for their bound together below it.
fn values(name: &str, checks: &[(usize, &Check)]) -> Markup {
    let mut reasons: Vec<&str> = Vec::new();
    for (_, check) in checks {
        if !reasons.contains(&check.why.as_str()) {
            reasons.push(&check.why);
        }
    }
    let table = html! {
        table.full {
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
                    tr.why { td colspan="6" { "Bound: " (why) } }
                    @for &(index, check) in checks.iter().filter(|(_, check)| check.why == why) { (value_row(index, check)) }
                }
            }
        }
    };
    page::scrolling(name, &table)
}

fn value_row(index: usize, check: &Check) -> Markup {
    let [value, bound] = pair(pretty, check.value, check.bound);
    html! {
        tr id=(anchor(index)) class=[(!check.passed()).then_some("failed-row")] {
            td.name { (check.scene) }
            td.number title=(check.value) { (value) }
            td.number title=(check.bound) { (bound) }
            td.number { (number::share(pretty, check.share())) }
            td.bar { (meter(check)) }
            td.verdict {
                @if check.passed() { span.passed { "✓" span.word { " passed" } } }
                @else { span.failed { "✗" span.word { " failed" } @if check.value <= check.bound { br; "not finite" } } }
            }
        }
    }
}

/// The share of the bound as a bar on a logarithmic scale from 1e-6 to 100, with a line at the bound.
fn meter(check: &Check) -> Markup {
    let place = |share: f64| (12.5 * (share.log10() + 6.0)).clamp(0.0, 100.0);
    let (length, bound) = (place(check.share()), place(1.0));
    // A NaN fills the bar: it is beyond every bound.
    let length = if length.is_nan() { 100.0 } else { length };
    let colour = if check.passed() { palette::PASS } else { palette::FAIL };
    html! {
        svg.meter viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true" {
            rect width="100" height="10" fill="#8c969f" fill-opacity="0.22" {}
            rect width=(format!("{length:.1}")) height="10" fill=(css(colour)) {}
            rect x=(bound - 0.8) width="1.6" height="10" fill="currentColor" {}
        }
    }
}

fn entries(check: &Check) -> Markup {
    let has = |wanted: fn(&Entry) -> bool| check.table.iter().any(wanted);
    let (columns, springs) = (has(|entry| entry.column.is_some()), has(|entry| entry.spring.is_some()));
    let index = |index: Option<usize>| index.map(|index| index.to_string()).unwrap_or_default();
    let table = html! {
        table {
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
                        @if springs { td.number { (index(entry.spring)) } }
                        td.number { (entry.row) }
                        @if columns { td.number { (index(entry.column)) } }
                        td.number title=(entry.analytic) { (pretty(entry.analytic)) }
                        td.number title=(entry.numeric) { (pretty(entry.numeric)) }
                        td.number { (pretty(entry.absolute)) }
                        td.number { (pretty(entry.relative)) }
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
