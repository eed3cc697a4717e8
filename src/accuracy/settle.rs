//! The cheapest of the paces that are accurate enough, run once more to see that it is.

use super::ladder::Task;
use super::race::{Limit, Race, SAFETY};
use super::{Choice, Configuration, Pace, trial};
use crate::error::Result;
use crate::integrate::Status;

/// A ladder that is accurate enough somewhere.
pub(super) struct Finalist {
    ladder: usize,
    pace: Pace,
    pub cost: f64,
}

impl Race {
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

    pub fn best(&self, task: &Task<'_>, limit: &Limit, accuracy: f64) -> Option<Finalist> {
        self.finalists(task, limit, accuracy).into_iter().next()
    }

    /// Runs the best choice once more, and with shorter steps should it miss the accuracy.
    pub fn settle(mut self, task: &Task<'_>, limit: &Limit, accuracy: f64) -> Result<Option<Choice>> {
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
            let cost = task.costs.cost(&run.statistics.work, run.factor);
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
