//! An inspection as JSON.

use super::losses::part;
use crate::inspect::{
    Cluster, Culprit, Direction, DropSet, FirstLosses, Inertia, Inspection, Loss, Minimality, OptionInspection,
    SkipReason, Skipped, Turn,
};
use serde::Serialize;

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
    culprits: Vec<CulpritRecord>,
    directions: Vec<DirectionRecord>,
    clusters: Vec<ClusterRecord<'a>>,
    smallest_set: Option<SetRecord<'a>>,
    options: OptionRecords,
    turning: Option<TurnRecord>,
    left_out: Vec<LeftOutRecord>,
    /// What of the above is an estimate.
    estimated: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    first_loss: Option<LossRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    first_lost: Option<LossesRecord>,
}

impl<'a> InspectionRecord<'a> {
    /// Of an inspection of a scene's state after `step` steps, at a time in s.
    pub fn new(scene: &'a str, step: u64, time: f64, inspection: &'a Inspection) -> Self {
        let Inspection { dt, option, options: [full, tension, axial], directions, .. } = inspection;
        let examined = inspection.examined();
        let inertia = examined.inertia;
        Self {
            scene,
            step,
            time,
            dt: *dt,
            stiffness: option.name(),
            dofs: inertia.negative + inertia.zero + inertia.positive,
            examined: OptionRecord { definite: inspection.is_definite(), ..OptionRecord::of(examined) },
            definite_proven: inspection.is_proven(),
            growing_modes: inspection.growing_modes,
            compressed_springs: inspection.compressed_springs,
            culprits: directions.first().map_or(Vec::new(), |lowest| culprits(&lowest.culprits)),
            directions: directions.iter().map(DirectionRecord::of).collect(),
            clusters: inspection.clusters.iter().map(ClusterRecord::of).collect(),
            smallest_set: inspection.smallest_set.as_ref().map(SetRecord::of),
            options: OptionRecords {
                full: OptionRecord::of(full),
                tension: OptionRecord::of(tension),
                axial: OptionRecord::of(axial),
            },
            turning: inspection.turn.as_ref().map(TurnRecord::of),
            left_out: inspection.skipped.iter().map(LeftOutRecord::of).collect(),
            estimated: inspection.estimated.iter().copied().map(part).collect(),
            first_loss: None,
            first_lost: None,
        }
    }

    /// Adds what a run lost first: of definiteness as `first_loss`, of everything with its step as `first_lost`.
    pub fn with_losses(self, losses: Option<&FirstLosses>) -> Self {
        let first_loss = losses.and_then(|losses| losses.definite.as_ref()).map(LossRecord::of);
        Self { first_loss, first_lost: losses.map(LossesRecord::of), ..self }
    }
}

/// What was not looked at, so that nothing is told by what is `null`, zero or empty in its place.
#[derive(Debug, Clone, Serialize)]
struct LeftOutRecord {
    part: String,
    why: &'static str,
}

impl LeftOutRecord {
    fn of(left_out: &Skipped) -> Self {
        let why = match left_out.why {
            SkipReason::Interrupted => "interrupted",
            SkipReason::TooMuchWork => "too much work",
            SkipReason::TooMuchMemory => "too much memory",
        };
        Self { part: part(left_out.part), why }
    }
}

#[derive(Debug, Clone, Serialize)]
struct OptionRecords {
    full: OptionRecord,
    tension: OptionRecord,
    axial: OptionRecord,
}

#[derive(Debug, Clone, Serialize)]
struct OptionRecord {
    inertia: InertiaRecord,
    definite: bool,
    lambda_min: f64,
    lambda_max: f64,
    /// What they lie between, proven; `null` where there is no proof.
    lambda_min_within: [f64; 2],
    lambda_max_within: [f64; 2],
    condition: f64,
    critical_dt: Option<f64>,
    stable_dt: Option<f64>,
    turning_dt: Option<f64>,
}

impl OptionRecord {
    fn of(option: &OptionInspection) -> Self {
        Self {
            inertia: InertiaRecord::of(&option.inertia),
            definite: option.inertia.is_definite(),
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

#[derive(Debug, Clone, Serialize)]
struct InertiaRecord {
    negative: usize,
    zero: usize,
    positive: usize,
    band: f64,
}

impl InertiaRecord {
    fn of(inertia: &Inertia) -> Self {
        let Inertia { negative, zero, positive, band, .. } = *inertia;
        Self { negative, zero, positive, band }
    }
}

#[derive(Debug, Clone, Serialize)]
struct CulpritRecord {
    spring: usize,
    particles: [usize; 2],
    strain: f64,
    share: f64,
    curvature: f64,
    without_transverse: f64,
}

fn culprits(culprits: &[Culprit]) -> Vec<CulpritRecord> {
    let record = |culprit: &Culprit| {
        let Culprit { spring, particles, strain, share, curvature, relieved } = *culprit;
        CulpritRecord { spring, particles, strain, share, curvature, without_transverse: relieved }
    };
    culprits.iter().map(record).collect()
}

#[derive(Debug, Clone, Serialize)]
struct DirectionRecord {
    eigenvalue: f64,
    stiffness_curvature: f64,
    culprits: Vec<CulpritRecord>,
    particles: Vec<MoverRecord>,
}

#[derive(Debug, Clone, Serialize)]
struct MoverRecord {
    particle: usize,
    displacement: [f64; 3],
}

impl DirectionRecord {
    fn of(direction: &Direction) -> Self {
        let mover =
            |m: &crate::inspect::Mover| MoverRecord { particle: m.particle, displacement: m.displacement.into() };
        Self {
            eigenvalue: direction.eigenvalue,
            stiffness_curvature: direction.stiffness_curvature,
            culprits: culprits(&direction.culprits),
            particles: direction.movers.iter().map(mover).collect(),
        }
    }
}

#[derive(Debug, Clone, Serialize)]
struct ClusterRecord<'a> {
    springs: &'a [usize],
    particles: &'a [usize],
    eigenvalue: f64,
    strain: f64,
}

impl<'a> ClusterRecord<'a> {
    fn of(cluster: &'a Cluster) -> Self {
        let Cluster { springs, particles, eigenvalue, strain } = cluster;
        Self { springs, particles, eigenvalue: *eigenvalue, strain: *strain }
    }
}

#[derive(Debug, Clone, Serialize)]
struct SetRecord<'a> {
    springs: &'a [usize],
    minimality: &'static str,
    at_least: usize,
    tension_drops: usize,
}

impl<'a> SetRecord<'a> {
    fn of(set: &'a DropSet) -> Self {
        let minimality = match set.minimality {
            Minimality::Irredundant => "irredundant",
            Minimality::Enough => "enough",
        };
        Self { springs: &set.springs, minimality, at_least: set.at_least, tension_drops: set.tension }
    }
}

#[derive(Debug, Clone, Serialize)]
struct LossRecord {
    step: u64,
    time: f64,
    stiffness: &'static str,
    negative: usize,
    culprits: Vec<CulpritRecord>,
}

impl LossRecord {
    fn of(loss: &Loss) -> Self {
        let Loss { step, time, negative, .. } = *loss;
        Self { step, time, stiffness: loss.option.name(), negative, culprits: culprits(&loss.culprits) }
    }
}

#[derive(Debug, Clone, Serialize)]
struct TurnRecord {
    spring: usize,
    particles: [usize; 2],
    /// In rad.
    angle: f64,
    /// As a part of the rest length.
    stretch: f64,
    /// The part of its turning that the spring loses in a turn by one radian.
    braked: f64,
    too_far: bool,
}

impl TurnRecord {
    fn of(turn: &Turn) -> Self {
        let Turn { spring, particles, angle, stretch, .. } = *turn;
        Self { spring, particles, angle, stretch, braked: turn.braked(), too_far: turn.excess() > 1.0 }
    }
}

/// Where each thing was first lost; `null` where it was kept or not looked for.
#[derive(Debug, Clone, Serialize)]
struct LossesRecord {
    definite: Option<PointRecord>,
    stable: Option<PointRecord>,
    turning: Option<TurnedRecord>,
    energy: Option<GainRecord>,
}

#[derive(Debug, Clone, Serialize)]
struct PointRecord {
    step: u64,
    time: f64,
}

#[derive(Debug, Clone, Serialize)]
struct TurnedRecord {
    step: u64,
    time: f64,
    #[serde(flatten)]
    turn: TurnRecord,
}

#[derive(Debug, Clone, Serialize)]
struct GainRecord {
    step: u64,
    time: f64,
    gained: f64,
    exchanged: f64,
}

impl LossesRecord {
    fn of(losses: &FirstLosses) -> Self {
        Self {
            definite: losses.definite.as_ref().map(|loss| PointRecord { step: loss.step, time: loss.time }),
            stable: losses.stable.map(|at| PointRecord { step: at.step, time: at.time }),
            turning: losses.turning.as_ref().map(|(at, turn)| TurnedRecord {
                step: at.step,
                time: at.time,
                turn: TurnRecord::of(turn),
            }),
            energy: losses.energy.map(|(at, gain)| GainRecord {
                step: at.step,
                time: at.time,
                gained: gain.gained,
                exchanged: gain.exchanged,
            }),
        }
    }
}
