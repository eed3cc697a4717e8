//! `definiteness.html` and its table for the terminal: every answer to an indefinite matrix on one scene.

use super::number::{count, plain, pretty, typeset};
use super::page::{self, Column, Row};
use super::plot;
use crate::chart::definiteness::{Comparison, ITERATIONS, Solve, TOLERANCE};
use maud::html;
use std::fmt::Write;

fn cells(solve: &Solve, form: fn(f64) -> String) -> [String; 8] {
    let number = |count: Option<u64>| count.map_or("—".into(), |count| count.to_string());
    let ends = match (solve.negative, &solve.message) {
        (_, Some(message)) => message.clone(),
        (Some(0), None) => "minimum".into(),
        (negative, None) => format!("saddle, {}", count(negative.unwrap_or(0), "negative eigenvalue")),
    };
    [
        solve.stiffness.into(),
        solve.iterations.to_string(),
        solve.factorizations.to_string(),
        number(solve.refused),
        number(solve.changed_terms),
        solve.energy.map_or("—".into(), form),
        form(solve.wall_seconds),
        ends,
    ]
}

const COLUMNS: [(&str, Column); 8] = [
    ("stiffness", Column::Text),
    ("iterations", Column::Number),
    ("factorizations", Column::Number),
    ("refused", Column::Number),
    ("terms changed", Column::Number),
    ("energy, J", Column::Number),
    ("time, s", Column::Number),
    ("ends in", Column::Named),
];

fn problem(dt: Option<f64>, form: fn(f64) -> String) -> String {
    dt.map_or("Equilibrium".into(), |dt| format!("A step of {} s", form(dt)))
}

/// The comparison as text, a table and its conclusions.
pub fn definiteness_text(comparison: &Comparison) -> String {
    let mut text = format!("{}: {}\n", comparison.scene, count(comparison.solves.len(), "solve"));
    for solves in comparison.solves.chunk_by(|a, b| a.dt == b.dt) {
        let _ = writeln!(text, "  {}", problem(solves[0].dt, plain));
        let names = COLUMNS.map(|(name, _)| name.to_owned());
        for row in [names].into_iter().chain(solves.iter().map(|solve| cells(solve, plain))) {
            let [stiffness, numbers @ .., energy, time, ends] = &row;
            let numbers: String = numbers.iter().map(|number| format!(" {number:>14}")).collect();
            let _ = writeln!(text, "    {stiffness:<12}{numbers} {energy:>14} {time:>12}  {ends}");
        }
    }
    for sentence in comparison.conclusions() {
        let _ = writeln!(text, "  {sentence}");
    }
    text
}

/// The comparison as one page.
pub fn definiteness_html(comparison: &Comparison) -> String {
    let mut rows = Vec::new();
    for solves in comparison.solves.chunk_by(|a, b| a.dt == b.dt) {
        rows.push(Row::Heading(problem(solves[0].dt, pretty)));
        for solve in solves {
            let cells = cells(solve, pretty).map(|cell| html! { (typeset(&cell)) }).to_vec();
            rows.push(if solve.is_solved() { Row::Cells(cells) } else { Row::Failed(cells) });
        }
    }
    let profile = comparison.profile();
    let body = html! {
        div.banner.passed { strong { "Conclusion" } ul { @for sentence in comparison.conclusions() { li { (typeset(&sentence)) } } } }
        (page::section("solves", "Every solve", &html! {
            p {
                "A matrix is refused where a Cholesky factorization finds it indefinite. Terms changed are transverse ones, dropped or with the other sign, \
                 in all matrices together. The energy is the incremental potential of the step, or the potential energy of the equilibrium."
            }
            (page::table("Every solve", "full cards", &COLUMNS, rows))
        }))
        @if !profile.series.is_empty() {
            (page::section("profile", "Performance profile", &page::figures([page::figure(plot::svg(&profile), &html! {
                "The part of the problems that an answer solves with at most τ times the fewest factorizations (Dolan and Moré, 2002): higher is better."
            })])))
        }
    };
    let lead = format!(
        "Backward Euler steps and the equilibrium from one start, to a residual of {} of the forces within {ITERATIONS} iterations.",
        pretty(TOLERANCE)
    );
    page::page(&format!("Answers to indefinite matrices: {}", comparison.scene), &lead, &body)
}

#[cfg(test)]
mod tests {
    use super::{definiteness_html, definiteness_text};
    use crate::chart::Deadline;
    use crate::chart::definiteness::Comparison;
    use crate::integrate::StiffnessPolicy;
    use crate::interrupt::Interrupt;
    use crate::system::fixtures::row;
    use std::time::Duration;

    /// Text and page name every answer at every step, with the conclusions; the empty comparison says so.
    #[test]
    fn every_answer_is_named() {
        let (system, state) = row(4);
        let hours = Deadline::after(Duration::from_secs(7200), Interrupt::NEVER);
        let found = Comparison::measure("a row", &system, &state, 0.1, hours).unwrap();
        for written in [definiteness_text(&found), definiteness_html(&found)] {
            for policy in StiffnessPolicy::ALL {
                let times = written.matches(policy.name()).count();
                assert!(times >= 6, "{}: {times}", policy.name());
            }
            assert!(written.contains("Equilibrium") && written.contains("a row"));
        }
        let none = Comparison { scene: "none".into(), solves: Vec::new(), skipped: 36 };
        assert!(definiteness_text(&none).contains("No problem"));
        assert!(!definiteness_html(&none).contains("<svg"));
    }
}
