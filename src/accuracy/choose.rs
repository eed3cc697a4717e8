//! The cheapest way to a required accuracy, found by pilot runs.
//!
//! Every candidate climbs a ladder: the whole motion with four steps, eight, sixteen, … The cheapest next rung of all is run
//! first, so that no candidate gets more work than the others need, and one that would need several times the work of another
//! by the power law of its errors is given up. The race ends when
//!
//! - the best limit of all ladders is known to a third of the required accuracy,
//! - methods of other kinds are as near to that limit as their own estimates say, among them one that cannot damp: a method that
//!   converges to something else cannot win,
//! - some rung is accurate enough, and no next rung costs less than it.
//!
//! A rung before the last was half as expensive as the last one, so what wins costs at most about twice what the best
//! choice would. The step is then lengthened as far as the accuracy allows, and the choice is run once more to see that it
//! holds. Costs are [counted](CostModel), not timed: the same scene gives the same choice on every machine.

use super::ladder::Task;
use super::race::Race;
use super::{Configuration, Pace};
use crate::error::Result;
use crate::integrate::{Method, StiffnessPolicy};
use crate::linear::{CostModel, SolverChoice};
use crate::system::{State, System};
use faer::Par;

/// What is wanted.
#[derive(Debug, Clone, Copy)]
pub struct Requirement {
    /// The largest [relative position error](super::relative_position_error) at the end.
    pub accuracy: f64,
    /// Length of the motion, in s.
    pub duration: f64,
    /// Parallelism of the factorizations.
    pub par: Par,
    /// Only this method, where one is given.
    pub method: Option<Method>,
    /// Only this stiffness policy, where one is given.
    pub stiffness: Option<StiffnessPolicy>,
    /// Only this solver, where one is given.
    pub solver: Option<SolverChoice>,
}

/// What to run, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// Method, stiffness and solver.
    pub configuration: Configuration,
    /// Step or tolerance.
    pub pace: Pace,
    /// Estimated relative position error of a run with it. Above the required accuracy where no candidate reached that.
    pub estimated_error: f64,
    /// [Cost](CostModel) of a run with it.
    pub cost: f64,
    /// Pilot runs done to find it.
    pub pilots: u32,
    /// What they cost together.
    pub pilot_cost: f64,
    /// Why it was chosen, in one line.
    pub reason: String,
}

/// Pilots stop when they have cost this many force evaluations without reaching the accuracy.
const MOST_COST: f64 = 3e7;

/// Finds the cheapest configuration and pace for a requirement. `None` when no candidate converges, or `go_on` said no.
///
/// # Errors
/// Coincident ends of a spring in `start`; a matrix that is too large.
pub fn choose(
    system: &System,
    start: &State,
    requirement: &Requirement,
    go_on: &dyn Fn() -> bool,
) -> Result<Option<Choice>> {
    let Requirement { accuracy, duration, .. } = *requirement;
    let task = Task { system, start, duration, costs: CostModel::of(system), go_on };
    let mut race = Race::new(system, requirement);
    let mut limit;
    loop {
        limit = race.limit(&task, accuracy);
        let best = limit.as_ref().and_then(|limit| race.best(&task, limit, accuracy));
        let cheapest = best.as_ref().map_or(f64::INFINITY, |best| best.cost);
        let Some(next) = race.next(cheapest, accuracy).filter(|_| go_on() && race.pilot_cost < MOST_COST) else {
            break;
        };
        race.climb(next, &task)?;
    }
    if !go_on() {
        return Ok(None);
    }
    let Some(limit) = limit.or_else(|| race.limit(&task, f64::INFINITY)) else { return Ok(None) };
    race.settle(&task, &limit, accuracy)
}
