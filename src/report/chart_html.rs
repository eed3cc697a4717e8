//! `chart.html`: speed against accuracy, and the limits of stability, for people.

use super::number::{self, pretty, typeset};
use super::page::{self, Column, Row};
use super::{plot, tiles};
use crate::chart::stability::{StabilityMap, Varied};
use crate::chart::{Decision, Figure, Run, WorkPrecision};
use maud::{Markup, html};

/// The chart as one HTML page without scripts and without anything to load.
pub fn chart_html(chart: &WorkPrecision, map: &StabilityMap) -> String {
    let figures = chart.figures();
    let picture = |figure: &Figure| {
        let drawn = page::figure(plot::svg(&figure.plot), &text(typeset(&figure.caption)));
        let Some(full) = &figure.full else { return drawn };
        let all = format!("All {} curves", full.series.iter().filter(|series| series.like.is_none()).count());
        html! { div { (drawn) (page::folded(&all, &page::figure(plot::svg(full), &html! {}))) } }
    };
    let named = |names: &[&str]| {
        let chosen = figures.iter().filter(|figure| names.contains(&figure.name));
        page::figures(chosen.map(picture))
    };
    let body = html! {
        div.banner.passed {
            strong { "What to use" }
            ul { @for sentence in chart.recommendations() { li { (typeset(&sentence)) } } }
        }
        (page::section("methods", "The best option of each method", &methods(chart)))
        (page::section("speed", "Speed against accuracy", &html! {
            p {
                "Every point is one run of the whole motion. Of each method the stiffness option and solver that cost least over \
                 all accuracies are drawn; for one accuracy another may cost less. Work is counted in force evaluations of this scene: it is the same as often as a run is repeated, time is not."
            }
            (named(&["time", "work", "error"]))
        }))
        (page::section("options", "Stiffness options and solvers", &named(&["options-euler", "options-w2"])))
        (page::section("drift", "What methods add or take away", &named(&["energy", "angular-momentum"])))
        @if !map.tiles.is_empty() { (page::section("stability", "Where methods are stable", &stability(map))) }
        (page::section("runs", "All runs", &page::folded(&number::count(chart.runs.len(), "run"), &runs(&chart.runs))))
    };
    let lead = format!(
        "A motion of {} s; errors are measured against {}, whose own error is about {}.",
        chart.duration,
        chart.reference.method,
        pretty(chart.reference.error_estimate)
    );
    page::page(&format!("Speed against accuracy: {}", chart.scene), &lead, &body)
}

/// The option, solver and step of each method with the least work, for every accuracy that can be had.
fn methods(chart: &WorkPrecision) -> Markup {
    let decisions = chart.decisions();
    let (open, folded) = decisions.split_at(decisions.len().min(2));
    let limits = chart.longest_steps();
    html! {
        p {
            "Only steps from which on every shorter one of the same method, option and solver succeeded and erred less: what a longer step \
             did by luck is not advice. The least work, in force evaluations, stands first."
        }
        @if decisions.is_empty() && !chart.excluded.is_empty() {
            p { "No method has such steps that hold to the end of the whole scene too." }
        } @else if decisions.is_empty() {
            p { "No method has such steps with an error below 10 %: give the chart more time, or a shorter motion." }
        } @else {
            (best("The best option of each method for the larger errors", open))
        }
        @if !folded.is_empty() {
            (page::folded("For smaller errors", &best("The best option of each method for the smaller errors", folded)))
        }
        (page::folded("How long the steps of each may be", &html! {
            table { tbody { @for (name, limit) in limits { tr { td { (name) } td { (typeset(&limit)) } } } } }
        }))
    }
}

fn text(value: impl AsRef<str>) -> Markup {
    html! { (value.as_ref()) }
}

const COLUMNS: [(&str, Column); 7] = [
    ("method", Column::Text),
    ("stiffness", Column::Text),
    ("solver", Column::Text),
    ("steps", Column::Text),
    ("work", Column::Number),
    ("time, s", Column::Number),
    ("error", Column::Number),
];

fn cells(run: &Run) -> [Markup; 7] {
    [
        text(run.variant()),
        text(run.stiffness),
        text(run.solver),
        text(typeset(&run.step_control())),
        text(pretty(run.cost.round())),
        text(pretty(run.wall_seconds)),
        text(run.error.map_or("—".into(), pretty)),
    ]
}

fn best(name: &str, decisions: &[Decision<'_>]) -> Markup {
    let mut rows = Vec::new();
    for decision in decisions {
        rows.push(Row::Heading(format!("For an error below {} %:", decision.percent())));
        rows.extend(decision.methods.iter().map(|run| Row::Cells(cells(run).to_vec())));
    }
    page::table(name, "full cards", &COLUMNS, rows)
}

fn stability(map: &StabilityMap) -> Markup {
    let (predicted, contradictions) = map.agreement();
    let of = |axis| {
        let tiles = map.tiles.iter().filter(|tile| tile.axis == axis).map(|tile| {
            let caption = match tile.limits.iter().all(Vec::is_empty) {
                true => "No limit in closed form crosses this picture.",
                false => "Lines: limits in closed form.",
            };
            page::figure(tiles::svg(&tile.figure()), &text(caption))
        });
        page::figures(tiles)
    };
    html! {
        p {
            "One particle between two springs to fixed walls, moved a thousandth of its spring's length off the middle. ω is the \
             frequency of its vibration along the springs. A cell is one run of up to 2000 steps, coloured by what failed first; \
             the lines are limits that theory gives. Above λ = 1 the springs are stretched and the particle swings across them \
             with the frequency ω √(1 − 1/λ); below they are compressed and it buckles."
        }
        p.quiet { "Of " (predicted) " cells about which theory says something, " (contradictions) " contradict it." }
        h3 { "Over the stretch, without damping" }
        (of(Varied::Stretch))
        h3 { "Over damping, with springs of twice their rest length" }
        p { "The dampers act along the springs only: they do nothing for the motion across." }
        (of(Varied::Damping))
        h3 { "Over turning: what no linear model shows" }
        p {
            "One particle that circles a fixed point on a spring; θ is the angle by which a step turns it. After a turn by one radian \
             a run has failed that has lost more than a tenth of its angular momentum, which the exact motion keeps, or stretched the \
             spring by one per cent more than the exact motion does. A method that linearises at the start of its step takes \
             the stretch that comes from stepping straight on for real, and brakes the turning by it."
        }
        (of(Varied::Turning))
    }
}

fn runs(runs: &[Run]) -> Markup {
    let columns = [&COLUMNS[..], &[("solves", Column::Number), ("status", Column::Text)]].concat();
    let rows = runs.iter().map(|run| {
        let [solves, status] = [html! { (run.work.solves) }, text(run.status.name())];
        Row::Cells(cells(run).into_iter().chain([solves, status]).collect())
    });
    page::table("All runs", "full cards", &columns, rows)
}

#[cfg(test)]
mod tests {
    use super::methods;
    use crate::chart::{Reference, WorkPrecision};
    use crate::system::State;

    /// More time for the chart does not help where runs are left out because they do not hold to the end.
    #[test]
    fn the_reason_for_no_advice_is_that_of_the_conclusion() {
        let said = |excluded: Vec<usize>| {
            let state = State { time: 1.0, positions: Vec::new(), velocities: Vec::new() };
            let reference = Reference { method: "none".into(), error_estimate: 0.0, state };
            let (scene, runs) = (String::new(), Vec::new());
            methods(&WorkPrecision { scene, duration: 1.0, reference, runs, excluded }).into_string()
        };
        let [nothing, excluded] = [said(Vec::new()), said(vec![0])];
        assert!(nothing.contains("give the chart more time") && !nothing.contains("whole scene"), "{nothing}");
        assert!(excluded.contains("whole scene") && !excluded.contains("give the chart more time"), "{excluded}");
    }
}
