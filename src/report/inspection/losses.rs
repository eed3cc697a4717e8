//! What turns and what was lost, in words that the terminal and the page share.

use crate::inspect::{
    DropSet, FirstLosses, Gain, Inspection, LargestStep, Loss, Minimality, Part, Passed, SkipReason, Turn,
};
use crate::integrate::Method;
use crate::report::number::count;
use crate::spring::Stiffness;

/// How numbers are written: for a terminal or for a page.
pub(super) type Form = fn(f64) -> String;

/// In the place of what was not looked at.
pub(super) const UNKNOWN: &str = "not looked at";

/// What was left out, by why; empty where nothing was.
pub(super) fn left_out(inspection: &Inspection) -> Vec<String> {
    let told = [
        (SkipReason::TooMuchWork, "for the work that it takes (--all looks at everything)"),
        (SkipReason::TooMuchMemory, "for the memory that a factor of A takes"),
        (SkipReason::Interrupted, "as the inspection was interrupted"),
    ];
    let sentence = |(why, because): (SkipReason, &str)| {
        let parts: Vec<String> = inspection.skipped_for(why).map(part).collect();
        (!parts.is_empty()).then(|| format!("{}: {because}", parts.join(", ")))
    };
    told.into_iter().filter_map(sentence).collect()
}

/// What is estimated, and what is proven of it all the same; `None` where all is proven.
pub(super) fn estimated(inspection: &Inspection, form: Form) -> Option<String> {
    let parts: Vec<String> = inspection.estimated.iter().copied().map(part).collect();
    let [smallest, largest] = inspection.examined().within;
    let proven = |name: &str, [low, high]: [f64; 2]| match (low.is_finite(), high.is_finite()) {
        (true, true) => format!("{} ≤ {name} ≤ {}", form(low), form(high)),
        (true, false) => format!("{} ≤ {name}", form(low)),
        (false, true) => format!("{name} ≤ {}", form(high)),
        (false, false) => format!("nothing of {name}"),
    };
    let (smallest, largest) = (proven("λ_min", smallest), proven("λ_max", largest));
    let what = format!("{}: by products and multigrid; proven is {smallest} and {largest} N/m", parts.join(", "));
    (!parts.is_empty()).then_some(what)
}

/// A part of an inspection by name.
pub(super) fn part(part: Part) -> String {
    let under = |what: &str, option: Stiffness| format!("{what} under {}", option.name());
    match part {
        Part::FirstAnswer => "the first answer".into(),
        Part::Signs(option) => under("the signs of eigenvalues", option),
        Part::GrowingModes => "the growing modes".into(),
        Part::Turning(Stiffness::Axial) => under("the limit of turning", Stiffness::Axial),
        Part::Turning(_) => "the limit of turning under full and tension".into(),
        Part::Spectrum(option) => under("the ends of the spectrum", option),
        Part::Definite(option) => under("the limit of definiteness", option),
        Part::Stable(option) => under("the limit of stability", option),
        Part::SmallestSet => "the springs whose terms must go".into(),
        Part::Curve => "λ_min over the time step".into(),
    }
}

/// A number that may not be known.
pub(super) fn known(value: f64, form: Form) -> String {
    if value.is_nan() { "?".into() } else { form(value) }
}

/// A limit of the step.
pub(super) fn limit(step: LargestStep, form: Form) -> String {
    match step {
        LargestStep::Every => "every step".into(),
        LargestStep::UpTo { dt, .. } => format!("{} s", form(dt)),
        LargestStep::Unknown => UNKNOWN.into(),
    }
}

/// What the limits are limits of.
pub(super) fn scope() -> String {
    format!("at this state, linearised, for {}", Method::LinearBackwardEuler.name())
}

/// For which methods the limit of definiteness is another one: those whose matrix is that of a part of the step.
pub(super) fn other_methods(inspection: &Inspection, form: Form) -> Option<String> {
    let limits = inspection.options.iter().filter_map(|option| option.critical.dt());
    let others = Method::ALL.iter().filter(|method| method.is_implicit() && method.matrix_dt(1.0) != 1.0);
    let factors: Vec<String> =
        others.map(|method| format!("{} under {}", form(1.0 / method.matrix_dt(1.0)), method.name())).collect();
    (limits.count() > 0).then(|| format!("A stays definite for longer steps by a factor of {}", factors.join(", ")))
}

/// What a step does to the spring that it turns worst: how far and by how much that stretches it, and what comes of it.
pub(super) fn turning(turn: &Turn, form: Form) -> [String; 2] {
    let Turn { spring, particles: [i, j], angle, stretch, .. } = *turn;
    let (degrees, stretched) = (form(angle.to_degrees()), percent(stretch, form));
    let what = format!("spring {spring} ({i}–{j}) by {degrees}°, which alone stretches it by {stretched}");
    [
        what,
        format!(
            "in a turn by one radian its stiffness across takes {} of the turning away",
            percent(turn.braked(), form)
        ),
    ]
}

/// A part in per cent.
fn percent(part: f64, form: Form) -> String {
    match 100.0 * part {
        all if (99.95..=100.0).contains(&all) => "100 %".into(),
        percent => format!("{} %", form(percent)),
    }
}

/// How small a set of terms to drop is, and how small it could be.
pub(super) fn smallness(set: &DropSet) -> String {
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

/// What a run that lost nothing kept.
pub(super) const KEPT: &str =
    "A was definite, the step stable, no spring was turned too far, and no energy came from nowhere";

/// What a run lost first, in the order of its steps: what it is, and where and how.
pub(super) fn lost(losses: &FirstLosses, form: Form) -> Vec<(&'static str, String)> {
    let after = |step: u64, time: f64| match step {
        0 => "at the start".to_owned(),
        _ => format!("after {}, t = {} s", count(step as usize, "step"), form(time)),
    };
    let mut all: Vec<(u64, &'static str, String)> = Vec::new();
    if let Some(Loss { step, time, option, culprits, negative, .. }) = &losses.definite {
        let worst: Vec<String> = culprits.iter().take(3).map(|c| c.spring.to_string()).collect();
        let springs = if worst.is_empty() { String::new() } else { format!("; worst springs {}", worst.join(", ")) };
        let directions = count(*negative, "negative pivot");
        all.push((
            *step,
            "definite",
            format!("{}: {directions} under {}{springs}", after(*step, *time), option.name()),
        ));
    }
    if let Some(Passed { step, time }) = losses.stable {
        all.push((step, "stable", format!("{}: the step is longer than the largest stable one", after(step, time))));
    }
    if let Some((Passed { step, time }, turn)) = &losses.turning {
        let [what, _] = turning(turn, form);
        all.push((*step, "turning", format!("{}: it turned {what}", after(*step, *time))));
    }
    if let Some((Passed { step, time }, Gain { gained, exchanged })) = losses.energy {
        let (gained, exchanged) = (form(gained), form(exchanged));
        let what = format!("{}: {gained} J from nowhere, where the motion exchanged {exchanged} J", after(step, time));
        all.push((step, "energy", what));
    }
    // What came first first; of one step the cause before what it leads to.
    all.sort_by_key(|(step, ..)| *step);
    all.into_iter().map(|(_, name, what)| (name, what)).collect()
}
