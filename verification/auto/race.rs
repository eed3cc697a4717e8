//! One cell of the grid: the same 30 steps with every solver.

use cpu_time::ThreadTime;
use serde::{Deserialize, Serialize};
use sprung::integrate::{ImplicitOptions, Method};
use sprung::linear::{PreconditionerKind, SolverChoice, SolverOptions, Tolerance};
use sprung::{State, System};
use std::hint::black_box;
use std::time::Duration;

/// Steps of a run, and how many of the last count as those after its first.
const STEPS: usize = 30;
const LAST: usize = 15;

/// A race has so many rounds at least, and more until it takes so long.
const LEAST_ROUNDS: usize = 2;
const MOST_ROUNDS: usize = 9;
const LONG_ENOUGH: Duration = Duration::from_secs(2);

/// A solver that takes more than this many times the time of the fastest is not followed to its end.
const SLOW: f64 = 3.0;

/// The systems that solvers are given.
#[derive(Clone, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    pub kind: String,
    pub particles: usize,
    pub dt: f64,
    pub tolerance: f64,
}

/// The time of a solver, in s of its thread.
#[derive(Serialize, Deserialize)]
pub struct Time {
    pub solver: String,
    /// The median of the last steps.
    pub step: f64,
    /// All of the run.
    pub whole: f64,
}

impl Time {
    fn shorter(&mut self, again: &Self) {
        (self.step, self.whole) = (self.step.min(again.step), self.whole.min(again.whole));
    }
}

/// A cell, and what every solver took.
#[derive(Serialize, Deserialize)]
pub struct Raced {
    pub cell: Cell,
    pub auto: Time,
    /// The solver at the end.
    pub chosen: String,
    /// Those that a user could have asked for, of which one is the fastest.
    pub others: Vec<Time>,
}

/// A choice of the user: a solver, with a preconditioner where it is iterative.
struct Configuration {
    name: String,
    solver: SolverChoice,
    preconditioner: Option<PreconditionerKind>,
}

/// A configuration in the race: the shortest time of each step so far, after that of what is done before the first.
struct Runner {
    configuration: Configuration,
    shortest: Vec<f64>,
    /// The solver at the end.
    solved_with: String,
}

impl Configuration {
    fn all() -> Vec<Self> {
        let named = |name: &str, solver| Self { name: name.into(), solver, preconditioner: None };
        let cg = |kind: PreconditionerKind| Self {
            name: format!("cg {}", kind.name()),
            solver: SolverChoice::Cg,
            preconditioner: Some(kind),
        };
        let mut all = vec![named("auto", SolverChoice::Auto), named("llt", SolverChoice::Llt)];
        all.extend([PreconditionerKind::BlockJacobi, PreconditionerKind::Multigrid, PreconditionerKind::None].map(cg));
        all
    }
}

impl Runner {
    fn new(configuration: Configuration) -> Self {
        Self { configuration, shortest: vec![f64::INFINITY; STEPS + 1], solved_with: String::new() }
    }

    fn whole(&self) -> f64 {
        self.shortest.iter().sum()
    }

    fn time(&self) -> Time {
        let mut last = self.shortest[1 + STEPS - LAST..].to_vec();
        last.sort_by(f64::total_cmp);
        Time { solver: self.configuration.name.clone(), step: last[LAST / 2], whole: self.whole() }
    }

    /// Does all steps once more; `false` where one fails, as for want of memory, or they take longer than the limit.
    fn run(&mut self, cell: &Cell, system: &System, start: &State, limit: f64, round: usize) -> bool {
        // Where vectors lie in the memory decides over up to two fifths of a short step, and would be the same in every round.
        let _elsewhere = black_box(vec![0u8; 1 + 1104 * round]);
        let Configuration { solver, preconditioner, .. } = self.configuration;
        let tolerance = Tolerance::Fixed(cell.tolerance);
        let linear = SolverOptions { solver, preconditioner, tolerance, ..SolverOptions::default() };
        let options = ImplicitOptions { linear, ..ImplicitOptions::default() };
        let mut state = start.clone();
        let before = ThreadTime::now();
        let Ok(mut stepper) = Method::LinearBackwardEuler.stepper(system, &state, &options) else {
            return false;
        };
        let mut times = vec![before.elapsed().as_secs_f64()];
        for _ in 0..STEPS {
            let before = ThreadTime::now();
            if stepper.step(&mut state, cell.dt).is_err() {
                return false;
            }
            times.push(before.elapsed().as_secs_f64());
            if times.iter().sum::<f64>() > limit {
                return false;
            }
        }
        let words = stepper.linear_solver().map(|solver| [Some(solver.name()), solver.preconditioner()]);
        self.solved_with = words.into_iter().flatten().flatten().collect::<Vec<_>>().join(" ");
        self.shortest.iter_mut().zip(times).for_each(|(shortest, time)| *shortest = shortest.min(time));
        true
    }
}

impl Cell {
    /// Every solver in turn, round by round, so that what slows the machine for a while slows all of them.
    pub fn race(self, system: &System, start: &State) -> sprung::Result<Raced> {
        let begin = ThreadTime::now();
        let mut runners: Vec<Runner> = Configuration::all().into_iter().map(Runner::new).collect();
        for round in 0..MOST_ROUNDS {
            if round >= LEAST_ROUNDS && begin.elapsed() > LONG_ENOUGH {
                break;
            }
            let mut followed = Vec::new();
            for mut runner in runners {
                let fastest = followed.iter().map(Runner::whole).fold(runner.whole(), f64::min);
                let is_auto = followed.is_empty();
                let limit = if is_auto { f64::INFINITY } else { SLOW * fastest };
                if runner.run(&self, system, start, limit, round) {
                    followed.push(runner);
                } else if is_auto {
                    return Err(sprung::Error::Unsupported(format!("a step of {} breaks down", self.kind)));
                }
            }
            runners = followed;
        }
        let chosen = runners.first().map_or_else(String::new, |auto| auto.solved_with.clone());
        let mut times = runners.iter().map(Runner::time);
        let Some(auto) = times.next() else {
            return Err(sprung::Error::Unsupported(format!("no run of {} came to its end", self.kind)));
        };
        Ok(Raced { cell: self, auto, chosen, others: times.collect() })
    }
}

impl Raced {
    /// With the shorter times of the same race, run by another process: two of them differ by up to a half in short steps, whatever is repeated within
    /// each.
    pub fn shorter(&mut self, again: Self) {
        self.auto.shorter(&again.auto);
        for time in again.others {
            match self.others.iter_mut().find(|other| other.solver == time.solver) {
                Some(other) => other.shorter(&time),
                None => self.others.push(time),
            }
        }
    }

    fn fastest(&self, time: fn(&Time) -> f64) -> Option<&Time> {
        self.others.iter().min_by(|a, b| time(a).total_cmp(&time(b)))
    }

    /// Over the fastest other solver, and which that is: after the first steps, and as a whole.
    pub fn ratios(&self) -> [(f64, &str); 2] {
        [|time: &Time| time.step, |time: &Time| time.whole].map(|time: fn(&Time) -> f64| {
            self.fastest(time).map_or((0.0, "none"), |best| (time(&self.auto) / time(best), &*best.solver))
        })
    }

    /// One line.
    pub fn line(&self) -> String {
        let Cell { kind, particles, dt, tolerance } = &self.cell;
        let [(step, best), (whole, best_whole)] = self.ratios();
        format!(
            "| {kind} {particles} | {dt:.0e} | {tolerance:.0e} | {} | {:.3} | {step:.2} | {best} | {whole:.2} | {best_whole} |",
            self.chosen,
            1e3 * self.auto.step,
        )
    }
}
