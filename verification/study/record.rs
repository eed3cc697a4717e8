//! Everything that is run on one scene.

use super::random::{self, Traits};
use super::runs::{Run, TestCase, ways};
use super::store::Store;
use serde::{Deserialize, Serialize};
use sprung::Scene;
use sprung::integrate::{ImplicitOptions, Method};

/// A scene of the study and what is known of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Its name.
    pub scene: String,
    /// `network`, `cloth`, … or `named`.
    pub shape: String,
    /// The seed of a random scene.
    pub seed: Option<u64>,
    /// Modelled axes.
    pub dimension: usize,
    /// Particles.
    pub particles: usize,
    /// Length of the run, in s.
    pub duration: f64,
    /// Vibrations times 2π in the run, at most.
    pub pace: Option<f64>,
    /// Whether it is damped.
    pub damped: bool,
    /// Whether a prescribed particle moves.
    pub moved: bool,
    /// The reference's own error; `None` where there is no reference, and then no runs.
    pub reference_error: Option<f64>,
    /// By how much a deviation at the start has grown at the end.
    pub amplification: Option<f64>,
    /// The shortest that a spring ever was, relative to its rest length.
    pub shortest: Option<f64>,
    /// Runs.
    pub runs: Vec<Run>,
}

/// Which runs are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wanted {
    /// Runs of fixed steps.
    pub fixed: bool,
    /// Runs with `--rtol`.
    pub adaptive: bool,
    /// Runs with `--accuracy`.
    pub accuracy: bool,
}

/// Steps of a run, in parts of it.
const PARTS: [f64; 3] = [30.0, 100.0, 300.0];

/// Steps that everybody takes, in s.
const CUSTOMARY: [f64; 2] = [0.01, 1.0 / 60.0];

/// Tolerances of adaptive runs.
const RTOLS: [f64; 4] = [1e-2, 1e-3, 1e-4, 1e-6];

/// Methods of second order take a hundred thousand steps below it.
const SECOND_ORDER: f64 = 1e-4;

/// Accuracies asked for of every scene, and of some.
const ACCURACIES: [f64; 2] = [1e-2, 1e-4];
const MORE_ACCURACIES: [f64; 4] = [1e-1, 1e-3, 1e-5, 1e-6];

/// The part of the random scenes that more accuracies are asked of.
const SOME: u64 = 10;

/// The steps of fixed length that are tried on a run: parts of it, and the customary ones where they make some steps, but
/// not thousands.
pub fn steps(duration: f64) -> Vec<f64> {
    let customary = CUSTOMARY.into_iter().filter(|dt| (10.0..1000.0).contains(&(duration / dt)));
    PARTS.into_iter().map(|parts| duration / parts).chain(customary).collect()
}

/// Studies a random scene.
///
/// # Errors
/// A scene that does not build, which would be a mistake of the generator.
pub fn of_seed(seed: u64, store: &Store, wanted: Wanted) -> sprung::Result<Record> {
    let drawn = random::scene(seed);
    let Traits { pace, damped, moved, .. } = drawn.traits;
    let record = studied(&drawn.scene, store, wanted, seed.is_multiple_of(SOME))?;
    Ok(Record { seed: Some(seed), shape: drawn.shape.name().into(), pace: Some(pace), damped, moved, ..record })
}

/// Studies any scene with a duration.
///
/// # Errors
/// As above.
pub fn of_scene(scene: &Scene, store: &Store, wanted: Wanted) -> sprung::Result<Record> {
    studied(scene, store, wanted, true)
}

fn studied(scene: &Scene, store: &Store, wanted: Wanted, more_accuracies: bool) -> sprung::Result<Record> {
    let (system, start) = scene.build()?;
    let duration = scene.time.duration.unwrap_or(1.0);
    let reference = store.reference(scene, duration)?;
    let mut record = Record {
        scene: scene.name.clone(),
        shape: "named".into(),
        seed: None,
        dimension: system.dimension(),
        particles: system.particles(),
        duration,
        pace: None,
        damped: system.is_damped(),
        moved: system.prescribed().moves(),
        reference_error: reference.as_ref().map(|reference| reference.error),
        amplification: reference.as_ref().map(|reference| reference.amplification),
        shortest: reference.as_ref().map(|reference| reference.shortest),
        runs: Vec::new(),
    };
    let Some(reference) = reference else { return Ok(record) };
    let subject = TestCase { system: &system, start: &start, duration, reference: &reference };
    if wanted.fixed {
        for way in ways() {
            for dt in steps(duration) {
                record.runs.push(subject.fixed(way, dt)?);
            }
        }
    }
    if wanted.adaptive {
        let options = ImplicitOptions::default();
        for method in Method::ALL {
            if method.adaptive_stepper(&system, &start, &options)?.is_some() {
                for rtol in RTOLS.into_iter().filter(|&rtol| rtol >= SECOND_ORDER || method.order() > 2) {
                    record.runs.push(subject.adaptive((method, options.stiffness), rtol)?);
                }
            }
        }
    }
    if wanted.accuracy {
        let more = MORE_ACCURACIES.into_iter().filter(|_| more_accuracies);
        for accuracy in ACCURACIES.into_iter().chain(more) {
            record.runs.push(subject.accurate(accuracy)?);
        }
    }
    Ok(record)
}
