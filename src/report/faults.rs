//! Which planted faults the suite catches: what its verdict is worth.

use super::number::count;
use super::page;
use maud::{Markup, html};
use serde::Deserialize;

/// Written by the program that plants the faults, when it was last run.
const RECORD: &str = include_str!("faults.json");

/// How many families of tests a row names.
const NAMED: usize = 3;

#[derive(Deserialize)]
struct Fault {
    fault: String,
    function: String,
    tests: usize,
    families: usize,
    by: Vec<(String, usize)>,
}

/// The table of planted faults.
pub(super) fn section() -> Markup {
    let faults: Vec<Fault> = serde_json::from_str(RECORD).unwrap_or_default();
    let survived = faults.iter().filter(|fault| fault.tests == 0).count();
    let row = |fault: &Fault| {
        let families: Vec<&str> = fault.by.iter().take(NAMED).map(|(family, _)| family.as_str()).collect();
        let more = fault.families.saturating_sub(families.len());
        html! {
            tr {
                td { (fault.fault) }
                td data-of="in" { code { (fault.function) } }
                td.number data-of="tests that fail" { (fault.tests) }
                td.names data-of="among them" { (families.join(", ")) @if more > 0 { " and " (more) " more" } }
            }
        }
    };
    let body = html! {
        p {
            "A suite is worth what it catches. Faults that are typical of such programs were put into copies of this one, one \
             at a time, and the whole suite, known answers included, was run on each. "
            @if survived == 0 { (count(faults.len(), "fault")) ", all caught." }
            @else { (survived) " of " (count(faults.len(), "fault")) " survived." }
        }
        (page::folded("The faults, and which checks caught them", &page::scrolling("Planted faults", &html! {
            table.full.cards.faults {
                thead { tr {
                    th scope="col" { "fault" }
                    th scope="col" { "in" }
                    th.number scope="col" { "tests that fail" }
                    th scope="col" { "among them" }
                } }
                tbody { @for fault in &faults { (row(fault)) } }
            }
        })))
    };
    page::section("faults", &html! { "What these checks catch" }, &body)
}
