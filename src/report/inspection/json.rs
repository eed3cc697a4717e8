//! An inspection as JSON.

use super::{InspectionReport, part};
use crate::inspect::{Direction, FirstLosses, OptionInspection, Passed, SkipReason, Skipped, Turn};
use crate::report::list;
use serde::ser::{Serialize, SerializeMap, Serializer};
use serde_json::{Value, json};

/// A number that is not finite becomes `null`; so does a step without limit. What was left out is `null`, zero or empty. Losses are `first_loss`, that of
/// definiteness, and `first_lost`, everything with its step.
impl Serialize for InspectionReport<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { scene, step, time, inspection, losses } = self;
        let examined = inspection.examined();
        let inertia = &examined.inertia;
        let culprits = inspection.directions.first().map(|lowest| &lowest.culprits[..]);
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("scene", scene)?;
        map.serialize_entry("step", step)?;
        map.serialize_entry("time", time)?;
        map.serialize_entry("dt", &inspection.dt)?;
        map.serialize_entry("stiffness", inspection.option.name())?;
        map.serialize_entry("dofs", &(inertia.negative + inertia.zero + inertia.positive))?;
        serialize_option(&mut map, examined, inspection.is_definite())?;
        map.serialize_entry("definite_proven", &inspection.is_proven())?;
        map.serialize_entry("growing_modes", &inspection.growing_modes)?;
        map.serialize_entry("compressed_springs", &inspection.compressed_springs)?;
        map.serialize_entry("culprits", &json!(culprits.unwrap_or_default()))?;
        map.serialize_entry("directions", &list(&inspection.directions, direction))?;
        map.serialize_entry("clusters", &json!(inspection.clusters))?;
        map.serialize_entry("smallest_set", &json!(inspection.smallest_set))?;
        map.serialize_entry("options", &Options(&inspection.options))?;
        map.serialize_entry("turning", &inspection.turn.as_ref().map(turn))?;
        map.serialize_entry("left_out", &list(&inspection.skipped, left_out))?;
        map.serialize_entry("estimated", &list(&inspection.estimated, |&estimated| part(estimated)))?;
        if let Some(losses) = losses {
            if let Some(loss) = &losses.definite {
                let first_loss = json!({
                    "step": loss.step, "time": loss.time, "stiffness": loss.option.name(), "negative": loss.negative,
                    "culprits": loss.culprits,
                });
                map.serialize_entry("first_loss", &first_loss)?;
            }
            map.serialize_entry("first_lost", &first_lost(losses))?;
        }
        map.end()
    }
}

struct Options<'a>(&'a [OptionInspection]);

impl Serialize for Options<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|option| (option.option.name(), OptionRecord(option))))
    }
}

struct OptionRecord<'a>(&'a OptionInspection);

impl Serialize for OptionRecord<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        serialize_option(&mut map, self.0, self.0.inertia.is_definite())?;
        map.end()
    }
}

/// Adds what is known of A under an option; `within` are proven ends of the intervals of λ, `null` where there is no proof.
fn serialize_option<M: SerializeMap>(map: &mut M, option: &OptionInspection, definite: bool) -> Result<(), M::Error> {
    map.serialize_entry("inertia", &json!(option.inertia))?;
    map.serialize_entry("definite", &definite)?;
    map.serialize_entry("lambda_min", &option.smallest)?;
    map.serialize_entry("lambda_max", &option.largest)?;
    map.serialize_entry("lambda_min_within", &option.within[0])?;
    map.serialize_entry("lambda_max_within", &option.within[1])?;
    map.serialize_entry("condition", &option.condition)?;
    map.serialize_entry("critical_dt", &option.critical.dt())?;
    map.serialize_entry("stable_dt", &option.stable.dt())?;
    map.serialize_entry("turning_dt", &option.turning.dt())
}

fn direction(direction: &Direction) -> Value {
    let movers = list(&direction.movers, |mover| {
        let displacement: [f64; 3] = mover.displacement.into();
        json!({ "particle": mover.particle, "displacement": displacement })
    });
    json!({
        "eigenvalue": direction.eigenvalue, "stiffness_curvature": direction.stiffness_curvature,
        "culprits": direction.culprits, "particles": movers,
    })
}

fn left_out(skipped: &Skipped) -> Value {
    let why = match skipped.why {
        SkipReason::Interrupted => "interrupted",
        SkipReason::TooMuchWork => "too much work",
        SkipReason::TooMuchMemory => "too much memory",
    };
    json!({ "part": part(skipped.part), "why": why })
}

/// The first losses, `null` for what was kept or not looked for.
fn first_lost(losses: &FirstLosses) -> Value {
    let lost_at = |at: Passed, mut record: Value| {
        record["step"] = json!(at.step);
        record["time"] = json!(at.time);
        record
    };
    json!({
        "definite": losses.definite.as_ref().map(|loss| json!({ "step": loss.step, "time": loss.time })),
        "stable": losses.stable,
        "turning": losses.turning.as_ref().map(|(at, lost)| lost_at(*at, turn(lost))),
        "energy": losses.energy.map(|(at, gain)| lost_at(at, json!(gain))),
    })
}

fn turn(turn: &Turn) -> Value {
    let Turn { spring, particles, angle, stretch, .. } = turn;
    let (braked, too_far) = (turn.braked(), turn.excess() > 1.0);
    json!({
        "spring": spring, "particles": particles, "angle": angle, "stretch": stretch, "braked": braked, "too_far": too_far,
    })
}
