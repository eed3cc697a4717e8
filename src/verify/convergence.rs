//! Errors shrink with the step at the order of the method.
//!
//! The same time is run with steps h, h/2, h/4, …; with `x_h = x + C hᵖ + …` the distance of neighbours is
//! `x_h − x_{h/2} = (1 − 2⁻ᵖ) C hᵖ + …`, so its logarithm falls with slope p, whatever the true solution is. The steps are
//! short enough to resolve every vibration: stiff scenes show less than the order until they are.
//!
//! This shows orders of up to two. Where errors of higher orders are asymptotic they are soon below rounding; such methods are
//! held to known motions.

use super::measured::Measured;
use super::reference;
use super::runs::{Way, direct};
use super::{ErrorCurve, Subject, U, order_checks};
use crate::linear::norm;
use crate::system::State;
use nalgebra::Vector3;

/// Steps of the coarsest run, and how often they are halved.
const STEPS: usize = 8;
const HALVINGS: usize = 4;

/// Degrees of freedom up to which the many short runs are affordable.
const AFFORDABLE: usize = 2000;

/// The coarsest step: z = ω h ≤ 1/8 for every vibration.
pub(super) fn coarsest(subject: &Subject) -> f64 {
    subject.dt.min(subject.resolving_step() / 4.0)
}

/// Where the vibrations are not much faster than the scene's step, and something is moving: the first-order error
/// `½ a T h` of the finest run must have digits.
pub(super) fn is_soft(subject: &Subject) -> bool {
    let Subject { system, state, .. } = subject;
    let h = coarsest(subject);
    let dofs = system.dofs().len();
    if !(1..=AFFORDABLE).contains(&dofs) || h < subject.dt / 20.0 {
        return false;
    }
    let links = reference::links(system, &state.positions);
    let elastic = reference::sum(&links, system.particles(), reference::Link::elastic_force);
    let damping = reference::damping_product(&links, &state.velocities);
    let acceleration = |p: usize| (elastic[p] + damping[p]) / system.masses()[p] + system.gravity();
    let accelerations: Vec<Vector3<f64>> = (0..system.particles()).map(acceleration).collect();
    let largest = norm(&reference::free(system, &accelerations));
    let error = 0.5 * largest * (STEPS as f64 * h) * h / (1 << HALVINGS) as f64;
    error > 100.0 * rounding(subject)
}

/// What rounding does to the end of the longest run: u a step.
fn rounding(subject: &Subject) -> f64 {
    U * (subject.extent() + subject.centre().norm()) * (STEPS << HALVINGS) as f64
}

pub(super) fn measure(subject: &Subject) -> Measured {
    let h = coarsest(subject);
    let mut curves = Vec::new();
    for way in Way::of(subject).filter(|way| way.method.order() <= 2) {
        let mut ends = Vec::new();
        for halving in 0..=HALVINGS {
            let parts = 1 << halving;
            let states = way.run(subject, direct(), h / parts as f64, STEPS * parts)?;
            ends.extend(states.and_then(|states| states.last().cloned()));
        }
        if ends.len() <= HALVINGS {
            continue;
        }
        let distances: Vec<f64> = ends.windows(2).map(|pair| distance(&pair[0], &pair[1])).collect();
        // Below a hundred roundings a distance has no two digits.
        if distances.iter().any(|&distance| distance < 100.0 * rounding(subject)) {
            continue;
        }
        let step = |halving: usize| h / (1 << halving) as f64;
        let points = distances.into_iter().enumerate().map(|(halving, distance)| (step(halving), distance)).collect();
        curves.push(ErrorCurve { method: way.name(), order: way.method.order(), points });
    }
    Ok(order_checks("observed order", &subject.name, "‖x(h) − x(h/2)‖, m", curves))
}

fn distance(a: &State, b: &State) -> f64 {
    a.positions.iter().zip(&b.positions).map(|(x, y)| (x - y).norm_squared()).sum::<f64>().sqrt()
}
