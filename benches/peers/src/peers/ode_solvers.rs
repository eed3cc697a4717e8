//! DOP853 of the library `ode_solvers`.

use super::tolerance::Tolerance;
use crate::Failure;
use crate::limits::{Patience, TOO_LONG};
use crate::motion::Motion;
use ::ode_solvers::dop_shared::{IntegrationError, OutputType};
use ::ode_solvers::{DVector, Dop853, System};

/// The library keeps the states of all steps, and is begun anew, with the step it had, before they fill the memory.
const STEPS: u32 = 1000;

/// What the library sees. Its table of nodes (0.6.2) has 0 for the twelfth stage, which is at the end of the step: of the time that it
/// hands over the method would be of low order. So where forces depend on time, that is one more unknown.
struct Equations<'e, 's> {
    motion: &'e Motion<'s>,
    patience: &'e Patience,
}

impl System<f64, DVector<f64>> for Equations<'_, '_> {
    fn system(&self, t: f64, y: &DVector<f64>, dy: &mut DVector<f64>) {
        let (y, dy) = (y.as_slice(), dy.as_mut_slice());
        match (y.split_at_checked(self.motion.order()), dy.split_at_mut_checked(self.motion.order())) {
            (Some((y, [time])), Some((dy, [one]))) => {
                *one = 1.0;
                self.motion.rate(*time, y, dy);
            }
            _ => self.motion.rate(t, y, dy),
        }
    }

    fn solout(&mut self, _: f64, _: &DVector<f64>, _: &DVector<f64>) -> bool {
        !self.patience.lasts()
    }
}

/// y at the end of a piece of time.
pub fn solve(
    motion: &Motion<'_>,
    [mut from, to]: [f64; 2],
    mut y: Vec<f64>,
    tolerance: Tolerance,
    patience: &Patience,
) -> Result<Vec<f64>, Failure> {
    if motion.depends_on_time() {
        y.push(from);
    }
    let mut y = DVector::from_vec(y);
    let mut h = 0.0;
    loop {
        let Tolerance { relative, absolute } = tolerance;
        let equations = Equations { motion, patience };
        // The library's defaults, but for its test of stiffness, which would only stop it.
        let mut method = Dop853::from_param(
            equations,
            from,
            to,
            to - from,
            y,
            relative,
            absolute,
            0.9,
            0.0,
            0.333,
            6.0,
            to - from,
            h,
            STEPS,
            u32::MAX,
            OutputType::Sparse,
        );
        let outcome = method.integrate();
        let (&reached, last) = method.x_out().last().zip(method.y_out().last()).ok_or("no step")?;
        match outcome {
            // It ends here too when it is stopped.
            Ok(_) if reached < to - 1e-9 * (to - from) => return Err(TOO_LONG.into()),
            Ok(_) => return Ok(last.as_slice().get(..motion.order()).ok_or("no state")?.to_vec()),
            Err(IntegrationError::MaxNumStepReached { .. }) if reached > from => {
                let before = method.x_out().iter().rev().nth(1).copied().unwrap_or(from);
                h = (reached - before).min(to - reached);
                (from, y) = (reached, last.clone());
            }
            Err(_) => return Err("broke down".into()),
        }
    }
}
