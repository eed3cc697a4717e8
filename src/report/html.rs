//! `report.html`: the results for people.

use super::check_html::{Scenes, anchor, group, mark};
use super::number::{self, count};
use super::{bound_usage, faults, page};
use crate::verify::{Check, Claim, Results, worst};
use maud::{Markup, PreEscaped, html};

/// A claim's checks, each with its place in the results.
type Numbered<'a> = Vec<(usize, &'a Check)>;

/// The results as one HTML page without scripts and without anything to load.
pub fn html(results: &Results) -> String {
    let claims = by_claim(results);
    let scenes = Scenes::of(&results.checks);
    let body = html! {
        (banner(results))
        @if !claims.is_empty() { (filter(&claims, &scenes)) }
        (contents(&claims))
        (not_judged(results))
        (reading(results))
        @for (claim, checks) in &claims {
            (claim_section(*claim, checks, &scenes))
        }
        (faults::section())
    };
    let lead = format!(
        "{} on {}, for {}.",
        count(results.checks.len(), "check"),
        count(scenes.names().len(), "scene"),
        count(claims.len(), "claim")
    );
    page::page("Verification report", &lead, &body)
}

fn by_claim(results: &Results) -> Vec<(Claim, Numbered<'_>)> {
    let numbered = |claim| results.checks.iter().enumerate().filter(move |(_, check)| check.claim == claim);
    let claims = Claim::ALL.iter().map(|&claim| (claim, numbered(claim).collect::<Vec<_>>()));
    let mut claims: Vec<_> = claims.filter(|(_, checks)| !checks.is_empty()).collect();
    // The worst first: failed ones, then those nearest their bounds; stable, so that claims alike keep their order.
    let share = |checks: &Numbered<'_>| worst(checks.iter().map(|(_, check)| check.share()));
    claims.sort_by(|(_, a), (_, b)| failed(b).cmp(&failed(a)).then(share(b).total_cmp(&share(a))));
    claims
}

/// Choices of what is shown. Style rules do it: the page has no scripts.
fn filter(claims: &[(Claim, Numbered<'_>)], scenes: &Scenes) -> Markup {
    let mut rules = String::new();
    let [failed, passed] = ["tr[id].failed-row", "tr[id]:not(.failed-row)"];
    for (verdict, shown, hidden) in [("failed", failed, passed), ("passed", passed, failed)] {
        let chosen = format!("body:has(#verdict option[value={verdict}]:checked)");
        rules += &format!(
            "{chosen} {hidden},{chosen} .group:not(:has({shown})),{chosen} tbody:has(tr[id]):not(:has({shown})){{display:none}}"
        );
    }
    for (claim, _) in claims {
        let id = claim.id();
        rules += &format!("body:has(#family option[value={id}]:checked) section.claim:not(#{id}){{display:none}}");
    }
    for number in 0..scenes.names().len() {
        let chosen = format!("body:has(#scene option[value=\"{number}\"]:checked)");
        let of_it = format!("[data-s=\"{number}\"]");
        rules += &format!(
            "{chosen} tr[data-s]:not({of_it}),{chosen} .group:not(:has({of_it})),{chosen} tbody:has([data-s]):not(:has({of_it})){{display:none}}"
        );
    }
    let choice = |id: &str, name: &str, options: Vec<(String, &str)>| {
        html! {
            label { (name) " "
                select id=(id) autocomplete="off" {
                    option value="" selected { "all" }
                    @for (value, text) in options { option value=(value) { (text) } }
                }
            }
        }
    };
    html! {
        style { (PreEscaped(rules)) }
        form.filter aria-label="What is shown" {
            (choice("verdict", "Verdict", vec![("failed".into(), "failed"), ("passed".into(), "passed")]))
            (choice("family", "Family", claims.iter().map(|(claim, _)| (claim.id().to_owned(), claim.title())).collect()))
            (choice("scene", "Scene", scenes.names().iter().enumerate().map(|(i, name)| (i.to_string(), name.as_str())).collect()))
        }
    }
}

fn failed(checks: &[(usize, &Check)]) -> usize {
    checks.iter().filter(|(_, check)| !check.passed()).count()
}

fn banner(results: &Results) -> Markup {
    let total = results.checks.len();
    html! {
        @if total == 0 && !results.not_judged.is_empty() {
            div.banner.passed { strong { "Nothing could be judged" } p { "The numbers of the scene are the reason, see below." } }
        } @else if total == 0 {
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

/// What the numbers of a scene do not allow to be judged.
fn not_judged(results: &Results) -> Markup {
    let body = html! {
        p { "On these scenes these checks say nothing, neither that something is right nor that it is wrong; the reason is a number of the scene." }
        table.full {
            thead { tr { th scope="col" { "check" } th scope="col" { "scene" } th scope="col" { "reason" } } }
            tbody {
                @for check in &results.not_judged {
                    tr { td { (check.name) } td { (check.scene) } td { (number::typeset(&check.why)) } }
                }
            }
        }
    };
    html! {
        @if !results.not_judged.is_empty() {
            (page::section("not-judged", &html! { "What was not judged" }, &body))
        }
    }
}

fn reading(results: &Results) -> Markup {
    let caption = html! {
        "Every ring is a check that passed or several at one place, every cross one that failed. Left of the line the error is smaller than its \
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
            dt { "1" } dd {
                "exactly at the bound: checks of counts and of yes or no, whose value is right when it is the bound; \
                 next to it as many digits are written as it takes to see on which side of the bound a number lies, or how far from it: 1 − 2 × 10⁻⁹ lies below"
            }
            dt { "10⁻¹⁶" } dd {
                "is about the rounding error of one operation: the computer keeps 16 digits. Errors of this size are as small as they can be"
            }
        }
        @if !results.checks.is_empty() {
            div.single { (page::figure(bound_usage::svg(results), &caption)) }
        }
    };
    page::section("reading", &html! { "How to read this" }, &body)
}

/// About so many checks of a claim are shown with figures.
const FIGURES: usize = 12;

fn claim_section(claim: Claim, checks: &[(usize, &Check)], scenes: &Scenes) -> Markup {
    let mut sorted = checks.to_vec();
    sorted.sort_by(|(_, a), (_, b)| a.passed().cmp(&b.passed()).then(b.share().total_cmp(&a.share())));
    let mut names: Vec<&str> = Vec::new();
    for (_, check) in &sorted {
        if !names.contains(&check.name.as_str()) {
            names.push(&check.name);
        }
    }
    // A claim with many checks shows fewer figures of each.
    let narrowest = (FIGURES / names.len().max(1)).clamp(1, 2);
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
            (group(name, &checks.iter().copied().filter(|(_, check)| check.name == name).collect::<Vec<_>>(), narrowest, scenes))
        }
    };
    html! { section.claim id=(claim.id()) { h2 { (heading) } (body) } }
}
