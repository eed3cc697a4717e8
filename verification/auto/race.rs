//! One cell of the grid: the same 30 steps with every solver.

use cpu_time::ThreadTime;
use sprung::integrate::{ImplicitOptions, Method};
use sprung::linear::{PreconditionerKind, SolverChoice, SolverOptions, Tolerance};
use sprung::{State, System};

/// Steps of a run, how many of the last count as those after its first, and how often it is repeated.
const STEPS: usize = 30;
const LAST: usize = 15;
const REPEATED: usize = 2;

/// A solver that takes more than this many times the time of the fastest is not followed to its end.
const SLOW: f64 = 3.0;

/// What is asked of solvers.
#[derive(Clone, Copy)]
pub struct Cell {
    pub kind: &'static str,
    pub particles: usize,
    pub dt: f64,
    pub tolerance: f64,
}

/// What a solver took, in s of its thread.
#[derive(Clone)]
pub struct Time {
    pub solver: String,
    /// The median of the last steps.
    pub step: f64,
    /// All of the run.
    pub whole: f64,
}

/// A cell, and what every solver took.
pub struct Raced {
    pub cell: Cell,
    pub auto: Time,
    /// What it solved with at the end.
    pub chosen: String,
    /// Those that a user could have asked for, of which one is the fastest.
    pub others: Vec<Time>,
}

impl Cell {
    fn configurations() -> Vec<(String, SolverChoice, Option<PreconditionerKind>)> {
        let with = |kind: PreconditionerKind| (format!("cg {}", kind.name()), SolverChoice::Cg, Some(kind));
        let mut all = vec![("llt".into(), SolverChoice::Llt, None)];
        all.extend(
            [PreconditionerKind::BlockJacobi, PreconditionerKind::Multigrid, PreconditionerKind::None].map(with),
        );
        all
    }

    /// The times of one solver; `None` where it fails or takes longer than the limit.
    fn time(
        &self,
        system: &System,
        start: &State,
        options: SolverOptions,
        limit: f64,
    ) -> sprung::Result<Option<(Vec<f64>, String)>> {
        let mut shortest = vec![f64::INFINITY; STEPS + 1];
        let mut name = String::new();
        for _ in 0..REPEATED {
            let mut state = start.clone();
            let before = ThreadTime::now();
            let options = ImplicitOptions { linear: options, ..ImplicitOptions::default() };
            let mut stepper = Method::LinearBackwardEuler.stepper(system, &state, &options)?;
            let mut times = vec![before.elapsed().as_secs_f64()];
            for _ in 0..STEPS {
                let before = ThreadTime::now();
                if stepper.step(&mut state, self.dt).is_err() {
                    return Ok(None);
                }
                times.push(before.elapsed().as_secs_f64());
                if times.iter().sum::<f64>() > limit {
                    return Ok(None);
                }
            }
            let solver = stepper.linear_solver();
            name = solver.map_or(String::new(), |solver| {
                [Some(solver.name()), solver.preconditioner()].into_iter().flatten().collect::<Vec<_>>().join(" ")
            });
            shortest.iter_mut().zip(times).for_each(|(shortest, time)| *shortest = shortest.min(time));
        }
        Ok(Some((shortest, name)))
    }

    /// Every solver in turn, those first that are often fast.
    pub fn race(self, system: &System, start: &State) -> sprung::Result<Raced> {
        let options = SolverOptions { tolerance: Tolerance::Fixed(self.tolerance), ..SolverOptions::default() };
        let of = |solver: &str, times: &[f64]| {
            let mut last = times[times.len() - LAST..].to_vec();
            last.sort_by(f64::total_cmp);
            Time { solver: solver.to_owned(), step: last[LAST / 2], whole: times.iter().sum() }
        };
        let Some((times, chosen)) = self.time(system, start, options, f64::INFINITY)? else {
            return Err(sprung::Error::Unsupported(format!("a step of {} breaks down", self.kind)));
        };
        let auto = of("auto", &times);
        let mut limit = SLOW * auto.whole;
        let mut others = Vec::new();
        for (name, solver, preconditioner) in Self::configurations() {
            let options = SolverOptions { solver, preconditioner, ..options };
            if let Some((times, _)) = self.time(system, start, options, limit)? {
                let time = of(&name, &times);
                limit = limit.min(SLOW * time.whole);
                others.push(time);
            }
        }
        Ok(Raced { cell: self, auto, chosen, others })
    }
}

impl Raced {
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
        let Cell { kind, particles, dt, tolerance } = self.cell;
        let [(step, best), (whole, best_whole)] = self.ratios();
        format!(
            "| {kind} {particles} | {dt:.0e} | {tolerance:.0e} | {} | {:.3} | {step:.2} | {best} | {whole:.2} | {best_whole} |",
            self.chosen,
            1e3 * self.auto.step,
        )
    }
}
