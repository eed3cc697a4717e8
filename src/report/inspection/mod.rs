//! An inspection of definiteness, for people and for programs.

mod html;
mod json;
mod text;

pub use html::pictures;
pub use text::first_answer;

use super::list;
use super::number::{count, plain};
use crate::inspect::{Culprit, DropSet, FirstLosses, Inspection, LargestStep, Minimality, Part, SkipReason, Turn};
use crate::integrate::Method;
use crate::spring::Stiffness;

/// An inspection of a scene's state, to be written as JSON, as text or as a page.
#[derive(Debug, Clone, Copy)]
pub struct InspectionReport<'a> {
    /// The name of the scene.
    pub scene: &'a str,
    /// Steps before the state.
    pub step: u64,
    /// Its time, in s.
    pub time: f64,
    /// The inspection.
    pub inspection: &'a Inspection,
    /// The losses of the run that led to the state.
    pub losses: Option<&'a FirstLosses>,
}

/// Writes a number for a terminal or for a page.
type Form = fn(f64) -> String;

const UNKNOWN: &str = "not looked at";

const KEPT: &str = "A was definite, the step stable, no spring was turned too far, and no energy came from nowhere";

/// The parts that were left out, by reason; empty where nothing was.
fn left_out(inspection: &Inspection) -> Vec<String> {
    let reasons = [
        (SkipReason::TooMuchWork, "for the work that it takes (--all looks at everything)"),
        (SkipReason::TooMuchMemory, "for the memory that a factor of A takes"),
        (SkipReason::Interrupted, "as the inspection was interrupted"),
    ];
    let sentence = |(why, because)| {
        let parts: Vec<String> = inspection.skipped_for(why).map(part).collect();
        (!parts.is_empty()).then(|| format!("{}: {because}", parts.join(", ")))
    };
    reasons.into_iter().filter_map(sentence).collect()
}

/// The estimated parts, and the proven bounds; `None` where all is proven.
fn estimated(inspection: &Inspection, form: Form) -> Option<String> {
    let parts: Vec<String> = inspection.estimated.iter().copied().map(part).collect();
    let proven = |name: &str, [low, high]: [f64; 2]| match (low.is_finite(), high.is_finite()) {
        (true, true) => format!("{} ≤ {name} ≤ {}", form(low), form(high)),
        (true, false) => format!("{} ≤ {name}", form(low)),
        (false, true) => format!("{name} ≤ {}", form(high)),
        (false, false) => format!("nothing of {name}"),
    };
    let [smallest, largest] = inspection.examined().within;
    let (smallest, largest) = (proven("λ_min", smallest), proven("λ_max", largest));
    let what = format!("{}: by products and multigrid; proven is {smallest} and {largest} N/m", parts.join(", "));
    (!parts.is_empty()).then_some(what)
}

fn part(part: Part) -> String {
    let under = |what: &str, option: Stiffness| format!("{what} under {}", option.name());
    match part {
        Part::FirstAnswer => "the first answer".into(),
        Part::Signs(option) => under("the signs of eigenvalues", option),
        Part::GrowingModes => "the growing modes".into(),
        Part::Turning(Stiffness::Axial) => under("the limit of turning", Stiffness::Axial),
        Part::Turning(_) => "the limit of turning under full, tension and absolute".into(),
        Part::Spectrum(option) => under("the ends of the spectrum", option),
        Part::Definite(option) => under("the limit of definiteness", option),
        Part::Stable(option) => under("the limit of stability", option),
        Part::SmallestSet => "the springs whose terms must go".into(),
        Part::Curve => "λ_min over the time step".into(),
    }
}

fn listed(numbers: &[usize], most: usize) -> String {
    let shown = list(numbers.iter().take(most), usize::to_string).join(", ");
    if numbers.len() > most { format!("{shown} and {} more", numbers.len() - most) } else { shown }
}

fn known(value: f64, form: Form) -> String {
    if value.is_nan() { "?".into() } else { form(value) }
}

fn limit(step: LargestStep, form: Form) -> String {
    match step {
        LargestStep::Every => "every step".into(),
        LargestStep::UpTo { dt, .. } => format!("{} s", form(dt)),
        LargestStep::Unknown => UNKNOWN.into(),
    }
}

fn scope() -> String {
    format!("at this state, linearised, for {}", Method::LinearBackwardEuler.name())
}

/// The methods whose limit of definiteness is another one: those whose matrix is that of a part of the step.
fn other_methods(inspection: &Inspection, form: Form) -> Option<String> {
    let others = Method::ALL.iter().filter(|method| method.is_implicit() && method.matrix_dt(1.0) != 1.0);
    let factor = |method: &Method| format!("{} under {}", form(1.0 / method.matrix_dt(1.0)), method.name());
    let factors = list(others, factor).join(", ");
    let has_limit = inspection.options.iter().any(|option| option.critical.dt().is_some());
    has_limit.then(|| format!("A stays definite for longer steps by a factor of {factors}"))
}

/// The spring that a step turns worst, how far and with which stretch; and the rotation that this removes.
fn turning(turn: &Turn, form: Form) -> [String; 2] {
    let percent = |part: f64| match 100.0 * part {
        all if (99.95..=100.0).contains(&all) => "100 %".into(),
        percent => format!("{} %", form(percent)),
    };
    let Turn { spring, particles: [i, j], angle, stretch, .. } = *turn;
    let (degrees, stretched, removed) = (form(angle.to_degrees()), percent(stretch), percent(turn.braked()));
    [
        format!("spring {spring} ({i}–{j}) by {degrees}°, which alone stretches it by {stretched}"),
        format!("in a turn by one radian its transverse stiffness removes {removed} of the rotation"),
    ]
}

fn smallness(set: &DropSet) -> String {
    let fewer = match set.at_least {
        _ if set.is_smallest() => return "are enough, and no fewer are".into(),
        1 => String::new(),
        at_least => format!("; no fewer than {at_least} are"),
    };
    match set.minimality {
        Minimality::Irredundant => format!("are enough, none can be spared{fewer}"),
        Minimality::Enough => format!("are enough, perhaps more than needed{fewer}"),
    }
}

/// The first losses of a run, in the order of its steps: a name, and where and how.
fn lost(losses: &FirstLosses, form: Form) -> Vec<(&'static str, String)> {
    let mut all: Vec<(u64, f64, &'static str, String)> = Vec::new();
    if let Some(loss) = &losses.definite {
        let worst = list(loss.culprits.iter().take(3), |culprit| culprit.spring.to_string()).join(", ");
        let springs = if worst.is_empty() { String::new() } else { format!("; worst springs {worst}") };
        let pivots = count(loss.negative, "negative pivot");
        all.push((loss.step, loss.time, "definite", format!("{pivots} under {}{springs}", loss.option.name())));
    }
    if let Some(at) = losses.stable {
        all.push((at.step, at.time, "stable", "the step is longer than the largest stable one".into()));
    }
    if let Some((at, turn)) = &losses.turning {
        all.push((at.step, at.time, "turning", format!("it turned {}", turning(turn, form)[0])));
    }
    if let Some((at, gain)) = losses.energy {
        let (gained, exchanged) = (form(gain.gained), form(gain.exchanged));
        let what = format!("{gained} J from nowhere, where the motion exchanged {exchanged} J");
        all.push((at.step, at.time, "energy", what));
    }
    // In one step the cause stands before what it leads to: the sort is stable.
    all.sort_by_key(|(step, ..)| *step);
    let sentence = |(step, time, name, what): (u64, f64, &'static str, String)| match step {
        0 => (name, format!("at the start: {what}")),
        _ => (name, format!("after {}, t = {} s: {what}", count(step as usize, "step"), form(time))),
    };
    all.into_iter().map(sentence).collect()
}

/// The springs to blame for an indefinite matrix that ended a run, the step up to which it would have been definite, and what would carry on.
///
/// `inspection` is that of the last good state under the run's option and for the dt of its matrix; `step` is the length of the step that
/// failed, in s, of which that dt is a fixed part. Where A was positive definite at that state nothing is known of a limit or a remedy.
pub fn explain(inspection: &Inspection, step: f64) -> (Vec<String>, Option<String>) {
    if inspection.examined().inertia.is_definite() {
        return (vec![blame(inspection)], None);
    }
    let limit = match inspection.examined().critical {
        LargestStep::Unknown => "how large a step would keep A positive definite was not looked for".into(),
        LargestStep::Every => "at this state A is positive definite for every dt".into(),
        LargestStep::UpTo { dt, .. } => {
            format!("at this state A is positive definite up to dt = {} s", plain(dt * step / inspection.dt))
        }
    };
    let limit = format!("{limit} (it was {} s)", plain(step));
    let drops = match &inspection.smallest_set {
        Some(set) if set.springs.len() < set.tension => {
            format!(" ({} of the {} transverse terms that tension drops are enough)", set.springs.len(), set.tension)
        }
        Some(_) | None => format!(" ({} compressed)", count(inspection.compressed_springs, "spring")),
    };
    let remedy = format!("--stiffness on-demand carries on{drops}; so does --stiffness tension or a smaller --dt");
    (vec![blame(inspection), limit], Some(remedy))
}

fn blame(inspection: &Inspection) -> String {
    let inertia = &inspection.examined().inertia;
    let culprits = inspection.directions.first().map_or(&[][..], |lowest| &lowest.culprits);
    if inertia.is_definite() || culprits.is_empty() {
        let compressed = count(inspection.compressed_springs, "spring");
        let cause = "that was lost on the way, or its smallest eigenvalues are rounding";
        return format!("A is positive definite at the start of the step, with {compressed} compressed: {cause}");
    }
    let name = |culprit: &Culprit| {
        let Culprit { spring, particles: [i, j], strain, share, .. } = culprit;
        format!("spring {spring} ({i}–{j}, {} % compressed, {:.0} % of it)", plain(-100.0 * strain), 100.0 * share)
    };
    let named = list(culprits.iter().take(3), name).join(", ");
    let more = match culprits.len().saturating_sub(3) {
        0 => String::new(),
        more => format!(" and {}", count(more, "other")),
    };
    let directions = count(inertia.negative, "direction");
    format!("A curves downwards in {directions}; along the worst because of {named}{more}")
}
