//! A step of bdf2 put back into its equations, which are written out here a second time.
//!
//! With the states x₋, x at the ends of the last step of the same length, `x̃ = (4x − x₋)/3`, `ṽ = (4v − v₋)/3`, `τ = 2h/3` and the
//! prediction `y = x + h v + ½ h (v − v₋)`; in the first step and after kinks of paths `x̃ = x`, `ṽ = v`, `τ = h`, `y = x + h v`.
//! Then, on free coordinates, with `w = (y − x̃)/τ` and K and G at y,
//!
//! ```text
//! M (w − ṽ)/τ − f_el(y) − f_d(y, w) − g + (M/τ² − G/τ − K)(x' − y) = 0,      v' = (x' − x̃)/τ.
//! ```
//!
//! The steps are short enough for one iteration. The default's own choice of K is not written a second time; of it, as of all
//! others, the exact residual after the step is held to a part of that before it.

use super::measured::Measured;
use super::reference::{self, Link, damping_product, free, links, stiffness_product};
use super::runs::{Way, direct};
use super::{Check, Claim, TestCase, U, worst};
use crate::integrate::StiffnessPolicy;
use crate::linear::norm;
use crate::system::{Motion, State};
use nalgebra::Vector3;

/// Steps that are put back.
const STEPS: usize = 5;

/// Units of rounding that a backward stable solve, and forming the residual, may leave.
const UNITS: f64 = 30.0;

/// The part of the exact residual that one iteration may leave where steps resolve all vibrations.
const LEFT: f64 = 0.5;

/// The formula of one step.
struct Formula {
    tau: f64,
    /// x̃ and ṽ.
    base: State,
    /// y and w.
    prediction: State,
}

/// Every way to take steps of bdf2.
pub(super) fn checks(subject: &TestCase, way: Way) -> Measured {
    let dt = subject.dt.min(subject.resolving_step());
    let Some(states) = way.run(subject, direct(), dt, STEPS)? else { return Ok(Vec::new()) };
    let steps: Vec<(Formula, &State)> = (0..STEPS)
        .map(|n| (formula(subject, n.checked_sub(1).map(|last| &states[last]), &states[n], dt), &states[n + 1]))
        .collect();
    let check = |what: &str, value: f64, bound: f64, why: &'static str| {
        Check::new(Claim::Solvers, format!("{what}, {}", way.name()), &subject.name, value, bound, why)
    };
    let moved = worst(steps.iter().map(|(formula, after)| velocity_error(subject, formula, after)));
    let why = "in units of rounding of the positions over τ";
    let mut checks = vec![check("v' = (x' − x̃)/τ", moved, UNITS, why)];
    if let StiffnessPolicy::Always(option) = way.stiffness {
        let value = worst(steps.iter().map(|(formula, after)| {
            let links = links(&subject.system, &formula.prediction.positions);
            let stiffness = stiffness_product(&links, option, &displacement(subject, formula, after));
            linear_rows(subject, formula, after, &stiffness)
        }));
        let why = "in units of rounding, u (‖A‖ (‖x‖ + ‖δx‖) + ‖b‖) in the maximum norm: what a backward stable solve, \
                   rounding the positions and forming the residual leave";
        checks.push(check("residual of a step", value, UNITS, why));
    }
    let left = worst(steps.iter().map(|(formula, after)| left(subject, formula, after)));
    let why = "exact residual forces after the step over those at its prediction, weighted by 1/√m: the matrix need only contract";
    checks.push(check("residual that is left", left, LEFT, why));
    Ok(checks)
}

fn formula(subject: &TestCase, before: Option<&State>, state: &State, h: f64) -> Formula {
    let time = state.time + h;
    let (mut base, mut prediction) = (state.clone(), state.clone());
    let before = before.filter(|_| !is_parted(subject, state.time, h));
    let tau = if before.is_some() { 2.0 * h / 3.0 } else { h };
    for p in 0..state.positions.len() {
        let (x, v) = (state.positions[p], state.velocities[p]);
        prediction.positions[p] = x + v * h;
        if let Some(before) = before {
            base.positions[p] = (x * 4.0 - before.positions[p]) / 3.0;
            base.velocities[p] = (v * 4.0 - before.velocities[p]) / 3.0;
            prediction.positions[p] += (v - before.velocities[p]) * (0.5 * h);
        }
    }
    prediction.time = time;
    prediction.prescribe(&subject.system);
    for p in 0..state.positions.len() {
        prediction.velocities[p] = (prediction.positions[p] - base.positions[p]) / tau;
    }
    Formula { tau, base, prediction }
}

/// Whether a corner of a path parts the step of length h from time t from the one before.
fn is_parted(subject: &TestCase, t: f64, h: f64) -> bool {
    let corners: Vec<f64> = subject.system.prescribed().motions().iter().flat_map(corners).collect();
    let slack = 1e-9 * h;
    let any = |from: f64, to: f64| corners.iter().any(|&corner| from <= corner && corner < to);
    let (now, before) = (any(t - slack, t + h - slack), any(t - h - slack, t - slack));
    (now && !before) || (!now && any(t - h + slack, t - slack))
}

fn corners(motion: &Motion) -> Vec<f64> {
    if let Motion::Path { times, .. } = motion { times.clone() } else { Vec::new() }
}

/// x' − y, zero on prescribed coordinates.
fn displacement(subject: &TestCase, formula: &Formula, after: &State) -> Vec<Vector3<f64>> {
    let mut moved = vec![Vector3::zeros(); after.positions.len()];
    for dof in subject.system.dofs().iter() {
        let (p, axis) = (dof.particle, dof.axis);
        moved[p][axis] = after.positions[p][axis] - formula.prediction.positions[p][axis];
    }
    moved
}

fn velocity_error(subject: &TestCase, formula: &Formula, after: &State) -> f64 {
    worst(subject.system.dofs().iter().map(|dof| {
        let of = |vectors: &[Vector3<f64>]| vectors[dof.particle][dof.axis];
        let (x, base, v) = (of(&after.positions), of(&formula.base.positions), of(&after.velocities));
        let error = (v - (x - base) / formula.tau).abs();
        let unit = U * (x.abs() + 2.0 * base.abs()) / formula.tau;
        if error == 0.0 { 0.0 } else { error / unit }
    }))
}

/// `M (v − ṽ)/τ − f_el − f_d − g` at a state, and the magnitudes of its parts.
fn residual(subject: &TestCase, formula: &Formula, at: &State) -> (Vec<Vector3<f64>>, Vec<f64>) {
    let (system, n) = (&subject.system, at.positions.len());
    let links = links(system, &at.positions);
    let elastic = reference::sum(&links, n, Link::elastic_force);
    let damping = damping_product(&links, &at.velocities);
    let mut sizes = reference::pull(&links, n);
    let damped = reference::magnitude(&links, |link| link.damping, &at.velocities);
    let reach = reference::magnitude(&links, Link::magnitude, &at.positions);
    let rows = system.masses().iter().enumerate().map(|(p, &m)| {
        let (v, base) = (at.velocities[p], formula.base.velocities[p]);
        let inertia = m * (v.norm() + base.norm()) / formula.tau;
        sizes[p] += damped[p] + reach[p] + inertia + m * system.gravity().norm();
        (v - base) * (m / formula.tau) - elastic[p] - damping[p] - system.gravity() * m
    });
    let rows = rows.collect();
    (rows, sizes)
}

/// The largest row of the linear equations, in units of rounding; `stiffness` is K (x' − y).
fn linear_rows(subject: &TestCase, formula: &Formula, after: &State, stiffness: &[Vector3<f64>]) -> f64 {
    let Formula { tau, prediction, .. } = formula;
    let system = &subject.system;
    let moved = displacement(subject, formula, after);
    let rates: Vec<Vector3<f64>> = moved.iter().map(|d| d / *tau).collect();
    let damping = damping_product(&links(system, &prediction.positions), &rates);
    let (mut rows, sizes) = residual(subject, formula, prediction);
    for (p, &m) in system.masses().iter().enumerate() {
        rows[p] += rates[p] * (m / tau) - damping[p] - stiffness[p];
    }
    let largest = |vectors: &[Vector3<f64>]| vectors.iter().fold(0.0_f64, |most, v| most.max(v.amax()));
    let reach = largest(&moved) + largest(&after.positions);
    let b = sizes.into_iter().fold(0.0, f64::max);
    let unit = U * (reference::step_matrix_norm(subject, prediction, *tau) * reach + b);
    worst(free(system, &rows).iter().map(|row| row.abs() / unit))
}

fn left(subject: &TestCase, formula: &Formula, after: &State) -> f64 {
    let mut after = after.clone();
    for (v, (x, base)) in after.velocities.iter_mut().zip(after.positions.iter().zip(&formula.base.positions)) {
        *v = (x - base) / formula.tau;
    }
    let weigh = |rows: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
        rows.iter().zip(subject.system.masses()).map(|(row, m)| row / m.sqrt()).collect()
    };
    let size = |rows: &[Vector3<f64>]| norm(&free(&subject.system, &weigh(rows)));
    let ((before, _), (now, sizes)) =
        (residual(subject, formula, &formula.prediction), residual(subject, formula, &after));
    let rounding: Vec<Vector3<f64>> = sizes.iter().map(|size| Vector3::repeat(UNITS * U * size)).collect();
    // Rounding moves a position by u |x|, and that moves the inertial force.
    let shake =
        |(p, m): (usize, &f64)| Vector3::repeat(UNITS * U * m * after.positions[p].norm() / formula.tau.powi(2));
    let shaken: Vec<Vector3<f64>> = subject.system.masses().iter().enumerate().map(shake).collect();
    size(&now) / (size(&before) + (size(&rounding) + size(&shaken)) / LEFT)
}

#[cfg(test)]
mod tests;
