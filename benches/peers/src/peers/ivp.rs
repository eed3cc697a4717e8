//! DOP853 of the library `ivp`.

use super::tolerance::Tolerance;
use crate::Failure;
use crate::limits::{Patience, TOO_LONG};
use crate::motion::Motion;
use ::ivp::dense::StepInterpolant;
use ::ivp::ivp::FirstOrderSystem;
use ::ivp::methods::{self, DOP853};
use ::ivp::solout::{ControlFlag, SolOut};
use ::ivp::status::Status;

impl FirstOrderSystem for Motion<'_> {
    fn derivative(&self, t: f64, y: &[f64], dy: &mut [f64]) {
        self.rate(t, y, dy);
    }
}

/// Keeps the state reached, and ends a run that takes too long.
struct SpringVisitor<'p> {
    reached: Vec<f64>,
    patience: &'p Patience,
}

impl SolOut for SpringVisitor<'_> {
    fn solout(&mut self, _: f64, _: &mut f64, y: &mut [f64], _: Option<&StepInterpolant<'_>>) -> ControlFlag {
        self.reached.copy_from_slice(y);
        if self.patience.lasts() { ControlFlag::Continue } else { ControlFlag::Interrupt }
    }
}

/// y at the end of a piece of time. No limit of steps and no search for stiffness: only the time is limited.
pub fn solve(
    motion: &Motion<'_>,
    [from, to]: [f64; 2],
    y: &[f64],
    tolerance: Tolerance,
    patience: &Patience,
) -> Result<Vec<f64>, Failure> {
    let method = DOP853 { max_steps: usize::MAX, stiff_test: usize::MAX, dense_output: false, ..DOP853::default() };
    let [relative, absolute] = [tolerance.relative, tolerance.absolute].map(methods::Tolerance::Scalar);
    let mut watch = SpringVisitor { reached: y.to_vec(), patience };
    let outcome = method.solve(motion, from, y, to, relative, absolute, Some(&mut watch));
    match outcome.map_err(|error| format!("{error:?}"))?.status {
        Status::Success => Ok(watch.reached),
        Status::UserInterrupt => Err(TOO_LONG.into()),
        _ => Err("broke down".into()),
    }
}
