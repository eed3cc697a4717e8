//! `report.html`: the results of a verification for people.

use super::check_html::{Numbered, anchor, claim_section, failed, scenes, worst_share};
use super::number::{self, count, typeset};
use super::page::{self, Column, Row};
use crate::verify::{Claim, Results};
use maud::{Markup, PreEscaped, html};
use serde::Deserialize;

/// The results as one HTML page without scripts and without anything to load.
pub fn html(results: &Results) -> String {
    let of = |claim| results.checks.iter().enumerate().filter(move |(_, check)| check.claim == claim);
    let mut claims: Vec<(Claim, Numbered<'_>)> = Claim::ALL.map(|claim| (claim, of(claim).collect())).into();
    claims.retain(|(_, checks)| !checks.is_empty());
    // The worst first: failed ones, then those nearest their bounds.
    claims.sort_by(|(_, a), (_, b)| failed(b).cmp(&failed(a)).then(worst_share(b).total_cmp(&worst_share(a))));
    let scenes = scenes(&results.checks);
    let body = html! {
        (banner(results))
        @if !claims.is_empty() { (filter(&claims, &scenes)) }
        (contents(&claims))
        (not_verified(results))
        (reading())
        @for (claim, checks) in &claims { (claim_section(*claim, checks, &scenes)) }
        (faults())
    };
    let [checks, scenes] = [count(results.checks.len(), "check"), count(scenes.len(), "scene")];
    let lead = format!("{checks} on {scenes}, for {}.", count(claims.len(), "claim"));
    page::page("Verification report", &lead, &body)
}

/// Choices of what is shown. Style rules do it: the page has no scripts.
fn filter(claims: &[(Claim, Numbered<'_>)], scenes: &[String]) -> Markup {
    let mut rules = String::new();
    let mut rule = |field: &str, value: &str, row: &str, shown: &str| {
        let chosen = format!("body:has(#{field} option[value=\"{value}\"]:checked)");
        rules += &format!(
            "{chosen} tr[id]:not({shown}),{chosen} .group:not(:has({row}{shown})),{chosen} tbody:has(tr[id]):not(:has({row}{shown})){{display:none}}"
        );
    };
    rule("verdict", "failed", "tr[id]", ".failed-row");
    rule("verdict", "passed", "tr[id]", ":not(.failed-row)");
    for number in 0..scenes.len() {
        rule("scene", &number.to_string(), "", &format!("[data-s=\"{number}\"]"));
    }
    for (claim, _) in claims {
        let id = claim.id();
        rules += &format!("body:has(#family option[value={id}]:checked) section.claim:not(#{id}){{display:none}}");
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
    let families = claims.iter().map(|(claim, _)| (claim.id().to_owned(), claim.title())).collect();
    let scenes = scenes.iter().enumerate().map(|(i, name)| (i.to_string(), name.as_str())).collect();
    html! {
        style { (PreEscaped(rules)) }
        form.filter aria-label="What is shown" {
            (choice("verdict", "Verdict", vec![("failed".into(), "failed"), ("passed".into(), "passed")]))
            (choice("family", "Family", families))
            (choice("scene", "Scene", scenes))
        }
    }
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

/// The claims as a table of contents: how near their checks come to their bounds, and the planted faults that no other claim has a check for.
fn contents(claims: &[(Claim, Numbered<'_>)]) -> Markup {
    let columns = [
        ("claim, and what is measured", Column::Text),
        ("checks", Column::Number),
        ("value / bound: worst", Column::Number),
        ("median", Column::Number),
        ("faults that it alone catches", Column::Number),
        ("verdict", Column::Text),
    ];
    let faults = recorded_faults();
    let row = |(claim, checks): &(Claim, Numbered<'_>)| {
        let failed = failed(checks);
        let verdict = html! {
            @if failed == 0 { span.verdict.passed { "✓" span.word { " holds" } } }
            @else { span.verdict.failed { "✗ " (failed) span.word { " failed" } } }
        };
        let mut shares: Vec<f64> = checks.iter().map(|(_, check)| check.share()).collect();
        shares.sort_by(f64::total_cmp);
        let alone = faults.iter().filter(|fault| fault.families == 1 && fault.claim() == claim.id()).count();
        let cells = vec![
            html! { a href=(format!("#{}", claim.id())) { (claim.title()) } br; small.quiet { (page::formula(claim.formula())) } },
            html! { (checks.len()) },
            html! { (number::share(number::pretty, worst_share(checks))) },
            html! { (number::share(number::pretty, shares[shares.len() / 2])) },
            html! { (alone) },
            verdict,
        ];
        if failed == 0 { Row::Cells(cells) } else { Row::Failed(cells) }
    };
    html! {
        nav aria-label="Contents" {
            h2 { "What was verified" }
            (page::table("Claims", "full cards", &columns, claims.iter().map(row)))
        }
    }
}

fn not_verified(results: &Results) -> Markup {
    const LIMITS: [&str; 5] = [
        "A force law that is wrong in force, energy and matrix alike passes every derivative; only known answers and prescribed motions, which \
         cargo test runs, tell.",
        "Orders say nothing of the matrix, and momentum and rigid motions hold for any law along the line between two particles.",
        "Checks see steps and equations. The error of a whole run is estimated by the run itself.",
        "Scenes of more than 2000 coordinates are not run for orders, nor those of more than 200 for dense eigenvalues.",
        "A relative error of some 10⁻¹⁵ cannot be told from rounding.",
    ];
    let columns = [("check", Column::Text), ("scene", Column::Text), ("reason", Column::Text)];
    let rows = results.not_judged.iter().map(|check| {
        Row::Cells(vec![html! { (check.name) }, html! { (check.scene) }, html! { (typeset(&check.why)) }])
    });
    let table = page::table("What was not judged", "full", &columns, rows);
    let body = html! {
        ul { @for limit in LIMITS { li { (limit) } } }
        @if !results.not_judged.is_empty() {
            p {
                (count(results.not_judged.len(), "check")) " could not be judged, neither as right nor as wrong; the reason is a number of the scene."
            }
            (page::folded("What was not judged", &table))
        }
    };
    page::section("not-verified", "What is not verified", &body)
}

fn reading() -> Markup {
    let terms = [
        ("value", "the error that was measured in this run; never assumed, never typed in"),
        (
            "bound",
            "the largest error that the arithmetic of the computer, or the known inaccuracy of a method, can explain. \
             It comes from an analysis, stated beside it as its reason, and not from what the program happens to give",
        ),
        (
            "value / bound",
            "up to 1 the check passes. The bar shows it on a logarithmic scale from 10⁻⁶ to 100; the line on it is the bound",
        ),
        ("1", "exactly at the bound: checks of counts and of yes or no, whose value is right when it is the bound"),
        (
            "just below 1",
            "by less than 10⁻⁸: the bound is sharp. An estimate that never exceeds the true number, as that of a condition number, often meets it \
             but for rounding; all digits are in report.json",
        ),
        (
            "10⁻¹⁶",
            "is about the rounding error of one operation: the computer keeps 16 digits. Errors of this size are as small as they can be",
        ),
    ];
    let body = html! {
        p {
            "This program moves particles that are joined by springs. At every step it builds a large matrix and solves \
             a linear system with it. Here it is held against mathematics: each check measures one error and compares it \
             with the largest error that is allowed."
        }
        (page::folded("Words and numbers", &html! { dl.reading { @for (term, meaning) in terms { dt { (term) } dd { (meaning) } } } }))
    };
    page::section("reading", "How to read this", &body)
}

#[derive(Deserialize)]
struct Fault {
    fault: String,
    function: String,
    tests: usize,
    families: usize,
    by: Vec<(String, usize)>,
}

impl Fault {
    /// The claim that has the most tests of it.
    fn claim(&self) -> String {
        let family = self.by.first().and_then(|(family, _)| family.split("::").next());
        family.unwrap_or_default().replace('_', "-")
    }
}

/// `faults.json` is written by the program that plants the faults.
fn recorded_faults() -> Vec<Fault> {
    serde_json::from_str(include_str!("faults.json")).unwrap_or_default()
}

fn faults() -> Markup {
    let faults = recorded_faults();
    let survived = faults.iter().filter(|fault| fault.tests == 0).count();
    let columns = [
        ("fault", Column::Text),
        ("in", Column::Named),
        ("tests that fail", Column::Number),
        ("among them", Column::Named),
    ];
    let row = |fault: &Fault| {
        let families: Vec<&str> = fault.by.iter().take(3).map(|(family, _)| family.as_str()).collect();
        let more = fault.families.saturating_sub(families.len());
        Row::Cells(vec![
            html! { (fault.fault) },
            html! { code { (fault.function) } },
            html! { (fault.tests) },
            html! { span.names { (families.join(", ")) @if more > 0 { " and " (more) " more" } } },
        ])
    };
    let table = page::table("Planted faults", "full cards faults", &columns, faults.iter().map(row));
    let body = html! {
        p {
            "A suite is worth what it catches. Faults that are typical of such programs were put into copies of this one, one \
             at a time, and the whole suite, known answers included, was run on each, or the unit tests of its module where \
             the suite cannot see it. "
            @if survived == 0 { (count(faults.len(), "fault")) ", all caught." }
            @else { (survived) " of " (count(faults.len(), "fault")) " survived." }
        }
        (page::folded("The faults, and which checks caught them", &table))
    };
    page::section("faults", "What these checks catch", &body)
}
