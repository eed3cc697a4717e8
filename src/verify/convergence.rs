//! Errors shrink with the step at the order of the method.
//!
//! The same time is run with steps h, h/2, h/4, …; with `x_h = x + C hᵖ + …` the distance of neighbours is
//! `x_h − x_{h/2} = (1 − 2⁻ᵖ) C hᵖ + …`, so its logarithm falls with slope p, whatever the true solution is. The steps are
//! short enough to resolve every vibration: stiff scenes show less than the order until they are.

use super::family::Outcome;
use super::reference;
use super::runs::{Way, direct};
use super::{Check, Claim, Subject, U};
use crate::figure::{Guide, Plot, Series};
use crate::linear::norm;
use crate::system::State;
use nalgebra::Vector3;

/// Steps of the coarsest run, and how often they are halved.
const STEPS: usize = 8;
const HALVINGS: usize = 4;

/// How far the observed order may be from the theoretical one.
const TOLERANCE: f64 = 0.2;

/// Degrees of freedom up to which the many short runs are affordable.
const AFFORDABLE: usize = 2000;

/// The coarsest step: z = ω h ≤ 1/8 for every vibration.
fn coarsest(subject: &Subject) -> f64 {
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

pub(super) fn measure(subject: &Subject) -> Outcome {
    let h = coarsest(subject);
    let mut checks = Vec::new();
    for way in Way::all() {
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
        let steps: Vec<f64> = (0..HALVINGS).map(|halving| h / (1 << halving) as f64).collect();
        let points: Vec<(f64, f64)> = steps.iter().copied().zip(distances.iter().copied()).collect();
        let order = (distances[HALVINGS - 2] / distances[HALVINGS - 1]).log2();
        let expected = f64::from(way.method.order());
        let plot = Plot::log_log(format!("{}, {}", subject.name, way.name()), "step h, s", "‖x(h) − x(h/2)‖, m")
            .with_series(Series::line(way.name(), points).with_slope(order))
            .with_guide(Guide::Slope { slope: expected, through: (h, distances[0]) });
        let why =
            "distance of the observed order from theory; what is left of the next order at these steps is below 0.2";
        let name = format!("observed order, {}", way.name());
        let value = (order - expected).abs();
        checks.push(Check::new(Claim::Convergence, name, &subject.name, value, TOLERANCE, why).with_curves(plot));
    }
    Ok(checks)
}

fn distance(a: &State, b: &State) -> f64 {
    a.positions.iter().zip(&b.positions).map(|(x, y)| (x - y).norm_squared()).sum::<f64>().sqrt()
}
