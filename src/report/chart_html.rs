//! `chart.html`: speed against accuracy, and the limits of stability, for people.

use super::number::{self, pretty, typeset};
use super::{page, plot, tiles};
use crate::chart::stability::{StabilityMap, Varied};
use crate::chart::{Decision, Figure, Run, WorkPrecision};
use maud::{Markup, html};
use std::collections::BTreeMap;

/// The chart as one HTML page without scripts and without anything to load.
pub fn chart_html(chart: &WorkPrecision, map: &StabilityMap) -> String {
    let figures = chart.figures();
    let named = |names: &[&str]| {
        let chosen = figures.iter().filter(|figure| names.contains(&figure.name));
        page::figures(&chosen.map(picture).collect::<Vec<_>>())
    };
    let body = html! {
        (decision(chart))
        (page::section("methods", &html! { "The best option of each method" }, &methods(chart)))
        (page::section("speed", &html! { "Speed against accuracy" }, &html! {
            p {
                "Every point is one run of the whole motion. Of each method the stiffness option and solver that cost least over \
                 all accuracies are drawn; for one accuracy another may cost less. Work is counted in force evaluations of this scene: it is the same as often as a run is repeated, time is not."
            }
            (named(&["time", "work", "solves", "error"]))
            (failures(chart))
        }))
        (page::section("options", &html! { "Stiffness options and solvers" }, &named(&["options-euler", "options-w2"])))
        (page::section("drift", &html! { "What methods add or take away" }, &named(&["energy", "angular-momentum"])))
        (page::section("solvers", &html! { "Linear solvers" }, &named(&["tolerance-error", "tolerance-work", "sizes-cloth", "sizes-lattice"])))
        @if !map.tiles.is_empty() { (stability(map)) }
        (page::section("runs", &html! { "All runs" }, &page::folded(&number::count(chart.runs.len(), "run"), &table(&chart.runs))))
    };
    let lead = typeset(&format!(
        "A motion of {} s; errors are measured against {}, whose own error is about {}.",
        chart.duration,
        chart.reference.method,
        pretty(chart.reference.error_estimate)
    ));
    page::page(&format!("Speed against accuracy: {}", chart.scene), &lead, &body)
}

fn picture(figure: &Figure) -> Markup {
    page::figure(plot::svg(&figure.plot), &html! { (typeset(&figure.caption)) })
}

fn decision(chart: &WorkPrecision) -> Markup {
    html! {
        div.banner.passed {
            strong { "What to use" }
            ul { @for sentence in chart.recommendations() { li { (typeset(&sentence)) } } }
        }
    }
}

/// Accuracies whose table stands open; those of smaller errors are folded away.
const OPEN: usize = 2;

/// Of each method the option, solver and step with the least work, for every accuracy that can be had.
fn methods(chart: &WorkPrecision) -> Markup {
    let decisions = chart.decisions();
    let (open, folded) = decisions.split_at(decisions.len().min(OPEN));
    html! {
        p {
            "Only steps from which on every shorter one of the same method, option and solver succeeded and erred less: what a longer step \
             did by luck is not advice. The least work, in force evaluations, stands first."
        }
        @if decisions.is_empty() {
            p { "No method has such steps with an error below 10 %: give the chart more time, or a shorter motion." }
        } @else {
            (page::scrolling("The best option of each method for the larger errors", &best(open)))
        }
        @if !folded.is_empty() {
            (page::folded("For smaller errors", &page::scrolling("The best option of each method for the smaller errors", &best(folded))))
        }
        (page::folded("How long the steps of each may be", &html! {
            table { tbody {
                @for (name, reach) in chart.reaches() { tr { td { (name) } td { (typeset(&reach)) } } }
            } }
        }))
    }
}

fn best(decisions: &[Decision<'_>]) -> Markup {
    html! {
        table.full.cards {
            thead { tr {
                th scope="col" { "method" } th scope="col" { "stiffness" } th scope="col" { "solver" } th scope="col" { "steps" }
                th.number scope="col" { "work" } th.number scope="col" { "time, s" } th.number scope="col" { "error" }
            } }
            @for decision in decisions {
                tbody {
                    tr.why { td colspan="7" { (typeset(&format!("For an error below {} %:", decision.percent()))) } }
                    @for run in &decision.methods { tr {
                        td { (run.method) @if run.rtol.is_some() { ", adaptive" } } td { (run.stiffness) } td { (run.solver) } td { (typeset(&run.pace())) }
                        td.number data-of="work" { (pretty(run.cost.round())) } td.number data-of="time, s" { (pretty(run.wall_seconds)) }
                        td.number data-of="error" { (run.error.map_or(String::new(), pretty)) }
                    } }
                }
            }
        }
    }
}

/// Failed runs by configuration and cause.
fn failures(chart: &WorkPrecision) -> Markup {
    let mut groups: BTreeMap<(&str, &str, &str, String), Vec<f64>> = BTreeMap::new();
    for run in &chart.runs {
        if let Some(cause) = run.cause() {
            groups.entry((run.method, run.stiffness, run.solver, cause)).or_default().push(run.dt);
        }
    }
    let rows = html! {
        table.full.causes.cards {
            thead { tr { th scope="col" { "method" } th scope="col" { "stiffness" } th scope="col" { "solver" } th scope="col" { "what failed" } th scope="col" { "at steps of" } } }
            tbody {
                @for ((method, stiffness, solver, cause), steps) in &groups {
                    tr {
                        td { (method) } td { (stiffness) } td { (solver) } td { (cause) }
                        td data-of="at steps of" { (steps.iter().map(|dt| pretty(*dt)).collect::<Vec<_>>().join(", ")) " s" }
                    }
                }
            }
        }
    };
    html! {
        @if !groups.is_empty() {
            h3 { "Runs that failed" }
            (page::scrolling("Runs that failed", &rows))
        }
    }
}

fn stability(map: &StabilityMap) -> Markup {
    let (predicted, contradictions) = map.agreement();
    let of = |axis| {
        let tiles = map.tiles.iter().filter(move |tile| tile.axis == axis);
        tiles
            .map(|tile| page::figure(tiles::svg(&tile.figure()), &html! { (caption(tile.limits.concat().is_empty())) }))
    };
    let body = html! {
        p {
            "One particle between two springs to fixed walls, moved a thousandth of its spring's length off the middle. ω is the \
             frequency of its vibration along the springs. A cell is one run of up to 2000 steps, coloured by what failed first; \
             the lines are limits that theory gives. Above λ = 1 the springs are stretched and the particle swings across them \
             with the frequency ω √(1 − 1/λ); below they are compressed and it buckles."
        }
        p.quiet {
            "Of " (predicted) " cells about which theory says something, " (contradictions) " contradict it."
        }
        h3 { "Over the stretch, without damping" }
        (page::figures(&of(Varied::Stretch).collect::<Vec<_>>()))
        h3 { "Over damping, with springs of twice their rest length" }
        p { "The dampers act along the springs only: they do nothing for the motion across." }
        (page::figures(&of(Varied::Damping).collect::<Vec<_>>()))
        h3 { "Over turning: what no linear model shows" }
        p {
            "One particle that circles a fixed point on a spring; θ is the angle by which a step turns it. After a turn by one radian \
             a run has failed that has lost more than a tenth of its angular momentum, which the exact motion keeps, or stretched the \
             spring by one per cent more than the exact motion does. A method that linearises at the start of its step takes \
             the stretch that comes from stepping straight on for real, and brakes the turning by it."
        }
        (page::figures(&of(Varied::Turning).collect::<Vec<_>>()))
    };
    page::section("stability", &html! { "Where methods are stable" }, &body)
}

fn caption(without_limit: bool) -> &'static str {
    if without_limit { "No limit in closed form crosses this picture." } else { "Lines: limits in closed form." }
}

fn table(runs: &[Run]) -> Markup {
    let rows = html! {
        table.full.cards {
            thead { tr {
                th scope="col" { "method" } th scope="col" { "stiffness" } th scope="col" { "solver" } th.number scope="col" { "dt, s" } th.number scope="col" { "error" }
                th.number scope="col" { "time, s" } th.number scope="col" { "work" } th.number scope="col" { "solves" } th scope="col" { "status" }
            } }
            tbody {
                @for run in runs {
                    tr {
                        td { (run.method) @if let Some(rtol) = run.rtol { ", rtol " (pretty(rtol)) } }
                        td { (run.stiffness) } td { (run.solver) }
                        td.number data-of="dt, s" { (pretty(run.dt)) }
                        td.number data-of="error" { (run.error.map_or("—".into(), pretty)) }
                        td.number data-of="time, s" { (pretty(run.wall_seconds)) }
                        td.number data-of="work" { (pretty(run.cost.round())) }
                        td.number data-of="solves" { (run.work.solves) }
                        td { (run.status.name()) }
                    }
                }
            }
        }
    };
    page::scrolling("All runs", &rows)
}
