//! Checks on a page, by claim and by name: their numbers, figures and worst entries.

use super::number::{self, count, pretty, short_pair, typeset};
use super::page::{self, Column, Row};
use super::{drawing, plot};
use crate::verify::{Check, Claim, Entry, worst};
use maud::{Markup, html};

/// Checks, each with its place in the results.
pub(super) type Numbered<'a> = Vec<(usize, &'a Check)>;

/// The scenes of all checks without what was varied on them, in their order, by which a page is filtered.
pub(super) fn scenes(checks: &[Check]) -> Vec<String> {
    let mut names: Vec<String> = checks.iter().map(|check| base(&check.scene).to_owned()).collect();
    names.sort_unstable();
    names.dedup();
    names
}

/// `cloth` of `cloth, full, dt = 0.01`.
fn base(scene: &str) -> &str {
    scene.split(',').next().unwrap_or(scene).trim()
}

pub(super) fn anchor(index: usize) -> String {
    format!("check-{index}")
}

pub(super) fn failed(checks: &[(usize, &Check)]) -> usize {
    checks.iter().filter(|(_, check)| !check.passed()).count()
}

pub(super) fn worst_share(checks: &[(usize, &Check)]) -> f64 {
    worst(checks.iter().map(|(_, check)| check.share()))
}

/// ✓ or ✗, with a word for those who hear the page.
fn mark(passed: bool) -> Markup {
    html! {
        @if passed { span.passed role="img" aria-label="holds" { "✓" } }
        @else { span.failed role="img" aria-label="fails" { "✗" } }
    }
}

pub(super) fn claim_section(claim: Claim, checks: &[(usize, &Check)], scenes: &[String]) -> Markup {
    let mut sorted = checks.to_vec();
    sorted.sort_by(|(_, a), (_, b)| a.passed().cmp(&b.passed()).then(b.share().total_cmp(&a.share())));
    let mut groups: Vec<(&str, Numbered<'_>)> = Vec::new();
    for entry in sorted {
        match groups.iter_mut().find(|(name, _)| *name == entry.1.name) {
            Some((_, group)) => group.push(entry),
            None => groups.push((&entry.1.name, vec![entry])),
        }
    }
    // A claim with many checks shows fewer figures of each.
    let narrowest = (12 / groups.len().max(1)).clamp(1, 2);
    let failed = failed(checks);
    html! {
        section.claim id=(claim.id()) {
            h2 { (mark(failed == 0)) " " (claim.title()) }
            p.formula { (page::formula(claim.formula())) }
            p { (claim.explanation()) }
            p.quiet {
                (count(checks.len(), "check"))
                @if failed == 0 { ", all passed." } @else { ", " (failed) " failed." }
            }
            @for (name, checks) in groups { (group(name, checks, narrowest, scenes)) }
        }
    }
}

/// The same check on all its scenes, the worst first; what passed is folded away, but for the `narrowest` ones nearest their bounds.
fn group(name: &str, checks: Numbered<'_>, narrowest: usize, scenes: &[String]) -> Markup {
    let worst = number::share(pretty, worst_share(&checks));
    let (failed, passed): (Numbered<'_>, Numbered<'_>) = checks.into_iter().partition(|(_, check)| !check.passed());
    let tables = passed.iter().filter(|(_, check)| !check.table.is_empty()).take(narrowest);
    let body = html! {
        @if !passed.is_empty() { (values(name, &passed, scenes)) }
        @for (_, check) in tables {
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

/// The numbers, those with the same reason for their bound together below it.
fn values(name: &str, checks: &[(usize, &Check)], scenes: &[String]) -> Markup {
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
                @for heading in ["value", "bound", "value / bound"] { th.number scope="col" { (heading) } }
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

/// A row, short since there are thousands: the style sheet knows its cells by their place, and adds the word to the mark.
fn value_row(index: usize, check: &Check, scenes: &[String]) -> Markup {
    let [value, bound] = short_pair(check.value, check.bound);
    // A bar on a logarithmic scale from 1e-6 to 100 has the bound at 75 %; a NaN, which is beyond every bound, fills it.
    let length = 12.5 * (check.share().log10() + 6.0);
    let length = if length.is_nan() { 100.0 } else { length.clamp(0.0, 100.0) };
    let scene = scenes.binary_search_by(|name| name.as_str().cmp(base(&check.scene))).ok();
    html! {
        tr id=(anchor(index)) class=[(!check.passed()).then_some("failed-row")] data-s=[scene] {
            td { (check.scene) }
            td { (value) }
            td { (bound) }
            td { (number::share(pretty, check.share())) }
            td { i style=(format!("--v:{length:.0}%")) {} }
            td {
                @if check.passed() { "✓" } @else { "✗" }
                @if !check.passed() && check.value <= check.bound { br; "not finite" }
            }
        }
    }
}

type Cell = fn(&Entry) -> Option<Markup>;

fn entries(check: &Check) -> Markup {
    fn exact(value: f64) -> Markup {
        html! { span title=(format!("{value:e}")) { (pretty(value)) } }
    }
    let columns: [(&str, Column, Cell); 8] = [
        ("in words", Column::Text, |entry| Some(html! { span.words { (entry.verdict) } })),
        ("spring", Column::Number, |entry| entry.spring.map(|spring| html! { (spring) })),
        ("row", Column::Number, |entry| Some(html! { (entry.row) })),
        ("column", Column::Number, |entry| entry.column.map(|column| html! { (column) })),
        ("analytic", Column::Number, |entry| Some(exact(entry.analytic))),
        ("numeric", Column::Number, |entry| Some(exact(entry.numeric))),
        ("difference", Column::Number, |entry| Some(html! { (pretty(entry.absolute)) })),
        ("relative", Column::Number, |entry| Some(html! { (pretty(entry.relative)) })),
    ];
    let shown: Vec<_> = columns.iter().filter(|(.., cell)| check.table.iter().any(|e| cell(e).is_some())).collect();
    let headings: Vec<(&str, Column)> = shown.iter().map(|&&(heading, kind, _)| (heading, kind)).collect();
    let row = |entry| Row::Cells(shown.iter().map(|(.., cell)| cell(entry).unwrap_or_default()).collect());
    page::table(&format!("Worst entries on {}", check.scene), "cards", &headings, check.table.iter().map(row))
}

/// Figures of the failed checks, then of those that passed most narrowly; the numbers of all others are in the table.
fn pictures(failed: &[(usize, &Check)], passed: &[(usize, &Check)], narrowest: usize) -> Markup {
    let has_pictures = |(_, check): &&(usize, &Check)| !check.curves.is_empty() || check.drawing.is_some();
    let all = failed.iter().chain(passed).filter(has_pictures).count();
    let shown = failed.iter().filter(has_pictures).take(12).chain(passed.iter().filter(has_pictures).take(narrowest));
    let shown: Vec<&Check> = shown.map(|(_, check)| *check).collect();
    let figures = shown.iter().flat_map(|check| {
        let caption = html! { (mark(check.passed())) " " (check.scene) };
        let pictures = check.curves.iter().map(plot::svg).chain(check.drawing.iter().map(drawing::svg));
        pictures.map(move |svg| page::figure(svg, &caption))
    });
    html! {
        (page::figures(figures))
        @if all > shown.len() {
            p.quiet { "Figures of " (count(all - shown.len(), "further check")) " are left out; those nearest their bounds are shown." }
        }
    }
}
