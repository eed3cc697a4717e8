//! Runs by configuration, and which of them led somewhere.

use super::Run;

/// An error above this is no result: the run counts as failed.
pub const LARGEST_ERROR: f64 = 1.0;

/// Runs of one configuration from long steps to short ones.
#[derive(Debug, Clone)]
pub struct Curve<'a> {
    /// The method's name, `w2, adaptive` where steps are.
    pub method: String,
    /// The stiffness policy's name.
    pub stiffness: &'static str,
    /// The linear solver.
    pub solver: &'static str,
    /// The runs.
    pub runs: Vec<&'a Run>,
}

impl Run {
    /// The error of a run that led somewhere: completed, and off by less than [`LARGEST_ERROR`].
    pub fn useful_error(&self) -> Option<f64> {
        self.error.filter(|error| *error < LARGEST_ERROR)
    }

    /// Why a run has no useful error, in a word or two.
    pub fn cause(&self) -> Option<String> {
        match self.error {
            _ if self.useful_error().is_some() => None,
            Some(_) => Some("error above 100 %".into()),
            None => Some(self.status.name().replace('-', " ")),
        }
    }
}

/// What follows the name of a method whose steps adapt.
pub(super) const ADAPTIVE: &str = ", adaptive";

/// The sweep's runs by configuration, in the sweep's order.
pub fn curves(runs: &[Run]) -> Vec<Curve<'_>> {
    let mut curves: Vec<Curve<'_>> = Vec::new();
    for run in runs {
        let method = if run.rtol.is_some() { format!("{}{ADAPTIVE}", run.method) } else { run.method.to_owned() };
        // A run that failed before it solved anything does not know its solver better than the others of its curve.
        let same = |c: &&mut Curve<'_>| c.method == method && c.stiffness == run.stiffness && c.solver == run.solver;
        match curves.iter_mut().find(same) {
            Some(curve) => curve.runs.push(run),
            None => curves.push(Curve { method, stiffness: run.stiffness, solver: run.solver, runs: vec![run] }),
        }
    }
    curves
}
