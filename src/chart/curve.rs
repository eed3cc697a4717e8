//! Runs by configuration, and which of them advice can rest on: those from which on everything finer is better.
//!
//! A run of long steps may end near the right place by chance. So a run counts only as part of its configuration's *tail*: the runs from the shortest
//! steps up, as long as every one succeeded and erred more than all that are shorter. Below a *floor*, the error of the reference, they need not
//! fall. A tail of one run above the floor is none, as nothing confirms it.

use super::reference::ABOVE_THE_FLOOR;
use super::{Run, WorkPrecision};
use crate::accuracy::extent;

/// Runs of one configuration from long steps to short ones.
#[derive(Clone)]
pub(super) struct Curve<'a> {
    /// The method's name, `w2, adaptive` where steps are.
    pub method: String,
    pub stiffness: &'static str,
    pub solver: &'static str,
    pub runs: Vec<&'a Run>,
}

/// The sweep's runs by configuration, in the sweep's order.
pub(super) fn curves(runs: &[Run]) -> Vec<Curve<'_>> {
    let mut curves: Vec<Curve<'_>> = Vec::new();
    for run in runs {
        let method = run.variant();
        let same = |c: &&mut Curve<'_>| c.method == method && c.stiffness == run.stiffness && c.solver == run.solver;
        match curves.iter_mut().find(same) {
            Some(curve) => curve.runs.push(run),
            None => curves.push(Curve { method, stiffness: run.stiffness, solver: run.solver, runs: vec![run] }),
        }
    }
    curves
}

/// The tail of a curve, from short steps to long ones; empty where it has none.
pub(super) fn tail<'a>(curve: &Curve<'a>, floor: f64) -> Vec<&'a Run> {
    let mut runs = curve.runs.clone();
    // Shorter steps, or smaller tolerances, first.
    runs.sort_by(|a, b| a.rtol.unwrap_or(a.dt).total_cmp(&b.rtol.unwrap_or(b.dt)));
    let mut worst = 0.0;
    let mut tail = Vec::new();
    for run in runs {
        let Some(error) = run.useful_error() else { break };
        if error <= worst && (error > floor || worst > floor) {
            break;
        }
        worst = error.max(worst);
        tail.push(run);
    }
    if tail.len() < 2 && worst > floor { Vec::new() } else { tail }
}

/// The configuration of each method that costs least, judged by its tail; errors below `floor` are not told apart.
pub(super) fn best_of_each(runs: &[Run], floor: f64) -> Vec<Curve<'_>> {
    let mut best: Vec<Curve<'_>> = Vec::new();
    for curve in curves(runs) {
        match best.iter_mut().find(|other| other.method == curve.method) {
            Some(other) if curve.coefficient(floor) < other.coefficient(floor) => *other = curve,
            Some(_) => {}
            None => best.push(curve),
        }
    }
    best
}

/// Curves by cost, the cheapest first and those without a tail last.
pub(super) fn cheapest_first(mut curves: Vec<Curve<'_>>, floor: f64) -> Vec<Curve<'_>> {
    curves.sort_by(|a, b| a.coefficient(floor).total_cmp(&b.coefficient(floor)));
    curves
}

impl Curve<'_> {
    /// The cost of the configuration, without regard to how far it was taken: the least of `cost · error^(1/2)` over its tail.
    fn coefficient(&self, floor: f64) -> f64 {
        let of_run = |run: &Run| run.useful_error().map(|error| run.cost * error.max(1e-15).sqrt());
        tail(self, floor).into_iter().filter_map(of_run).fold(f64::INFINITY, f64::min)
    }
}

impl WorkPrecision {
    /// The error below which runs cannot be told apart: that of the reference, or the rounding of positions in the run of most steps.
    pub fn floor(&self) -> f64 {
        let positions = &self.reference.state.positions;
        let size = positions.iter().map(|x| x.norm_squared()).sum::<f64>().sqrt() / extent(positions, positions);
        let steps = self.runs.iter().map(|run| self.duration / run.dt).fold(0.0, f64::max);
        let rounding = f64::EPSILON * steps * size;
        let of_reference = ABOVE_THE_FLOOR * self.reference.error_estimate;
        if rounding.is_finite() { of_reference.max(rounding) } else { of_reference }
    }

    /// The runs of all tails, without the excluded ones.
    pub fn sound_runs(&self) -> Vec<&Run> {
        let is_excluded =
            |run: &Run| self.excluded.iter().any(|&at| self.runs.get(at).is_some_and(|r| std::ptr::eq(r, run)));
        let curves = curves(&self.runs);
        curves.iter().flat_map(|curve| tail(curve, self.floor())).filter(|run| !is_excluded(run)).collect()
    }
}
