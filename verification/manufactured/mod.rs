//! Manufactured motions: a motion x(t) is prescribed for the whole nonlinear system, an external force makes it the exact solution, and
//! every method must approach it at its order.
//!
//! ```text
//! x_h = x + C_p hᵖ + C_{p+1} hᵖ⁺¹ + …      order p:  log₂ (e(h)/e(h/2)) → p      limit:  Richardson's extrapolation of x_h → x
//! ```
//!
//! The order alone says nothing of the limit's digits, and a small error nothing of the order; both together leave no term of the
//! equations out (Roache, J. Fluids Eng. 124, 2002; Salari and Knupp, SAND2000-1444).
//!
//! | file | contents |
//! |---|---|
//! | `jet` | functions of time with their derivatives |
//! | `scenes` | scenes and their motions |
//! | `motion` | the force, written from tensions and their rates |

mod jet;
pub mod motion;
pub mod scenes;

use nalgebra::Vector3;
use scenes::Scene;
use sprung::integrate::{
    BackwardEuler, ImplicitMidpoint, ImplicitOptions, Method, NewtonOptions, Schedule, Status, StiffnessPolicy,
    TimeStepper, run,
};
use sprung::linear::{SolverChoice, SolverOptions};
use sprung::{State, Stiffness};
use std::ops::ControlFlow;
use std::sync::Arc;

/// A method with the stiffness of its matrix.
#[derive(Debug, Clone, Copy)]
pub struct Variant {
    pub method: Method,
    pub stiffness: StiffnessPolicy,
}

impl Variant {
    /// Every method with the full stiffness, and those whose result depends on it with the others.
    pub fn all() -> Vec<Self> {
        let of = |method: Method| {
            let policies =
                if method.takes_stiffness() { &StiffnessPolicy::ALL[..] } else { &StiffnessPolicy::ALL[1..2] };
            policies.iter().map(move |&stiffness| Self { method, stiffness })
        };
        Method::ALL.into_iter().flat_map(of).collect()
    }

    /// Whether the equations are smooth: other options change the matrix where a spring becomes shorter than at rest, which leaves the order,
    /// but no expansion in powers of the step.
    pub fn is_smooth(self) -> bool {
        self.stiffness == StiffnessPolicy::Always(Stiffness::Full)
    }

    pub fn name(self) -> String {
        match self.method.takes_stiffness() {
            true => format!("{}, {}", self.method.name(), self.stiffness.name()),
            false => self.method.name().into(),
        }
    }

    /// Steps of the coarsest run for motions of ω T ≈ 10: errors of a per cent.
    fn coarsest(self) -> u64 {
        match self.method.order() {
            0..=2 => 32,
            3..=4 => 16,
            _ => 2,
        }
    }

    /// The state at the end of the scene's motion.
    fn end(self, scene: &Arc<Scene>, steps: u64) -> Result<State, String> {
        let said = |error: sprung::Error| format!("{}: {error}", self.name());
        let (system, start) = scene.system().map_err(said)?;
        let linear = SolverOptions { solver: SolverChoice::Llt, ..SolverOptions::default() };
        let options = ImplicitOptions { stiffness: self.stiffness, linear };
        // To rounding, where the default of 1e-10 would show in the ninth digit.
        let newton = NewtonOptions { tolerance: 1e-13, ..NewtonOptions::default() };
        let mut stepper: Box<dyn TimeStepper + Send + '_> = match self.method {
            Method::BackwardEuler => Box::new(BackwardEuler::new(&system, &start, &options, newton).map_err(said)?),
            Method::ImplicitMidpoint => {
                Box::new(ImplicitMidpoint::new(&system, &start, &options, newton).map_err(said)?)
            }
            method => method.stepper(&system, &start, &options).map_err(said)?,
        };
        let mut end = start.clone();
        let schedule = Schedule::steps(scene.duration / steps as f64, steps);
        let outcome = run(&mut *stepper, &mut end, &schedule, |_, _| ControlFlow::Continue(()));
        match outcome.status() {
            Status::Completed => Ok(end),
            _ => Err(format!("{}: {outcome:?}", self.name())),
        }
    }
}

/// The errors of one method on one scene, halving the step again and again.
#[derive(Debug)]
pub struct Approach {
    /// Step, in s, and the largest errors of a position, in m, and of a velocity, in m/s, coarsest step first.
    pub errors: Vec<(f64, [f64; 2])>,
    /// The size of the motion, in m and m/s.
    pub size: [f64; 2],
    /// Errors of the extrapolated positions and velocities, over the size.
    pub limit: [f64; 2],
    /// The observed order of the coordinate with the largest error, extrapolated to steps of zero.
    pub order: f64,
}

/// Part of the size of a motion below which errors are drowned by rounding: 10⁴ units in the last place of ten thousand steps.
const DROWNED: f64 = 1e-11;

impl Approach {
    /// Runs with steps that are halved so many times, or until errors are drowned by rounding.
    pub fn of(scene: &Arc<Scene>, variant: Variant, halvings: u32) -> Result<Self, String> {
        let exact = scene.state(scene.duration);
        let size =
            [&exact.positions, &exact.velocities].map(|rows| rows.iter().map(|row| row.norm()).fold(0.0, f64::max));
        let (mut errors, mut ends) = (Vec::new(), Vec::new());
        for halving in 0..=halvings {
            let steps = variant.coarsest() << halving;
            let end = variant.end(scene, steps)?;
            let error = [largest(&end.positions, &exact.positions), largest(&end.velocities, &exact.velocities)];
            if error[0] < DROWNED * size[0] && errors.len() > 1 {
                break;
            }
            errors.push((scene.duration / steps as f64, error));
            ends.push(coordinates(&end));
        }
        let (known, split) = (coordinates(&exact), 3 * exact.positions.len());
        let power = variant.method.order();
        let limit: Vec<f64> =
            (0..known.len()).map(|k| extrapolated(ends.iter().map(|end| end[k]).collect(), power) - known[k]).collect();
        let of = |part: &[f64], size: f64| part.iter().fold(0.0, |most: f64, x| most.max(x.abs())) / size;
        let limit_errors = [of(&limit[..split], size[0]), of(&limit[split..], size[1])];
        let last = &ends[ends.len() - 1];
        let apart = |k: &usize| (last[*k] - known[*k]).abs();
        let widest = (0..split).max_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap_or(0);
        let signed: Vec<f64> = ends.iter().map(|end| end[widest] - known[widest]).collect();
        let orders = signed.windows(2).map(|pair| (pair[0] / pair[1]).log2()).collect();
        Ok(Self { errors, size, limit: limit_errors, order: extrapolated(orders, 1) })
    }

    /// Observed orders of positions and velocities between the two shortest steps.
    pub fn observed(&self) -> [f64; 2] {
        let [.., (_, before), (_, last)] = &self.errors[..] else { return [f64::NAN; 2] };
        [0, 1].map(|part| (before[part] / last[part]).log2())
    }
}

/// The limit of values with errors of the powers `first`, `first + 1`, … of a step that is halved from one to the next.
fn extrapolated(mut values: Vec<f64>, first: u32) -> f64 {
    for power in (first as i32..).take(values.len().saturating_sub(1)) {
        let factor = 2f64.powi(power) - 1.0;
        values = values.windows(2).map(|pair| pair[1] + (pair[1] - pair[0]) / factor).collect();
    }
    values.last().copied().unwrap_or(f64::NAN)
}

fn coordinates(state: &State) -> Vec<f64> {
    state.positions.iter().chain(&state.velocities).flat_map(|row| [row.x, row.y, row.z]).collect()
}

fn largest(found: &[Vector3<f64>], known: &[Vector3<f64>]) -> f64 {
    found.iter().zip(known).map(|(found, known)| (found - known).norm()).fold(0.0, f64::max)
}
