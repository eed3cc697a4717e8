//! Which runs advice can rest on: those from which on everything finer is better.
//!
//! A run of long steps may end near the right place by chance, and the run of steps half as long, to which one turns when in
//! doubt, may explode. So a run counts only as part of its configuration's *tail*: the runs from the shortest steps up, as long as
//! every one succeeded and erred more than all that are shorter. Errors near that of the reference say nothing about each
//! other: below a *floor* they need not fall. A tail of one run is none, as nothing confirms it.

use super::curve::{Curve, curves};
use super::reference::ABOVE_THE_FLOOR;
use super::{Run, WorkPrecision};
use std::cmp::Ordering;

/// The tail of a curve, from short steps to long ones; empty where it has none.
pub fn tail<'a>(curve: &Curve<'a>, floor: f64) -> Vec<&'a Run> {
    let mut runs = curve.runs.clone();
    runs.sort_by(|a, b| finer(a, b));
    let mut worst = 0.0;
    let mut tail = Vec::new();
    for run in runs {
        let Some(error) = run.useful_error() else { break };
        let falls = error > worst || (error <= floor && worst <= floor);
        if !falls {
            break;
        }
        worst = error.max(worst);
        tail.push(run);
    }
    if tail.len() < 2 { Vec::new() } else { tail }
}

/// Shorter steps first: smaller tolerances, or smaller dt.
fn finer(a: &Run, b: &Run) -> Ordering {
    let pace = |run: &Run| run.rtol.unwrap_or(run.dt);
    pace(a).total_cmp(&pace(b))
}

impl WorkPrecision {
    /// The error below which runs cannot be told apart.
    pub fn floor(&self) -> f64 {
        ABOVE_THE_FLOOR * self.reference.error_estimate
    }

    /// The runs of all tails.
    pub fn sound_runs(&self) -> Vec<&Run> {
        let is_excluded =
            |run: &Run| self.excluded.iter().any(|&at| self.runs.get(at).is_some_and(|r| std::ptr::eq(r, run)));
        let curves = curves(&self.runs);
        curves.iter().flat_map(|curve| tail(curve, self.floor())).filter(|run| !is_excluded(run)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::Reference;
    use crate::system::State;

    #[test]
    fn three_times_the_error_of_the_reference_is_the_floor() {
        let state = State { time: 0.0, positions: Vec::new(), velocities: Vec::new() };
        let reference = Reference { method: "made up".into(), error_estimate: 5e-4, state };
        let (runs, tolerances, sizes) = Default::default();
        let chart = WorkPrecision {
            scene: "s".into(),
            duration: 1.0,
            reference,
            runs,
            tolerances,
            sizes,
            excluded: Vec::new(),
        };
        assert_eq!(chart.floor(), 1.5e-3);
    }
}
