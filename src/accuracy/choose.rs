//! The cheapest way to a required accuracy, found by pilot runs.
//!
//! Every candidate climbs a [`Ladder`]: the whole motion with four steps, eight, sixteen, … The cheapest next rung of all is run
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

use super::ladder::{Ladder, Task};
use super::{Configuration, CostModel, Pace, trial};
use crate::error::Result;
use crate::integrate::{ImplicitOptions, Method, Status, StiffnessPolicy};
use crate::linear::{SolverChoice, SolverOptions};
use crate::spring::Stiffness;
use crate::system::{State, System};
use faer::Par;
use nalgebra::Vector3;

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

/// The part of the required accuracy that the chosen run may use, by its estimate.
const SAFETY: f64 = 0.75;

/// How much better the limit must be known than the accuracy required.
const LIMIT_SHARE: f64 = 1.0 / 3.0;

/// A ladder that needs this many times the work of another is given up.
const HOPELESS: f64 = 4.0;

/// A run that confirms another may have this many times the error allowed, by its own estimate.
const CONFIRMATION: f64 = 2.0;

/// Pilots that cost this many times the cheapest run have tried enough for a confirmation by a conservative method.
const EXPENSIVE: f64 = 100.0;

/// Degrees of freedom from which conjugate gradients can be cheaper than a factorization.
const ITERATIVE: usize = 300;

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
    let task = Task { system, start, duration, costs: CostModel::of(system)?, go_on };
    let mut race = Race { ladders: candidates(system, requirement), pilots: 0, pilot_cost: 0.0 };
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

/// The end positions that methods agree on, and the relative error that is left in them.
struct Limit {
    positions: Vec<Vector3<f64>>,
    error: f64,
}

/// A ladder that is accurate enough somewhere.
struct Finalist {
    ladder: usize,
    pace: Pace,
    cost: f64,
}

/// What methods do to vibrations that their steps do not resolve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Damp them, as backward Euler does.
    Euler,
    /// Damp them in the way of the W-method.
    Rosenbrock,
    /// Keep their energy, or blow up.
    Conservative,
}

fn kind(method: Method) -> Kind {
    match method {
        Method::LinearBackwardEuler | Method::BackwardEuler => Kind::Euler,
        Method::W2 => Kind::Rosenbrock,
        Method::ImplicitMidpoint | Method::SymplecticEuler | Method::ForwardEuler => Kind::Conservative,
    }
}

struct Race {
    ladders: Vec<Ladder>,
    pilots: u32,
    pilot_cost: f64,
}

fn candidates(system: &System, requirement: &Requirement) -> Vec<Ladder> {
    use Method::*;
    let Requirement { duration, par, accuracy, .. } = *requirement;
    // An error of this size in every step is far below the one that is allowed at the end.
    let tolerance = (1e-3 * accuracy).clamp(1e-12, 1e-4);
    let with = |method, stiffness, solver| {
        let linear = SolverOptions { solver, par, tolerance, ..SolverOptions::default() };
        Configuration { method, options: ImplicitOptions { stiffness, linear } }
    };
    let (on_demand, axial) = (StiffnessPolicy::OnDemand, StiffnessPolicy::Always(Stiffness::Axial));
    let pairs = [
        (SymplecticEuler, on_demand),
        (LinearBackwardEuler, axial),
        (LinearBackwardEuler, on_demand),
        (W2, on_demand),
        (W2, axial),
        (ImplicitMidpoint, on_demand),
        (BackwardEuler, on_demand),
    ];
    let mut solvers = vec![SolverChoice::Llt];
    if system.dofs().len() >= ITERATIVE {
        solvers.push(SolverChoice::Cg);
    }
    let asked = requirement.solver.filter(|solver| *solver != SolverChoice::Auto);
    let solvers = asked.map_or(solvers, |solver| vec![solver]);
    let mut ladders = Vec::new();
    for (method, stiffness) in pairs.into_iter().filter(|pair| requirement.method.is_none_or(|asked| asked == pair.0)) {
        if requirement.stiffness.is_some() && stiffness != on_demand {
            continue;
        }
        let stiffness = requirement.stiffness.unwrap_or(stiffness);
        let solvers = if method.is_implicit() { solvers.as_slice() } else { &[SolverChoice::Auto] };
        for &solver in solvers {
            let configuration = with(method, stiffness, solver);
            ladders.push(Ladder::fixed(configuration, duration));
            if method == W2 && stiffness != axial {
                ladders.push(Ladder::adaptive(configuration, duration));
            }
        }
    }
    if ladders.is_empty()
        && let Some(method) = requirement.method
    {
        ladders.push(Ladder::fixed(with(method, on_demand, SolverChoice::Auto), duration));
    }
    ladders
}

impl Race {
    fn climb(&mut self, ladder: usize, task: &Task<'_>) -> Result<()> {
        if let Some(ladder) = self.ladders.get_mut(ladder) {
            self.pilot_cost += ladder.climb(task)?;
            self.pilots += 1;
        }
        Ok(())
    }

    /// The ladder to climb next: the one with the cheapest rung, among those that may still win against `cheapest`. As long as
    /// there is no winner a ladder is measured against its own kind only: what the methods of one kind agree on may be wrong.
    fn next(&self, cheapest: f64, accuracy: f64) -> Option<usize> {
        let predicted = |ladder: &Ladder| ladder.predicted_cost(SAFETY * accuracy);
        let least = |of: Kind| {
            let rivals =
                self.ladders.iter().filter(|rival| cheapest.is_finite() || kind(rival.configuration.method) == of);
            rivals.filter_map(predicted).fold(cheapest, f64::min)
        };
        let promising = |ladder: &Ladder| {
            ladder.open
                && ladder.next_cost() < cheapest
                && predicted(ladder).is_none_or(|cost| cost <= HOPELESS * least(kind(ladder.configuration.method)))
        };
        let open = self.ladders.iter().enumerate().filter(|(_, ladder)| promising(ladder));
        open.min_by(|(_, a), (_, b)| a.next_cost().total_cmp(&b.next_cost())).map(|(index, _)| index)
    }

    /// The best-known end positions, if they are known well enough and confirmed.
    ///
    /// A method that damps may converge, at steps much longer than a vibration, to the motion without that vibration; so do
    /// its relatives. So the limit must agree with a method of another kind, and with one that cannot damp, each of about the
    /// accuracy required by its own estimate. Only when that has become far too expensive any other method will do.
    fn limit(&self, task: &Task<'_>, accuracy: f64) -> Option<Limit> {
        let mut limits: Vec<_> = self
            .ladders
            .iter()
            .filter_map(|ladder| {
                let (positions, error) = ladder.limit()?;
                (error <= LIMIT_SHARE * accuracy).then_some((ladder.configuration.method, positions, error))
            })
            .collect();
        limits.sort_by(|a, b| a.2.total_cmp(&b.2));
        let is_asked_alone = |method: Method| self.ladders.iter().all(|ladder| ladder.configuration.method == method);
        let confirmed = |(method, positions, error): &(Method, Vec<Vector3<f64>>, f64)| {
            let confirms = |ladder: &&Ladder| {
                let (Some(last), Some(own)) = (ladder.rungs.last(), ladder.estimate()) else { return false };
                own < CONFIRMATION * accuracy && task.distance(&last.positions, positions) <= 2.0 * (own + error)
            };
            let confirming = || self.ladders.iter().filter(confirms).map(|ladder| ladder.configuration.method);
            let cheapest =
                self.ladders.iter().filter_map(|ladder| ladder.predicted_cost(accuracy)).fold(f64::MAX, f64::min);
            let is_expensive = self.pilot_cost > EXPENSIVE * cheapest;
            is_asked_alone(*method)
                || (confirming().any(|other| kind(other) != kind(*method))
                    && (is_expensive || confirming().any(|other| kind(other) == Kind::Conservative)))
        };
        let (_, positions, error) = limits.into_iter().find(confirmed)?;
        Some(Limit { positions, error })
    }

    fn finalists(&self, task: &Task<'_>, limit: &Limit, accuracy: f64) -> Vec<Finalist> {
        let target = (SAFETY * accuracy - limit.error).max(0.25 * accuracy);
        let ladders = self.ladders.iter().enumerate();
        let mut finalists: Vec<Finalist> = ladders
            .filter_map(|(index, ladder)| {
                let (pace, cost) = ladder.longest_pace(task, &limit.positions, target)?;
                Some(Finalist { ladder: index, pace, cost })
            })
            .collect();
        finalists.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        finalists
    }

    fn best(&self, task: &Task<'_>, limit: &Limit, accuracy: f64) -> Option<Finalist> {
        self.finalists(task, limit, accuracy).into_iter().next()
    }

    /// Runs the best choice once more, and with shorter steps should it miss the accuracy.
    fn settle(mut self, task: &Task<'_>, limit: &Limit, accuracy: f64) -> Result<Option<Choice>> {
        let finalists = self.finalists(task, limit, accuracy);
        let Some(winner) = finalists.first() else { return Ok(self.closest(task, limit)) };
        let Some(configuration) = self.ladders.get(winner.ladder).map(|ladder| ladder.configuration) else {
            return Ok(None);
        };
        let second = finalists
            .iter()
            .find(|other| self.ladders.get(other.ladder).is_some_and(|ladder| ladder.configuration != configuration));
        let runner_up = second.and_then(|second| Some((self.ladders.get(second.ladder)?.configuration, second.cost)));
        let mut pace = winner.pace;
        for _ in 0..6 {
            let run = trial(task.system, task.start, &configuration, pace, task.duration, task.go_on)?;
            let cost = task.costs.cost(&run.statistics.work);
            self.pilots += 1;
            self.pilot_cost += cost;
            let estimated_error = task.distance(&run.state.positions, &limit.positions) + limit.error;
            if run.status == Status::Completed && estimated_error <= accuracy {
                let reason = reason(&configuration, pace, estimated_error, cost, runner_up);
                let (pilots, pilot_cost) = (self.pilots, self.pilot_cost);
                return Ok(Some(Choice { configuration, pace, estimated_error, cost, pilots, pilot_cost, reason }));
            }
            pace = match pace {
                Pace::Step(dt) => Pace::Step(0.8 * dt),
                Pace::Adaptive { rtol, first_step } => Pace::Adaptive { rtol: 0.6 * rtol, first_step },
            };
        }
        Ok(self.closest(task, limit))
    }

    /// Where the accuracy was not reached: the rung nearest to the limit.
    fn closest(&self, task: &Task<'_>, limit: &Limit) -> Option<Choice> {
        let rungs = self.ladders.iter().flat_map(|ladder| ladder.rungs.iter().map(move |rung| (ladder, rung)));
        let distances = rungs.map(|(ladder, rung)| (ladder, rung, task.distance(&rung.positions, &limit.positions)));
        let (ladder, rung, distance) = distances.min_by(|a, b| a.2.total_cmp(&b.2))?;
        let (configuration, estimated_error) = (ladder.configuration, distance + limit.error);
        Some(Choice {
            configuration,
            pace: rung.pace,
            estimated_error,
            cost: rung.cost,
            pilots: self.pilots,
            pilot_cost: self.pilot_cost,
            reason: format!("no method reached the accuracy; {} came closest", configuration.method.name()),
        })
    }
}

fn describe(configuration: &Configuration) -> String {
    match configuration.method.is_implicit() {
        true => {
            let solver = configuration.options.linear.solver.name();
            format!("{} ({}, {solver})", configuration.method.name(), configuration.stiffness())
        }
        false => configuration.method.name().into(),
    }
}

fn reason(
    configuration: &Configuration,
    pace: Pace,
    error: f64,
    cost: f64,
    runner_up: Option<(Configuration, f64)>,
) -> String {
    let pace = match pace {
        Pace::Step(dt) => format!("dt = {dt:.3e} s"),
        Pace::Adaptive { rtol, .. } => format!("rtol = {rtol:.1e}"),
    };
    let against = match runner_up {
        Some((other, other_cost)) => {
            format!("; next best is {} at {:.1} times the work", describe(&other), other_cost / cost)
        }
        None => String::new(),
    };
    let chosen = describe(configuration);
    format!(
        "{chosen} with {pace} ends with an error of about {error:.1e} for the work of {cost:.0} force evaluations{against}"
    )
}
