//! Newton's method with its default policy at any step: each step is solved, or says why not.

use super::scenes::{Drawn, logarithmic, random, scene};
use super::table::Problem;
use sprung::chart::definiteness::solve_step;
use sprung::integrate::StiffnessPolicy;
use std::ops::Range;

/// Steps, in s.
pub const STEPS: Range<f64> = 1e-3..10.0;

/// One step of each scene, of a length between [`STEPS`] by its logarithm.
pub fn runs(seeds: Range<u64>, policy: StiffnessPolicy) -> sprung::Result<Vec<Problem>> {
    let run = |seed: u64| {
        let Drawn { name, system, state, .. } = scene(seed)?;
        let dt = logarithmic(&mut random(seed.wrapping_mul(3)), STEPS.start, STEPS.end);
        let solves = vec![solve_step(&system, &state, dt, policy)?];
        Ok(Problem { seed, name, factor: Some(dt), solves })
    };
    seeds.map(run).collect()
}
