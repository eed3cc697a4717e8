//! An inspection as a page with pictures.

use super::{
    InspectionReport, KEPT, estimated, known, left_out, limit, listed, lost, other_methods, scope, smallness, turning,
};
use crate::inspect::{
    Culprit, FirstLosses, Inertia, InertiaMethod, Inspection, LargestStep, OptionInspection, Part, Pictures,
};
use crate::report::number::{count, pretty, typeset};
use crate::report::page::{self, Column, Row};
use crate::report::{drawing, plot, spy};
use maud::{Markup, html};

/// Rows of the tables of culprits and of clusters.
const ROWS: usize = 15;

/// The pictures as SVG, each with the name of its file.
pub fn pictures(pictures: &Pictures) -> Vec<(&'static str, String)> {
    let mut files = vec![("scene.svg", drawing::svg(&pictures.scene))];
    files.extend(pictures.curve.as_ref().map(|curve| ("lambda-min.svg", plot::svg(curve))));
    files.push(("spectrum.svg", plot::svg(&pictures.spectrum)));
    if let Some([matrix, factor]) = &pictures.patterns {
        files.push(("pattern-A.svg", spy::svg(matrix)));
        files.push(("pattern-L.svg", spy::svg(factor)));
    }
    files
}

impl InspectionReport<'_> {
    /// One HTML page without scripts and without anything to load.
    pub fn html(&self, pictures: &Pictures) -> String {
        let &Self { scene, step, time, inspection, losses } = self;
        let when = match (step, time) {
            (0, 0.0) => "at the initial state".into(),
            (0, _) => format!("at t = {} s", pretty(time)),
            _ => format!("after {step} steps, t = {} s", pretty(time)),
        };
        let (dt, stiffness) = (pretty(inspection.dt), inspection.option.name());
        let lead = format!("A = M/dt² − G/dt − K {when}, with dt = {dt} s and stiffness {stiffness}.");
        let body = html! {
            (banner(inspection))
            (page::section("steps", "Which steps are safe", &steps(inspection, losses, pictures)))
            (page::section("culprits", heading(inspection), &culprits(inspection, pictures)))
            (page::section("matrix", "The matrix", &matrix(inspection, pictures)))
        };
        page::page(&format!("Definiteness of {scene}"), &lead, &body)
    }
}

fn banner(inspection: &Inspection) -> Markup {
    const PROOF: &str = "A direction of negative curvature proves it; the signs of the eigenvalues were not counted.";
    const DOUBT: &str = "No direction of negative curvature was found, which is no proof.";
    let inertia = &inspection.examined().inertia;
    let certainty = match inertia.proven {
        true => "A bound of all rounding errors proves the signs that were counted.",
        false => "The counts hold up to rounding, which was measured and not bounded.",
    };
    let OptionInspection { smallest, largest, .. } = inspection.examined();
    let [from, to] = [smallest, largest].map(|value| known(*value, pretty));
    let Inertia { negative, zero, positive, .. } = inertia;
    let signs = format!("{negative} negative, {zero} zero and {positive} positive eigenvalues");
    let counts = typeset(&format!("{signs}, from {from} to {to} N/m. {certainty}"));
    let (class, title, text) = if inertia.negative + inertia.zero + inertia.positive == 0 {
        ("banner", "No coordinate is free", "A has no rows, and there is nothing to inspect.".into())
    } else if inspection.lacks(Part::Signs(inspection.option)) {
        match &inspection.first {
            Some(first) if !first.definite => ("banner failed", "✗ A is indefinite", PROOF.into()),
            Some(_) => ("banner", "A is positive definite as far as is seen", DOUBT.into()),
            None => ("banner", "Interrupted", "Nothing is known of A.".into()),
        }
    } else {
        match (inertia.is_definite(), inertia.negative) {
            (true, _) => ("banner passed", "✓ A is positive definite", counts),
            (false, 0) => ("banner failed", "✗ A is singular to working precision", counts),
            (false, _) => ("banner failed", "✗ A is indefinite", counts),
        }
    };
    html! { div class=(class) { strong { (title) } p { (text) } } }
}

fn steps(inspection: &Inspection, losses: Option<&FirstLosses>, pictures: &Pictures) -> Markup {
    use Column::{Number, Text};
    let columns = [
        ("stiffness", Text),
        ("definite up to", Number),
        ("stable up to", Number),
        ("turning up to", Number),
        ("λ_min, N/m", Number),
        ("λ_max, N/m", Number),
        ("condition", Number),
    ];
    let row = |option: &OptionInspection| {
        let limits = [option.critical, option.stable, option.turning].map(|step| limit(step, pretty));
        let numbers = [option.smallest, option.largest, option.condition].map(|value| known(value, pretty));
        let cells = [option.option.name().to_owned()].into_iter().chain(limits).chain(numbers);
        let cells = cells.map(|cell| html! { (cell) }).collect();
        if option.inertia.is_definite() { Row::Cells(cells) } else { Row::Failed(cells) }
    };
    let name = "Limits of the time step under each stiffness option";
    let table = page::table(name, "full limits", &columns, inspection.options.iter().map(row));
    html! {
        @if let Some(what) = estimated(inspection, pretty) { p.warning { "Estimated: " (typeset(&what)) "." } }
        @for what in left_out(inspection) { p.warning { "Left out: " (what) "." } }
        p { "These limits hold " (scope()) ": after every step there are others." }
        (table)
        @if let Some(turn) = inspection.turn.as_ref().filter(|turn| turn.excess() > 1.0) {
            @let [what, then] = turning(turn, pretty);
            p.warning {
                "The step turns " (typeset(&what)) "; " (typeset(&then)) ". Such a run does not break down, its motion is wrong."
            }
        }
        @if let Some(losses) = losses { (followed(losses)) }
        dl.reading {
            dt { "definite up to" } dd {
                "A is positive definite. The limit lies between a step at which a Cholesky factorization exists and one at which it does not, \
                 or a direction of negative curvature is known."
                @if let Some(others) = other_methods(inspection, pretty) { " " (others) "." }
            }
            dt { "stable up to" } dd { "linearised backward Euler adds no instability of its own" }
            dt { "turning up to" } dd {
                "every spring keeps nine tenths of its turning while it turns by one radian, and no step stretches one by more than 1 % by turning it. \
                 A step moves the ends of a spring straight on, by dt |v" sub { "⊥" } "|/l across it; that makes it longer, and its new tension then \
                 brakes the turning, unless " code { "axial" } " leaves this out. No eigenvalue shows it."
            }
        }
        @if inspection.growing_modes > 0 {
            p.quiet { "The motion itself has " (count(inspection.growing_modes, "growing mode")) " here: no step makes these stable." }
        }
        @let low_end = page::figure(plot::svg(&pictures.spectrum), &html! { "Eigenvalues below zero are directions in which A curves downwards." });
        @let curve = pictures.curve.as_ref().map(|curve| page::figure(plot::svg(curve), &html! { (typeset(&curves(inspection))) }));
        (page::figures(curve.into_iter().chain([low_end])))
    }
}

fn curves(inspection: &Inspection) -> String {
    let known = inspection.options.iter().filter(|option| option.critical != LargestStep::Unknown);
    let sentences = known.map(|option| match (option.option.name(), option.critical.dt()) {
        (name, Some(dt)) => format!("under {name} it crosses zero at {} s and does not come back", pretty(dt)),
        (name, None) => format!("under {name} it stays above zero however long the step"),
    });
    let sentences = sentences.collect::<Vec<_>>().join("; ");
    format!("The lowest eigenvalue in units of m/dt², drawn no further than −1 and 3: {sentences}.")
}

fn heading(inspection: &Inspection) -> &'static str {
    match inspection.directions.first() {
        Some(lowest) if lowest.culprits.is_empty() => "No spring spoils it",
        Some(lowest) if lowest.eigenvalue < 0.0 => "Which springs spoil it",
        Some(_) => "Which springs soften it",
        None => "Springs",
    }
}

fn arrows(inspection: &Inspection) -> String {
    let what = "the direction in which A curves least, to a scale of their own";
    match inspection.fold() {
        _ if inspection.multiplicity() == 0 => "Nothing can move.".into(),
        None => format!("Arrows: {what}."),
        Some(fold) => format!(
            "Arrows: {what}; its eigenvalue is {fold} (to a thousandth), so this is one of many such directions: any mixture of the \
             eigenvectors is as good, and the shares of springs are those along this one."
        ),
    }
}

fn followed(losses: &FirstLosses) -> Markup {
    let lost = lost(losses, pretty);
    html! {
        @if lost.is_empty() {
            p { "On the way to this state " (KEPT) "." }
        } @else {
            p { "On the way to this state were first lost:" }
            ul { @for (what, how) in lost { li { b { (what) } " " (typeset(&how)) } } }
        }
    }
}

fn culprits(inspection: &Inspection, pictures: &Pictures) -> Markup {
    let lowest = inspection.directions.first();
    let named = lowest.map_or(&[][..], |lowest| &lowest.culprits);
    let compressed = match inspection.compressed_springs {
        0 => "No spring is".into(),
        1 => "1 spring is".into(),
        several => format!("{several} springs are"),
    };
    html! {
        p {
            @match lowest {
                Some(lowest) if lowest.culprits.is_empty() => { "Along the direction in which A curves least no spring has negative curvature. " }
                Some(lowest) if lowest.eigenvalue >= 0.0 => { "A is positive definite at this step; these springs take most from the curvature along the direction in which it is least. " }
                _ => {}
            }
            (compressed) " shorter than at rest."
        }
        @if !named.is_empty() { (table(named)) }
        @if let Some(set) = &inspection.smallest_set {
            p {
                "To make A definite, the transverse terms of " (count(set.springs.len(), "spring")) " " (smallness(set))
                "; option " code { "tension" } " drops " (set.tension) ": " (listed(&set.springs, ROWS)) "."
            }
        }
        @if inspection.clusters.len() > 1 {
            p { "Culprits that hang together, the worst group first:" }
            ul { @for cluster in inspection.clusters.iter().take(ROWS) {
                li {
                    (count(cluster.springs.len(), "spring")) " on " (count(cluster.particles.len(), "particle")) ", strain down to " (pretty(cluster.strain)) ": springs " (listed(&cluster.springs, ROWS))
                }
            } }
        }
        div.single { (page::figure(drawing::svg(&pictures.scene), &html! { (arrows(inspection)) })) }
    }
}

fn table(culprits: &[Culprit]) -> Markup {
    use Column::{Number, Text};
    let columns =
        [("spring", Text), ("particles", Text), ("strain", Number), ("share", Number), ("without it, N/m", Number)];
    let row = |culprit: &Culprit| {
        let numbers = [culprit.strain, culprit.share, culprit.relieved].map(pretty);
        let [i, j] = culprit.particles;
        let cells = [culprit.spring.to_string(), format!("{i}–{j}")].into_iter().chain(numbers);
        Row::Cells(cells.map(|cell| html! { (cell) }).collect())
    };
    html! {
        (page::table("Springs with negative curvature, worst first", "full tight", &columns, culprits.iter().take(ROWS).map(row)))
        p.quiet {
            @if culprits.len() > ROWS { "And " (culprits.len() - ROWS) " more. " }
            "share: of the negative curvature uᵀ(−K)u along the arrows u; above 1 where other springs resist. without it: what uᵀAu \
             would be without the transverse term of this spring alone; above zero that is enough."
        }
    }
}

fn matrix(inspection: &Inspection, pictures: &Pictures) -> Markup {
    let inertia = &inspection.examined().inertia;
    html! {
        @if inertia.method == InertiaMethod::Springs {
            p.quiet {
                "No spring has negative curvature, so every eigenvalue is at least the smallest mass over dt²: nothing had to be factored to count signs."
            }
        } @else {
            p.quiet {
            "Signs of eigenvalues are counted from a factorization whose error was measured, at most "
            (pretty(inertia.factorization_error)) " of the norm; eigenvalues within " (pretty(inertia.band)) " of the norm of the equilibrated matrix would count as zero."
            }
        }
        @if let Some([matrix, factor]) = &pictures.patterns {
            (page::figures([
                page::figure(spy::svg(matrix), &html! { "Entries of A that are not zero." }),
                page::figure(spy::svg(factor), &html! { "Stored entries of its factor." }),
            ]))
        }
    }
}
