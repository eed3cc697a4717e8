//! What is asked for.

use crate::integrate::{Method, StiffnessPolicy};
use crate::linear::SolverChoice;
use faer::Par;

/// What is wanted.
#[derive(Debug, Clone, Copy)]
pub struct Requirement {
    /// The largest [relative position error](super::relative_position_error) at the end.
    pub accuracy: f64,
    /// Length of the motion, in s.
    pub duration: f64,
    /// The interval at which the answer is recorded, in s.
    pub interval: f64,
    /// Parallelism of the factorizations.
    pub par: Par,
    /// Only this method, where one is given.
    pub method: Option<Method>,
    /// Only this stiffness policy, where one is given.
    pub stiffness: Option<StiffnessPolicy>,
    /// Only this solver, where one is given.
    pub solver: Option<SolverChoice>,
}
