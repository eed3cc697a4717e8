//! An inspection as JSON.

use super::part;
use crate::inspect::{Culprit, FirstLosses, Inspection, Minimality, OptionInspection, SkipReason, Turn};
use serde::Serialize;
use serde_json::{Value, json};

/// An inspection as it is written to JSON. A number that is not finite becomes `null`; so does a step without
/// limit, and what was left out.
#[derive(Debug, Clone, Serialize)]
pub struct InspectionRecord<'a> {
    scene: &'a str,
    step: u64,
    time: f64,
    dt: f64,
    stiffness: &'static str,
    dofs: usize,
    #[serde(flatten)]
    examined: OptionRecord,
    definite_proven: bool,
    growing_modes: usize,
    compressed_springs: usize,
    culprits: Vec<Value>,
    directions: Vec<Value>,
    clusters: Vec<Value>,
    smallest_set: Option<Value>,
    options: OptionRecords,
    turning: Option<Value>,
    left_out: Vec<Value>,
    /// The parts of the above that are estimates.
    estimated: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    first_loss: Option<Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    first_lost: Option<Value>,
}

#[derive(Debug, Clone, Serialize)]
struct OptionRecords {
    full: OptionRecord,
    tension: OptionRecord,
    axial: OptionRecord,
    absolute: OptionRecord,
}

#[derive(Debug, Clone, Serialize)]
struct OptionRecord {
    inertia: Value,
    definite: bool,
    lambda_min: f64,
    lambda_max: f64,
    /// Proven ends of the intervals in which they lie; `null` where there is no proof.
    lambda_min_within: [f64; 2],
    lambda_max_within: [f64; 2],
    condition: f64,
    critical_dt: Option<f64>,
    stable_dt: Option<f64>,
    turning_dt: Option<f64>,
}

impl OptionRecord {
    fn of(option: &OptionInspection) -> Self {
        let inertia = &option.inertia;
        let signs = json!({
            "negative": inertia.negative, "zero": inertia.zero, "positive": inertia.positive, "band": inertia.band,
            "proven": inertia.proven,
        });
        Self {
            inertia: signs,
            definite: inertia.is_definite(),
            lambda_min: option.smallest,
            lambda_max: option.largest,
            lambda_min_within: option.within[0],
            lambda_max_within: option.within[1],
            condition: option.condition,
            critical_dt: option.critical.dt(),
            stable_dt: option.stable.dt(),
            turning_dt: option.turning.dt(),
        }
    }
}

impl<'a> InspectionRecord<'a> {
    /// The record of a scene's state after `step` steps, at a time in s.
    pub fn new(scene: &'a str, step: u64, time: f64, inspection: &'a Inspection) -> Self {
        let [full, tension, axial, absolute] = inspection.options.each_ref().map(OptionRecord::of);
        let examined = inspection.examined();
        let inertia = &examined.inertia;
        let directions = inspection.directions.iter().map(|direction| {
            let movers = direction.movers.iter().map(|mover| {
                let displacement: [f64; 3] = mover.displacement.into();
                json!({ "particle": mover.particle, "displacement": displacement })
            });
            json!({
                "eigenvalue": direction.eigenvalue,
                "stiffness_curvature": direction.stiffness_curvature,
                "culprits": culprits(&direction.culprits),
                "particles": movers.collect::<Vec<_>>(),
            })
        });
        let clusters = inspection.clusters.iter().map(|cluster| {
            json!({
                "springs": cluster.springs,
                "particles": cluster.particles,
                "eigenvalue": cluster.eigenvalue,
                "strain": cluster.strain,
            })
        });
        let smallest_set = inspection.smallest_set.as_ref().map(|set| {
            let minimality = match set.minimality {
                Minimality::Irredundant => "irredundant",
                Minimality::Enough => "enough",
            };
            json!({
                "springs": set.springs,
                "minimality": minimality,
                "at_least": set.at_least,
                "tension_drops": set.tension,
            })
        });
        // What was left out is `null`, zero or empty above.
        let left_out = inspection.skipped.iter().map(|skipped| {
            let why = match skipped.why {
                SkipReason::Interrupted => "interrupted",
                SkipReason::TooMuchWork => "too much work",
                SkipReason::TooMuchMemory => "too much memory",
            };
            json!({ "part": part(skipped.part), "why": why })
        });
        Self {
            scene,
            step,
            time,
            dt: inspection.dt,
            stiffness: inspection.option.name(),
            dofs: inertia.negative + inertia.zero + inertia.positive,
            examined: OptionRecord { definite: inspection.is_definite(), ..OptionRecord::of(examined) },
            definite_proven: inspection.is_proven(),
            growing_modes: inspection.growing_modes,
            compressed_springs: inspection.compressed_springs,
            culprits: inspection.directions.first().map_or(Vec::new(), |lowest| culprits(&lowest.culprits)),
            directions: directions.collect(),
            clusters: clusters.collect(),
            smallest_set,
            options: OptionRecords { full, tension, axial, absolute },
            turning: inspection.turn.as_ref().map(turn),
            left_out: left_out.collect(),
            estimated: inspection.estimated.iter().copied().map(part).collect(),
            first_loss: None,
            first_lost: None,
        }
    }

    /// Adds what a run lost first: definiteness as `first_loss`, everything with its step as `first_lost`, with `null` for what
    /// was kept or not looked for.
    pub fn with_losses(self, losses: Option<&FirstLosses>) -> Self {
        let Some(losses) = losses else { return self };
        let definite = losses.definite.as_ref();
        let first_loss = definite.map(|loss| {
            json!({
                "step": loss.step,
                "time": loss.time,
                "stiffness": loss.option.name(),
                "negative": loss.negative,
                "culprits": culprits(&loss.culprits),
            })
        });
        let turning = losses.turning.as_ref().map(|(at, lost)| {
            let mut record = turn(lost);
            record["step"] = json!(at.step);
            record["time"] = json!(at.time);
            record
        });
        let energy = losses.energy.map(|(at, gain)| {
            json!({ "step": at.step, "time": at.time, "gained": gain.gained, "exchanged": gain.exchanged })
        });
        let first_lost = json!({
            "definite": definite.map(|loss| json!({ "step": loss.step, "time": loss.time })),
            "stable": losses.stable.map(|at| json!({ "step": at.step, "time": at.time })),
            "turning": turning,
            "energy": energy,
        });
        Self { first_loss, first_lost: Some(first_lost), ..self }
    }
}

fn culprits(culprits: &[Culprit]) -> Vec<Value> {
    let record = |culprit: &Culprit| {
        json!({
            "spring": culprit.spring,
            "particles": culprit.particles,
            "strain": culprit.strain,
            "share": culprit.share,
            "curvature": culprit.curvature,
            "without_transverse": culprit.relieved,
        })
    };
    culprits.iter().map(record).collect()
}

/// The spring that a step turns worst: by an angle in rad, stretched by a part of its rest length, with the part of its turning that it
/// loses in a turn by one radian.
fn turn(turn: &Turn) -> Value {
    json!({
        "spring": turn.spring,
        "particles": turn.particles,
        "angle": turn.angle,
        "stretch": turn.stretch,
        "braked": turn.braked(),
        "too_far": turn.excess() > 1.0,
    })
}
