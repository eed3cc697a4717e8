//! An inspection for the terminal.

use super::{
    InspectionReport, KEPT, UNKNOWN, estimated, known, left_out, limit, listed, lost, other_methods, scope, smallness,
    turning,
};
use crate::inspect::{Cluster, Culprit, Direction, Inertia, Inspection, Part};
use crate::report::list;
use crate::report::number::{compact, count, plain};

/// Culprits, directions, clusters and springs of a set that are listed.
const LISTED: usize = 6;

impl InspectionReport<'_> {
    /// Everything that matters, a screen long.
    pub fn text(&self) -> String {
        let &Self { scene, step, time, inspection, losses } = self;
        let Inspection { dt, option, .. } = inspection;
        let examined = inspection.examined();
        let inertia = &examined.inertia;
        let verdict = match (inertia.negative, inertia.zero) {
            _ if inspection.lacks(Part::Signs(*option)) => match &inspection.first {
                Some(first) if !first.definite => "INDEFINITE",
                Some(_) => "positive definite as far as is seen",
                None => UNKNOWN,
            },
            (0, 0) => "positive definite",
            (0, _) => "singular to working precision",
            _ => "INDEFINITE",
        };
        let at = match (step, time) {
            (0, 0.0) => " at this state".into(),
            (0, _) => format!(" at this state, t = {} s", plain(time)),
            _ => format!(" after {}, t = {} s", count(step as usize, "step"), plain(time)),
        };
        if inertia.negative + inertia.zero + inertia.positive == 0 {
            return format!("{scene}{at}: no coordinate is free, so A has no rows, and there is nothing to inspect");
        }
        let (name, dt) = (option.name(), compact(*dt));
        let mut lines = vec![format!("{scene}{at}: A is {verdict} (stiffness {name}, dt = {dt} s)")];
        let is_counted = !inspection.lacks(Part::Signs(*option));
        let certainty = if inertia.proven { "proven" } else { "to rounding" };
        let Inertia { negative, zero, positive, .. } = inertia;
        let signs = match is_counted {
            false => "signs not counted".to_owned(),
            true => format!("{negative} negative, {zero} zero, {positive} positive ({certainty})"),
        };
        let [from, to, condition] =
            [examined.smallest, examined.largest, examined.condition].map(|value| known(value, plain));
        lines.push(format!("  eigenvalues  {signs}; from {from} to {to} N/m, condition {condition}"));
        if is_counted && inertia.negative == 0 && inertia.zero > 0 {
            lines.push("  singular     sprung mechanisms names the motions that stretch no spring".into());
        }
        lines.push(format!("  limits       {}; a run leaves it, --steps N follows one", scope()));
        lines.push(format!(
            "  {:<12} {:<20} {:<20} {:<16} {}",
            "stiffness", "definite up to", "stable up to", "turning up to", "λ_min at this dt"
        ));
        for each in &inspection.options {
            let (name, smallest) = (each.option.name(), known(each.smallest, plain));
            // With the digits that a script may want.
            let [critical, stable] = [each.critical, each.stable].map(|step| limit(step, |dt| format!("{dt:.9e}")));
            let turning = limit(each.turning, plain);
            lines.push(format!("  {name:<12} {critical:<20} {stable:<20} {turning:<16} {smallest} N/m"));
        }
        lines.extend(other_methods(inspection, plain).map(|others| format!("  methods      {others}")));
        lines.extend(turned(inspection));
        let changed = match inspection.compressed_springs {
            0 => "",
            _ => ", whose transverse terms tension drops and absolute takes with the other sign",
        };
        lines.push(format!("  compressed   {}{changed}", count(inspection.compressed_springs, "spring")));
        if inspection.growing_modes > 0 {
            let modes = count(inspection.growing_modes, "mode");
            lines.push(format!(
                "  growing      {modes} of the motion itself, whatever the step: the state is not stable"
            ));
        }
        if let Some(lowest) = inspection.directions.first().filter(|lowest| !lowest.culprits.is_empty()) {
            lines.extend(culprits(lowest));
            if let Some(fold) = inspection.fold() {
                lines.push(format!("    λ_min is {fold}, to a thousandth: u is one of many such directions"));
            }
        }
        let negative: Vec<&Direction> = inspection.directions.iter().filter(|d| d.eigenvalue < 0.0).collect();
        if negative.len() > 1 {
            let all = if is_counted { inertia.negative.to_string() } else { format!("at least {}", negative.len()) };
            lines.push(format!("  directions   {} of {all} examined:", negative.len()));
            for direction in negative.iter().take(LISTED) {
                let worst = list(direction.culprits.iter().take(3), |culprit| culprit.spring.to_string()).join(", ");
                let moving = list(direction.movers.iter().take(3), |mover| mover.particle.to_string()).join(", ");
                let value = plain(direction.eigenvalue);
                lines.push(format!("    λ = {value} N/m: springs {worst}; moves particles {moving}"));
            }
            lines.extend(more(negative.len()));
        }
        if !inspection.clusters.is_empty() {
            lines.push(format!("  clusters     {}:", count(inspection.clusters.len(), "group of culprits")));
            for Cluster { springs, particles, strain, .. } in inspection.clusters.iter().take(LISTED) {
                let [all, on] = [count(springs.len(), "spring"), count(particles.len(), "particle")];
                let (strain, names) = (plain(*strain), listed(springs, LISTED));
                lines.push(format!("    {all} on {on}, strain down to {strain}: {names}"));
            }
            lines.extend(more(inspection.clusters.len()));
        }
        if let Some(set) = &inspection.smallest_set {
            let (terms, how) = (count(set.springs.len(), "transverse term"), smallness(set));
            let (all, names) = (set.tension, listed(&set.springs, LISTED));
            lines.push(format!("  drop         {terms} {how} (tension drops {all}): {names}"));
        }
        lines.extend(estimated(inspection, plain).map(|what| format!("  estimated    {what}")));
        lines.extend(left_out(inspection).into_iter().map(|what| format!("  left out     {what}")));
        if let Some(losses) = losses {
            let lost = lost(losses, plain);
            if lost.is_empty() {
                lines.push(format!("  kept         on the way {KEPT}"));
            }
            for (k, (what, how)) in lost.iter().enumerate() {
                let heading = if k == 0 { "first lost" } else { "" };
                lines.push(format!("  {heading:<12} {what:<9} {how}"));
            }
        }
        lines.join("\n")
    }
}

/// The first answer in a line, for those who wait for the others; `None` before it is known.
pub fn first_answer(inspection: &Inspection) -> Option<String> {
    let Inspection { dt, option, first, .. } = inspection;
    let first = first.as_ref()?;
    let curvature = plain(first.direction.eigenvalue);
    let certainty = match first.is_proven {
        false => " as far as is seen, which is no proof",
        true if inspection.estimated.is_empty() => ", as a factorization proves",
        true => ", as springs and masses prove",
    };
    let what = match first.definite {
        true => format!("positive definite{certainty}; λ_min is {curvature} N/m or less"),
        false => format!("INDEFINITE, as a direction u with uᵀAu = {curvature} N/m proves"),
    };
    let worst = first.worst().map(|Culprit { spring, particles: [i, j], strain, share, .. }| {
        let (strain, share) = (plain(*strain), plain(*share));
        format!("; most of it by spring {spring} ({i}–{j}): strain {strain}, share about {share}")
    });
    Some(format!("A is {what} (stiffness {}, dt = {} s){}", option.name(), compact(*dt), worst.unwrap_or_default()))
}

fn turned(inspection: &Inspection) -> Vec<String> {
    let Some(turn) = &inspection.turn else { return Vec::new() };
    let [what, then] = turning(turn, plain);
    if turn.excess() <= 1.0 {
        return vec![format!("  turning      within the limits: worst {what}")];
    }
    vec![
        format!("  turning      TOO FAR: the step turns {what};"),
        format!("               {then}."),
        "               The run does not fail, but its motion is wrong".into(),
    ]
}

fn culprits(lowest: &Direction) -> Vec<String> {
    let negative = lowest.eigenvalue < 0.0;
    let heading = if negative { "culprits     along" } else { "softened by  along" };
    let mut lines = vec![format!("  {heading} the eigenvector u of λ_min = {} N/m:", plain(lowest.eigenvalue))];
    for culprit in lowest.culprits.iter().take(LISTED) {
        let Culprit { spring, particles: [i, j], strain, share, relieved, .. } = culprit;
        let enough = match (negative, *relieved > 0.0) {
            (false, _) => "",
            (true, true) => ", enough",
            (true, false) => ", not enough alone",
        };
        let [strain, share, relieved] = [strain, share, relieved].map(|value| plain(*value));
        let without = format!("without its transverse term uᵀAu = {relieved} N/m{enough}");
        lines.push(format!("    spring {spring} ({i}–{j}): strain {strain}, share {share}; {without}"));
    }
    lines.extend(more(lowest.culprits.len()));
    let moving = list(lowest.movers.iter().take(LISTED), |mover| mover.particle.to_string()).join(", ");
    lines.push(format!("    moves most: particles {moving}"));
    lines
}

fn more(total: usize) -> Option<String> {
    (total > LISTED).then(|| format!("    and {} more", total - LISTED))
}
