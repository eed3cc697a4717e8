//! A sensible method for a scene and a step, without pilot runs.

use super::Configuration;
use crate::error::Result;
use crate::force::Extensions;
use crate::integrate::{ImplicitOptions, Method, StiffnessPolicy};
use crate::linear::{CholeskySolver, Prepare, SolverOptions};
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};
use crate::work::Work;

/// The W-method where A is positive definite at this state and step, else linearised backward Euler; both with the policy
/// `on-demand`. Says why.
///
/// The W-method is of second order for the price of a second solve, but less robust when compressed springs buckle
/// faster than the step resolves. So the exact matrix of a first-order step of length dt (a stronger test than that of the
/// W-method's own, whose τ = 0.29 dt) is factored once: a Cholesky factorization exists if and only if it is definite.
///
/// # Errors
/// Coincident ends of a spring in `state`; a matrix that is too large.
pub fn preset(system: &System, state: &State, dt: f64, linear: SolverOptions) -> Result<(Configuration, &'static str)> {
    let extensions = Extensions::at(system, &state.positions)?;
    let operator = SystemOperator::new(system, &extensions, Stiffness::Full, Combination::step(dt));
    let mut work = Work::default();
    let options = ImplicitOptions { stiffness: StiffnessPolicy::OnDemand, linear };
    let definite = CholeskySolver::new(system, linear.par, &mut work)?.prepare(&operator, &mut work).is_ok();
    let (method, why) = match definite {
        true => (Method::W2, "A is positive definite with this step: second order for one more solve"),
        false => (Method::LinearBackwardEuler, "A is indefinite with this step: the most robust method"),
    };
    Ok((Configuration { method, options }, why))
}
