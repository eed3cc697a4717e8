//! `report.html`: the results for people.

use super::check_html::{anchor, group, mark};
use super::number::{self, count};
use super::{faults, page, shares};
use crate::verify::{Check, Claim, Results, worst};
use maud::{Markup, html};
use std::collections::BTreeSet;

/// A claim's checks, each with its place in the results.
type Numbered<'a> = Vec<(usize, &'a Check)>;

/// The results as one HTML page without scripts and without anything to load.
pub fn html(results: &Results) -> String {
    let claims = by_claim(results);
    let body = html! {
        (banner(results))
        (contents(&claims))
        (reading(results))
        @for (claim, checks) in &claims {
            (claim_section(*claim, checks))
        }
        (faults::section())
    };
    let scenes: BTreeSet<&str> = results.checks.iter().map(|check| check.scene.as_str()).collect();
    let lead = format!(
        "{} on {}, for {}.",
        count(results.checks.len(), "check"),
        count(scenes.len(), "scene"),
        count(claims.len(), "claim")
    );
    page::page("Verification report", &lead, &body)
}

fn by_claim(results: &Results) -> Vec<(Claim, Numbered<'_>)> {
    let numbered = |claim| results.checks.iter().enumerate().filter(move |(_, check)| check.claim == claim);
    let claims = Claim::ALL.iter().map(|&claim| (claim, numbered(claim).collect::<Vec<_>>()));
    claims.filter(|(_, checks)| !checks.is_empty()).collect()
}

fn failed(checks: &[(usize, &Check)]) -> usize {
    checks.iter().filter(|(_, check)| !check.passed()).count()
}

fn banner(results: &Results) -> Markup {
    let total = results.checks.len();
    html! {
        @if total == 0 {
            div.banner.failed { strong { "✗ Nothing was checked" } }
        } @else if results.failed() == 0 {
            div.banner.passed {
                strong { "✓ Every check passed" }
                p { "Every measured error, " (total) " in all, lies within what rounding or truncation analysis allows." }
            }
        } @else {
            div.banner.failed {
                strong { "✗ " (results.failed()) " of " (count(total, "check")) " failed" }
                ul {
                    @for (i, check) in results.checks.iter().enumerate().filter(|(_, check)| !check.passed()) {
                        li { a href=(format!("#{}", anchor(i))) { (check.name) ", " (check.scene) } }
                    }
                }
            }
        }
    }
}

/// The claims as a table that is the table of contents too.
fn contents(claims: &[(Claim, Numbered<'_>)]) -> Markup {
    html! {
        nav aria-label="Contents" {
            h2 { "What was verified" }
            table.full {
                thead { tr {
                    th scope="col" { "claim" }
                    th.number scope="col" { "checks" }
                    th.number scope="col" { "worst value / bound" }
                    th scope="col" { "verdict" }
                } }
                tbody {
                    @for (claim, checks) in claims {
                        @let failed = failed(checks);
                        tr class=[(failed > 0).then_some("failed-row")] {
                            td { a href=(format!("#{}", claim.id())) { (claim.title()) } }
                            td.number { (checks.len()) }
                            td.number { (number::share(number::pretty, worst(checks.iter().map(|(_, check)| check.share())))) }
                            td.verdict {
                                @if failed == 0 { span.passed { "✓" span.word { " holds" } } }
                                @else { span.failed { "✗ " (failed) span.word { " failed" } } }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn reading(results: &Results) -> Markup {
    let caption = html! {
        "Every ring is a check that passed, every cross one that failed. Left of the line the error is smaller than its \
         bound; far left means that it is much smaller, or exactly zero."
    };
    let body = html! {
        p {
            "This program moves particles that are joined by springs. At every step it builds a large matrix and solves \
             a linear system with it. Here it is held against mathematics: each check measures one error and compares it \
             with the largest error that is allowed."
        }
        dl.reading {
            dt { "value" } dd { "the error that was measured in this run; never assumed, never typed in" }
            dt { "bound" } dd {
                "the largest error that the arithmetic of the computer, or the known inaccuracy of a method, can explain. \
                 It comes from an analysis, stated beside it as its reason, and not from what the program happens to give"
            }
            dt { "value / bound" } dd {
                "up to 1 the check passes. The bar shows it on a logarithmic scale from 10⁻⁶ to 100; the line on it is the bound"
            }
            dt { "10⁻¹⁶" } dd {
                "is about the rounding error of one operation: the computer keeps 16 digits. Errors of this size are as small as they can be"
            }
        }
        @if !results.checks.is_empty() {
            div.single { (page::figure(shares::svg(results), &caption)) }
        }
    };
    page::section("reading", &html! { "How to read this" }, &body)
}

/// About so many checks of a claim are shown with figures.
const FIGURES: usize = 32;

fn claim_section(claim: Claim, checks: &[(usize, &Check)]) -> Markup {
    let mut names: Vec<&str> = Vec::new();
    for (_, check) in checks {
        if !names.contains(&check.name.as_str()) {
            names.push(&check.name);
        }
    }
    // A claim with many checks shows fewer figures of each.
    let narrowest = (FIGURES / names.len().max(1)).clamp(1, 4);
    let failed = failed(checks);
    let heading = html! { (mark(failed == 0)) " " (claim.title()) };
    let body = html! {
        p.formula { (page::formula(claim.formula())) }
        p { (claim.explanation()) }
        p.quiet {
            (count(checks.len(), "check"))
            @if failed == 0 { ", all passed." } @else { ", " (failed) " failed." }
        }
        @for name in names {
            (group(name, &checks.iter().copied().filter(|(_, check)| check.name == name).collect::<Vec<_>>(), narrowest))
        }
    };
    page::section(claim.id(), &heading, &body)
}
