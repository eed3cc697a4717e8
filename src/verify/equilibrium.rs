//! What is at rest stays at rest, and what drifts as a whole drifts on.
//!
//! With rest lengths as long as the springs are, no spring pulls: b is zero, and so is δx, whatever the option, the step and
//! the method. Given one velocity to all particles and no constraints, all move by `dt v` a step.

use super::measured::Measured;
use super::reference;
use super::runs::{Way, direct};
use super::{Check, Claim, TestCase, U, Unfinished, worst};
use crate::system::State;
use nalgebra::Vector3;

const STEPS: usize = 3;

pub(super) fn measure(subject: &TestCase) -> Measured {
    let resting = subject.relaxed()?;
    let mut drifting = resting.freed()?;
    let axes = subject.system.dimension();
    let velocity = Vector3::from_fn(|axis, _| if axis < axes { [0.3, -0.2, 0.5][axis] } else { 0.0 });
    drifting.state.velocities.fill(velocity * (subject.extent() / subject.dt) * 0.01);
    let mut checks = follow(&resting, "rest is kept")?;
    checks.extend(follow(&drifting, "a drift is kept")?);
    Ok(checks)
}

fn follow(subject: &TestCase, name: &str) -> Result<Vec<Check>, Unfinished> {
    let mut checks = Vec::new();
    for way in Way::of(subject) {
        let dt = way.step(subject);
        let Some(states) = way.run(subject, direct(), dt, STEPS)? else { continue };
        let share = states.iter().enumerate().skip(1).map(|(n, state)| share(subject, dt, n as f64, state));
        let why = "over 30 units of rounding: u k (|x_i| + |x_j|)/l0 and u b (|v_i| + |v_j|) of each spring, as a force on the lightest particle \
                   for the time, and u |x|";
        let name = format!("{name}, {}", way.name());
        let check = Check::new(Claim::Conservation, name, &subject.name, worst(share), 1.0, why);
        checks.push(check.unless(|| subject.beyond_rounding(dt)));
    }
    Ok(checks)
}

/// The distance of the state after n steps from `x + n dt v` over what rounding allows.
fn share(subject: &TestCase, dt: f64, n: f64, state: &State) -> f64 {
    let TestCase { system, state: start, .. } = subject;
    let links = reference::links(system, &state.positions);
    let elastic = reference::magnitude(&links, reference::Link::magnitude, &state.positions);
    let damping = reference::magnitude(&links, |link| link.damping, &state.velocities);
    let force: Vec<f64> = elastic.iter().zip(&damping).map(|(elastic, damping)| elastic + damping).collect();
    let masses = reference::movers(system).map(|p| system.masses()[p]).fold(f64::INFINITY, f64::min);
    // ‖δx‖ ≤ dt²/m ‖f‖ in the Euclidean norm, since A ≥ M/dt²; velocities, and with them later steps, add up.
    let force = force.iter().map(|f| f * f).sum::<f64>().sqrt();
    let drift = n * n * dt * dt / masses * U * force;
    worst((0..system.particles()).map(|p| {
        let expected = start.positions[p] + start.velocities[p] * (n * dt);
        let rounding = drift + n * U * (state.positions[p].norm() + start.positions[p].norm());
        let moved = (state.positions[p] - expected).norm();
        if moved == 0.0 { 0.0 } else { moved / (30.0 * rounding) }
    }))
}
