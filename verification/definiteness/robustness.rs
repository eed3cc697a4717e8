//! Newton's method with its default policy at any step: each step is solved, or says why not.

use super::scenes::{Drawn, logarithmic, random, scene};
use sprung::integrate::{BackwardEuler, ImplicitOptions, NewtonOptions, StepFailure, TimeStepper};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::ops::Range;

/// Steps, in s.
pub const STEPS: Range<f64> = 1e-3..10.0;

/// One step with the defaults of a run.
pub struct Run {
    pub seed: u64,
    pub name: String,
    pub dt: f64,
    pub iterations: u64,
    pub failure: Option<StepFailure>,
    /// A failure contradicts itself, or the state that it left is another one.
    pub is_wrong: bool,
}

/// One step of each scene, of a length between [`STEPS`] by its logarithm.
pub fn runs(seeds: Range<u64>) -> sprung::Result<Vec<Run>> {
    let run = |seed: u64| {
        let Drawn { name, system, state, .. } = scene(seed)?;
        let dt = logarithmic(&mut random(seed.wrapping_mul(3)), STEPS.start, STEPS.end);
        let newton = NewtonOptions::default();
        let mut stepper = BackwardEuler::new(&system, &state, &ImplicitOptions::default(), newton)?;
        let mut after = state.clone();
        let failure = stepper.step(&mut after, dt).err();
        let iterations = stepper.statistics().work.newton_iterations;
        // A residual within the tolerance is no failure.
        let contradicts = matches!(failure, Some(StepFailure::Newton { relative_residual, .. })
            if relative_residual.is_nan() || relative_residual <= newton.tolerance);
        let is_wrong = contradicts || failure.is_some() && after != state;
        Ok(Run { seed, name, dt, iterations, failure, is_wrong })
    };
    seeds.map(run).collect()
}

/// The page's part, with every failure by name.
pub fn section(runs: &[Run]) -> String {
    let failed: Vec<&Run> = runs.iter().filter(|run| run.failure.is_some()).collect();
    let mut iterations: Vec<u64> = runs.iter().filter(|run| run.failure.is_none()).map(|run| run.iterations).collect();
    iterations.sort_unstable();
    let mut text = format!(
        "## Newton's method at any step\n\nOne step of backward Euler as `run` takes it, from {} scenes, of {} to {} s: {} are solved, with {} iterations in the median and {} at most. \
         {} failures contradict themselves or change the state.\n\n",
        runs.len(),
        STEPS.start,
        STEPS.end,
        iterations.len(),
        iterations.get(iterations.len() / 2).copied().unwrap_or(0),
        iterations.last().copied().unwrap_or(0),
        runs.iter().filter(|run| run.is_wrong).count(),
    );
    let mut kinds: BTreeMap<&str, usize> = BTreeMap::new();
    for run in &failed {
        *kinds.entry(&run.name).or_default() += 1;
    }
    let kinds: Vec<String> = kinds.into_iter().map(|(name, count)| format!("{name} {count}")).collect();
    let _ = writeln!(
        text,
        "The others by scenes: {}.\n\n| seed | scene | dt, s | reason |\n|---|---|---|---|",
        kinds.join("; ")
    );
    for run in failed {
        let reason = run.failure.map(|failure| failure.to_string()).unwrap_or_default();
        let _ = writeln!(text, "| {} | {} | {:.3} | {reason} |", run.seed, run.name, run.dt);
    }
    text
}
