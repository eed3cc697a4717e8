//! What a search has tried, spent and found so far.

use super::attempt::{Attempt, Purpose, SolverReport, Task, Tried, attempt};
use super::audience::{Audience, SearchProgress};
use super::course::{Course, Difference};
use super::horizon::Horizon;
use super::own::Own;
use super::{Configuration, Pace, Requirement, extent};
use crate::error::Result;
use crate::integrate::{Statistics, Status};
use crate::system::State;

/// A search stops without an answer when it would cost more than this many force evaluations.
const MOST_COST: f64 = 3e7;

/// An answer in which more springs pass the length zero is not confirmed.
const MOST_REVERSED: usize = 4;

/// Whether an answer can be relied on.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// Two runs that could disagree agree, or what a run's own steps neglect is far below what was asked for; and steps resolve what moves: the error is
    /// below that.
    Confirmed,
    /// It could not be confirmed, for the reason given.
    Unconfirmed(String),
    /// The search was interrupted; the answer is the best so far.
    Interrupted,
}

/// The last run of a search, and what is known of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer<R> {
    /// Method, stiffness and solver.
    pub configuration: Configuration,
    /// Step or tolerance.
    pub pace: Pace,
    /// The state at the end.
    pub state: State,
    /// Steps done.
    pub steps: u64,
    /// Work and residuals of the run.
    pub statistics: Statistics,
    /// The linear solver.
    pub solver: SolverReport,
    /// Estimated relative position error; `None` where there is nothing to compare with.
    pub estimated_error: Option<f64>,
    /// Whether it can be relied on.
    pub verdict: Verdict,
    /// How far positions can be predicted, where that ends before the run does.
    pub horizon: Option<Horizon>,
    /// [Cost](crate::linear::CostModel) of the run.
    pub cost: f64,
    /// What everything has cost.
    pub total_cost: f64,
    /// Runs done, this one included.
    pub runs: u32,
    /// What was recorded of the run.
    pub records: R,
}

pub(super) struct Search<'s, A: Audience> {
    pub task: &'s Task<'s>,
    pub requirement: &'s Requirement,
    audience: &'s mut A,
    spent: f64,
    runs: u32,
    /// What is left to do after the run at hand, at most, as far as can be seen.
    pub left: f64,
    /// The longest step of all runs of one step length, in s.
    longest: f64,
    /// What the steps of the last completed run have estimated of their errors, relative to the extent.
    local_errors: f64,
    /// The last completed run.
    latest: Option<Attempt<A::Records>>,
    /// The run with the least estimate of its error, and that.
    best: Option<(Attempt<A::Records>, f64)>,
    pub horizon: Option<Horizon>,
}

/// How a run went that was to be compared with others.
pub(super) enum Went {
    /// To its end.
    Well(Course, Run),
    /// Wrong: steps too long, a matrix that cannot be solved with.
    Wrong,
    /// Beyond its limit.
    TooFar,
    /// Not to its end, on request.
    Stopped,
}

/// Figures of a completed run.
#[derive(Debug, Clone, Copy)]
pub(super) struct Run {
    pub cost: f64,
    pub steps: u64,
    /// What steps have estimated of their errors, added up, relative to the extent at the end; for methods that estimate them.
    pub local_errors: f64,
    /// The amplitude of what the energy that appeared or vanished would be in vibrations of one radian a step, relative to the extent.
    pub strayed: f64,
    /// Whether forces have jumped on the way: those of springs that pass the length zero.
    pub jumps: bool,
    /// What it says of its error.
    pub own: Own,
}

impl<'s, A: Audience> Search<'s, A> {
    pub fn new(task: &'s Task<'s>, requirement: &'s Requirement, audience: &'s mut A) -> Self {
        Self {
            task,
            requirement,
            audience,
            spent: 0.0,
            runs: 0,
            left: 0.0,
            longest: 0.0,
            local_errors: 0.0,
            latest: None,
            best: None,
            horizon: None,
        }
    }

    /// Enters what something beside runs has cost.
    pub fn spend(&mut self, cost: f64) {
        self.spent += cost;
    }

    /// What everything has cost so far.
    #[cfg(test)]
    pub fn spent(&self) -> f64 {
        self.spent
    }

    /// Whether a run of this cost may be begun.
    pub fn affords(&self, cost: f64) -> bool {
        self.spent + cost <= MOST_COST
    }

    /// Whether nobody has asked to stop.
    pub fn goes_on(&self) -> bool {
        (self.task.go_on)()
    }

    /// Makes a run that may be the answer.
    pub fn run(&mut self, configuration: Configuration, pace: Pace, limit: f64) -> Result<Went> {
        self.run_for(Purpose::Answer, configuration, pace, limit)
    }

    /// Makes a run.
    pub fn run_for(&mut self, purpose: Purpose, configuration: Configuration, pace: Pace, limit: f64) -> Result<Went> {
        let doing = describe(&configuration, pace);
        let (before, left) = (self.spent, self.left);
        let mut progress = |audience: &mut A, part: f64, cost: f64| {
            let rest = if part > 0.0 { cost * (1.0 / part - 1.0) } else { 0.0 };
            audience.progress(&SearchProgress { doing: &doing, part, spent: before + cost, left: left + rest });
        };
        let limit = limit.min(MOST_COST - self.spent);
        if let Pace::Step(dt) = pace {
            self.longest = self.longest.max(dt);
        }
        let tried =
            attempt(self.task, configuration, pace, purpose, [limit, self.longest], self.audience, &mut progress)?;
        let Tried { attempt, status, cost, is_too_expensive, local_errors, strayed, own } = tried;
        self.runs += 1;
        self.spent += cost;
        let Some(mut attempt) = attempt else {
            return Ok(match status {
                Status::Interrupted => Went::Stopped,
                _ if is_too_expensive => Went::TooFar,
                _ => Went::Wrong,
            });
        };
        let course = std::mem::take(&mut attempt.course);
        let local_errors = local_errors / extent(course.end(), &self.task.start.positions);
        let run = Run { cost, steps: attempt.steps, local_errors, strayed, jumps: attempt.reversed > 0, own };
        self.local_errors = local_errors;
        self.latest = Some(attempt);
        Ok(Went::Well(course, run))
    }

    /// Says what is known of the error of the run made last. Where runs came out the same, as those whose steps are all cut by kinks, it is what
    /// their steps have estimated themselves. One that has what was asked for goes before all earlier ones, also those that are said to err by
    /// less: they were not believed.
    pub fn estimate(&mut self, error: f64) {
        let error = if error == 0.0 { self.local_errors.min(self.requirement.accuracy) } else { error };
        let suffices = error <= self.requirement.accuracy;
        if (suffices || self.best.as_ref().is_none_or(|(_, least)| error <= *least))
            && let Some(latest) = self.latest.take()
        {
            self.best = Some((latest, error));
        }
    }

    /// The answer; `None` where no run came to its end.
    pub fn answer(self, verdict: Verdict) -> Option<Answer<A::Records>> {
        let Self { spent, runs, latest, best, horizon, .. } = self;
        let best = best.map(|(attempt, error)| (attempt, Some(error)));
        let (attempt, estimated_error) = best.or(latest.map(|attempt| (attempt, None)))?;
        let Attempt { configuration, pace, state, steps, statistics, cost, solver, reversed, records, .. } = attempt;
        let verdict = if reversed > MOST_REVERSED && verdict == Verdict::Confirmed {
            Verdict::Unconfirmed(format!("{reversed} springs pass the length zero, where their forces jump"))
        } else {
            verdict
        };
        Some(Answer {
            configuration,
            pace,
            state,
            steps,
            statistics,
            solver,
            estimated_error: estimated_error.filter(|error| error.is_finite()),
            verdict,
            horizon,
            cost,
            total_cost: spent,
            runs,
            records,
        })
    }

    pub fn difference(&self, fine: &Course, coarse: &Course) -> Difference {
        fine.compared_with(coarse, &self.task.start.positions)
    }
}

/// A configuration and its pace in words.
pub(super) fn describe(configuration: &Configuration, pace: Pace) -> String {
    let name = configuration.method.name();
    match pace {
        Pace::Step(dt) => format!("{name} with dt = {dt:.3e} s"),
        Pace::Adaptive { rtol, .. } => format!("{name} with rtol = {rtol:.1e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::price::of;
    use super::super::samples::Grid;
    use super::*;
    use crate::integrate::Method;
    use crate::linear::CostModel;
    use crate::system::fixtures::oscillator;

    /// Of three runs, by their estimates: what suffices is the answer when it comes last, and otherwise the least.
    #[test]
    fn the_run_that_is_believed_is_the_answer() {
        let (system, start) = oscillator();
        let (duration, interval) = (1.0, 0.5);
        let grid = Grid::new(duration, interval, system.particles());
        let task =
            Task { system: &system, start: &start, duration, costs: CostModel::of(&system), grid, go_on: &|| true };
        let (method, stiffness, solver, par) = (None, None, None, faer::Par::Seq);
        let requirement = Requirement { accuracy: 1e-2, duration, interval, par, method, stiffness, solver };
        for (estimates, expected) in
            [([3e-2, 8e-3, 9e-3], 30), ([3e-2, 8e-3, 1.1e-2], 20), ([2e-2, 3e-2, 4e-2], 10), ([2e-2, 3e-2, 2e-2], 30)]
        {
            let mut audience = ();
            let mut search = Search::new(&task, &requirement, &mut audience);
            for (steps, estimate) in [10.0, 20.0, 30.0].into_iter().zip(estimates) {
                search.run(of(Method::Verlet), Pace::Step(duration / steps), f64::INFINITY).unwrap();
                search.estimate(estimate);
            }
            assert_eq!(search.answer(Verdict::Confirmed).unwrap().steps, expected, "{estimates:?}");
        }
    }
}
