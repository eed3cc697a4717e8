//! The cause of an indefinite matrix that ended a run, in up to three lines.

use crate::inspect::{Culprit, Inspection, LargestStep};
use crate::report::number::{count, plain};

/// Culprits that are named.
const NAMED: usize = 3;

/// Which springs, how large a step would have been definite, and what would carry on. `inspection` is that of the last good
/// state under the run's option and for the dt of its matrix; `step` is the length of the step that failed, in s, of which that
/// dt is a fixed part. Where A was positive definite at that state nothing is known of a limit or a remedy.
pub fn explain(inspection: &Inspection, step: f64) -> (Vec<String>, Option<String>) {
    if inspection.examined().inertia.is_definite() {
        return (vec![blame(inspection)], None);
    }
    (vec![blame(inspection), limit(inspection, step)], Some(remedy(inspection)))
}

fn blame(inspection: &Inspection) -> String {
    let inertia = &inspection.examined().inertia;
    let culprits = inspection.directions.first().map_or(&[][..], |lowest| &lowest.culprits);
    if inertia.is_definite() || culprits.is_empty() {
        return format!(
            "A is positive definite at the start of the step, with {} compressed: that was lost on the way, or its smallest eigenvalues are rounding",
            count(inspection.compressed_springs, "spring")
        );
    }
    let name = |culprit: &Culprit| {
        let Culprit { spring, particles: [i, j], strain, share, .. } = culprit;
        format!("spring {spring} ({i}–{j}, {} % compressed, {:.0} % of it)", plain(-100.0 * strain), 100.0 * share)
    };
    let named: Vec<String> = culprits.iter().take(NAMED).map(name).collect();
    let more = match culprits.len() - named.len() {
        0 => String::new(),
        more => format!(" and {}", count(more, "other")),
    };
    let directions = count(inertia.negative, "direction");
    format!("A curves downwards in {directions}; along the worst because of {}{more}", named.join(", "))
}

fn limit(inspection: &Inspection, step: f64) -> String {
    let dt = plain(step);
    match inspection.examined().critical {
        LargestStep::Unknown => {
            format!("how large a step would keep A positive definite was not looked for (it was {dt} s)")
        }
        LargestStep::Every => format!("at this state A is positive definite for every dt (it was {dt} s)"),
        LargestStep::UpTo { dt: critical, .. } => {
            format!(
                "at this state A is positive definite up to dt = {} s (it was {dt} s)",
                plain(critical * step / inspection.dt)
            )
        }
    }
}

fn remedy(inspection: &Inspection) -> String {
    let Inspection { smallest_set, compressed_springs, .. } = inspection;
    let drops = match smallest_set {
        Some(set) if set.springs.len() < set.tension => {
            format!(" ({} of the {} transverse terms that tension drops are enough)", set.springs.len(), set.tension)
        }
        Some(_) | None => format!(" ({} compressed)", count(*compressed_springs, "spring")),
    };
    format!("--stiffness on-demand carries on{drops}; so does --stiffness tension or a smaller --dt")
}
