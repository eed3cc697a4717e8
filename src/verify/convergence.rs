//! Errors shrink with the step at the order of the method.
//!
//! The same time is run with steps h, h/2, h/4, …; with `x_h = x + C hᵖ + …` the distance of neighbours is
//! `x_h − x_{h/2} = (1 − 2⁻ᵖ) C hᵖ + …`, so its logarithm falls with slope p, whatever the true solution is. The steps are
//! short enough to resolve every vibration: stiff scenes show less than the order until they are.

use super::family::Outcome;
use super::reference::U;
use super::runs::{Way, direct};
use super::{Check, Claim, Subject, worst};
use crate::figure::{Guide, Plot, Series};
use crate::system::State;

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

/// Where something moves, enough for differences of differences to have digits.
pub(super) fn is_soft(subject: &Subject) -> bool {
    let dofs = subject.system.dofs().len();
    // Stiff scenes would take longer than their own step lasts: their order is not seen in a time that matters.
    (1..=AFFORDABLE).contains(&dofs) && coarsest(subject) > subject.dt / 20.0
}

pub(super) fn measure(subject: &Subject) -> Outcome {
    let h = coarsest(subject);
    let mut checks = Vec::new();
    for way in Way::ALL {
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
        // Rounding grows with the steps; below a hundred times it a distance has no two digits.
        let extent = subject.extent() + subject.centre().norm();
        let rounding = U * extent * (STEPS << HALVINGS) as f64;
        if worst(distances.iter().map(|d| -d)) > -100.0 * rounding {
            continue;
        }
        let steps: Vec<f64> = (0..HALVINGS).map(|halving| h / (1 << halving) as f64).collect();
        let points: Vec<(f64, f64)> = steps.iter().copied().zip(distances.iter().copied()).collect();
        let order = (distances[HALVINGS - 2] / distances[HALVINGS - 1]).log2();
        let expected = way.order();
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
