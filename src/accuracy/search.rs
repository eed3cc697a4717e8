//! The search for an answer: a run, then one at least twice as fine, until both agree as the order and the propagated error say.

use super::trial::adaptive_stepper;
use super::{
    Configuration, Observer, SearchProgress, SpectralRadius, StepControl, default_method, extent,
    relative_position_error,
};
use crate::error::{Result, significant};
use crate::integrate::{
    AdaptiveOptions, ErrorIndicators, ImplicitOptions, Method, Monitor, MonitorOptions, Outcome, OutputTimes, Sampler,
    Schedule, Statistics, Status, StiffnessPolicy, TimeStepper, percent, run_adaptive_monitored, run_monitored,
};
use crate::linear::{CostModel, FactorReport, LinearSolver, SolverChoice, SolverOptions};
use crate::rigid::rigidly_aligned;
use crate::system::{State, System};
use faer::Par;
use std::ops::ControlFlow;

mod candidate;
#[cfg(test)]
mod tests;

use candidate::{Candidate, FINER};

/// The accuracy required of an answer, and the choices of the search.
#[derive(Debug, Clone, Copy)]
pub struct AccuracyOptions {
    /// R, the largest [relative position error](super::relative_position_error) at the end.
    pub accuracy: f64,
    /// Length of the motion, in s.
    pub duration: f64,
    /// The interval at which the answer is recorded, in s.
    pub interval: f64,
    /// Parallelism of the factorizations.
    pub par: Par,
    /// The only method, where one is given.
    pub method: Option<Method>,
    /// The only stiffness policy, where one is given.
    pub stiffness: Option<StiffnessPolicy>,
    /// The only linear solver, where one is given.
    pub solver: Option<SolverChoice>,
}

/// The verdict on an answer's accuracy.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// Two runs and the propagated error agree on the accuracy required.
    Confirmed,
    /// It could not be confirmed, for the reason given.
    Unconfirmed(String),
    /// The search was interrupted; the answer is the best so far.
    Interrupted,
}

/// The linear solver of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct SolverReport {
    /// Its name; `none` for a method without matrices.
    pub name: &'static str,
    /// The preconditioner's name; `none` where there is none.
    pub preconditioner: &'static str,
    /// The reason for this solver, in words, where the program chose it.
    pub choice: Option<String>,
    /// The factor, where there was one.
    pub factor: Option<FactorReport>,
}

/// The last run of a search, and its error.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer<R> {
    /// Method, stiffness and solver.
    pub configuration: Configuration,
    /// Step or tolerance.
    pub control: StepControl,
    /// The state at the end.
    pub state: State,
    /// Steps done.
    pub steps: u64,
    /// Work and residuals of the run.
    pub statistics: Statistics,
    /// The linear solver.
    pub solver: SolverReport,
    /// Estimated relative position error; `None` where nothing is known of it.
    pub estimated_error: Option<f64>,
    /// The verdict on its accuracy.
    pub verdict: Verdict,
    /// The time, in s, until which positions are predictable to the accuracy, where that is before the end.
    pub predictable_until: Option<f64>,
    /// The largest displacement from the start in the extent of the scene; of a scene that nothing holds, rigid motion apart.
    pub motion: f64,
    /// [Cost](crate::linear::CostModel) of the run, in force evaluations.
    pub cost: f64,
    /// Cost of all runs.
    pub total_cost: f64,
    /// Number of runs, this one included.
    pub runs: u32,
    /// The records of the run.
    pub records: R,
}

impl<R> Answer<R> {
    /// The run and its error in one line.
    pub fn reason(&self, accuracy: f64) -> String {
        let Self { configuration, control, cost, total_cost, runs, .. } = self;
        let error = match self.estimated_error {
            Some(error) => format!("an error of about {}, {} required", percent(error), percent(accuracy)),
            None => "an unknown error".into(),
        };
        let run = describe(configuration, *control);
        format!(
            "{run} ends with {error}: {cost:.0} force evaluations, {total_cost:.0} in all, of {runs} {}",
            if *runs == 1 { "run" } else { "runs" }
        )
    }

    /// Reasons not to rely on the answer.
    pub fn warnings(&self, accuracy: f64) -> Vec<String> {
        let required = percent(accuracy);
        let known = self.estimated_error.map_or_else(
            || "nothing is known of its error".into(),
            |error| format!("the best answer is wrong by about {}", percent(error)),
        );
        let verdict = match (&self.verdict, self.predictable_until) {
            (Verdict::Confirmed, _) => None,
            (Verdict::Interrupted, _) => Some(format!("interrupted: {known}")),
            (Verdict::Unconfirmed(why), Some(until)) => Some(format!(
                "an accuracy of {required} could not be confirmed, {why}: positions are predictable to {required} until about {} s",
                significant(until, 3)
            )),
            (Verdict::Unconfirmed(why), None) => {
                Some(format!("an accuracy of {required} could not be confirmed, {why}: {known}"))
            }
        };
        // An error of a tenth of the motion hardly resolves it.
        let small = (self.motion > 0.0 && LINEAR * self.motion < accuracy).then(|| {
            format!(
                "the motion itself is {} of the extent: an accuracy of {required} says little of it",
                percent(self.motion)
            )
        });
        verdict.into_iter().chain(small).collect()
    }
}

/// Nine in ten propagated errors are within so many times of the truth (`verification/study.md`): they do not explain a larger difference.
const AGREEMENT: f64 = 3.0;

/// The relative error from which the linear equation of propagated errors does not hold, and below which an answer resolves a motion.
const LINEAR: f64 = 0.1;

/// The search goes on for so many times the cost of the last run whose finer steps [paid](Candidate::pays). A choice.
const WORTH: f64 = 10.0;

/// Runs until the answer is confirmed, or finer steps of ten times the cost do not make errors smaller. `None` where no run comes to its end. Where
/// `go_on` returns `false` the search ends with the best answer so far, as interrupted.
///
/// # Errors
/// Coincident ends of a spring in `start`; a matrix that is too large; an error of the observer.
///
/// # Examples
/// ```
/// use sprung::accuracy::{AccuracyOptions, Verdict, run_to_accuracy};
///
/// # let mut builder = sprung::SystemBuilder::new();
/// # [0.0, 1.0].map(|x| builder.particle([x, 0.0, 0.0], 1.0));
/// # builder.hold(0).spring(0, 1, sprung::Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// let (system, start) = builder.build()?;
/// let options = AccuracyOptions {
///     accuracy: 1e-3,
///     duration: 2.0,
///     interval: 0.1,
///     par: sprung::faer::Par::Seq,
///     method: None,
///     stiffness: None,
///     solver: None,
/// };
/// let answer = run_to_accuracy(&system, &start, &options, &mut (), &|| true)?.ok_or("no answer")?;
/// assert_eq!(answer.verdict, Verdict::Confirmed);
/// // A particle of 1 kg on 10 N/m, 1 m from rest.
/// let exact = 2.0 - (2.0 * 10.0_f64.sqrt()).cos();
/// assert!((answer.state.positions[1].x - exact).abs() < 1e-3 * exact);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn run_to_accuracy<O: Observer>(
    system: &System,
    start: &State,
    options: &AccuracyOptions,
    observer: &mut O,
    go_on: &dyn Fn() -> bool,
) -> Result<Option<Answer<O::Records>>> {
    let accuracy = options.accuracy;
    let mut search =
        Search { system, start, options, observer, go_on, costs: CostModel::of(system), spent: 0.0, runs: 0 };
    let mut candidate = search.first_candidate()?;
    let (mut failures, mut worth) = (0, f64::INFINITY);
    let mut best: Option<(Candidate, Answer<O::Records>)> = None;
    let (mut until, mut before, mut apart_before) = (None, None, None);
    // Runs that stay apart, however small the propagated errors: these do not tell the truth.
    let mut stay_apart = false;
    let verdict = loop {
        let coarse = match search.run(candidate, true)? {
            Some(run) => run,
            None if !go_on() => break Verdict::Interrupted,
            // A choice: six runs that break down, each with steps four times as fine.
            None if failures < 6 => {
                failures += 1;
                candidate = candidate.finer(FINER * FINER);
                continue;
            }
            None => break Verdict::Unconfirmed("finer runs break down".into()),
        };
        let estimate = coarse.estimated_error.unwrap_or(f64::INFINITY);
        // With `e' ≤ e/i` two runs are at least `e − e' ≥ (i − 1) e'` apart.
        let improvement = candidate.improvement(FINER);
        let allowed = accuracy.max(LINEAR.min(accuracy * (improvement - 1.0)));
        until = coarse.predictable_until;
        if candidate.pays(estimate, before) && !stay_apart {
            worth = WORTH * coarse.cost;
        }
        before = Some((candidate, estimate));
        if estimate <= allowed {
            let second = candidate.finer(FINER);
            let Some(mut fine) = search.run(second, false)? else {
                best = Some((candidate, coarse));
                if !go_on() {
                    break Verdict::Interrupted;
                }
                candidate = candidate.finer(FINER * FINER);
                continue;
            };
            let apart = relative_position_error(&fine.state.positions, &coarse.state.positions, &start.positions);
            let error = (apart / (improvement - 1.0)).max(estimate / improvement);
            let agrees = apart <= AGREEMENT * estimate || apart <= accuracy / AGREEMENT;
            if agrees && error <= accuracy {
                fine.estimated_error = Some(error);
                (best, until) = (Some((second, fine)), None);
                break Verdict::Confirmed;
            }
            stay_apart |= apart_before.is_some() && !second.pays(apart, apart_before);
            apart_before = Some((second, apart));
            fine.estimated_error = Some(apart.max(error));
            best = Some((second, fine));
            worth = worth.min(WORTH * search.spent);
            candidate = candidate.finer(FINER * FINER);
        } else {
            worth = worth.min(WORTH * coarse.cost);
            let next = search.refined(candidate, coarse.estimated_error, estimate / allowed);
            if next.configuration.method != candidate.configuration.method {
                // The first run of another method sets it anew.
                worth = f64::INFINITY;
            }
            best = Some((candidate, coarse));
            candidate = next;
        }
        let Some((last, run)) = &best else { continue };
        if accuracy < last.rounding(run.steps) {
            break Verdict::Unconfirmed("as rounding outweighs what shorter steps gain".into());
        } else if last.is_at_the_limit() {
            break Verdict::Unconfirmed("as the motion magnifies the errors of its steps".into());
        } else if run.cost * last.cost_ratio(&candidate) > worth {
            break Verdict::Unconfirmed("as shorter steps hardly make its error smaller".into());
        }
    };
    Ok(best.map(|(_, run)| Answer {
        estimated_error: run.estimated_error.filter(|error| error.is_finite()),
        verdict,
        predictable_until: until,
        total_cost: search.spent,
        runs: search.runs,
        ..run
    }))
}

struct Search<'s, O> {
    system: &'s System,
    start: &'s State,
    options: &'s AccuracyOptions,
    observer: &'s mut O,
    go_on: &'s dyn Fn() -> bool,
    costs: CostModel,
    spent: f64,
    runs: u32,
}

impl<O: Observer> Search<'_, O> {
    fn configuration(&self, method: Method) -> Configuration {
        let AccuracyOptions { par, stiffness, solver, .. } = *self.options;
        let ImplicitOptions { stiffness: policy, linear } = ImplicitOptions::default();
        let linear = SolverOptions { solver: solver.unwrap_or(linear.solver), par, ..linear };
        Configuration { method, options: ImplicitOptions { stiffness: stiffness.unwrap_or(policy), linear } }
    }

    fn adaptive(&self, method: Method) -> Candidate {
        let rtol = self.options.accuracy.min(1e-2);
        let control = StepControl::Adaptive { rtol, first_step: None };
        Candidate { configuration: self.configuration(method), control }
    }

    /// The method and the step or tolerance of the first run: guesses, which decide about the work and not about the verdict.
    fn first_candidate(&self) -> Result<Candidate> {
        let Self { system, start, options, .. } = self;
        let AccuracyOptions { accuracy, duration, .. } = **options;
        let method = match options.method {
            Some(method) => method,
            None => match default_method(system, start, duration)?.0 {
                // With its longest stable steps it has two or three digits where slow motions matter.
                Method::Dop853 if accuracy >= 1e-3 => Method::Verlet,
                method => method,
            },
        };
        if method.estimates_errors() {
            return Ok(self.adaptive(method));
        }
        let dt = if method.is_implicit() {
            duration / 200.0
        } else {
            // Springs that stretch lower the limit of stability.
            0.7 * SpectralRadius::at(system, start)?.verlet_limit()
        };
        let control = StepControl::Step(dt.min(duration / 8.0));
        Ok(Candidate { configuration: self.configuration(method), control })
    }

    /// The candidate after one with this propagated error, `excess` times the error allowed.
    fn refined(&self, candidate: Candidate, error: Option<f64>, excess: f64) -> Candidate {
        let order = f64::from(candidate.configuration.method.order());
        let is_saturated = error.is_none_or(|error| error > LINEAR);
        let needed = (2.0 * excess).powf(1.0 / order);
        // Steps that cost far more are only worth it where finer ones pay, which a run between tells.
        let needed = if is_saturated || needed > WORTH { FINER * FINER } else { needed };
        let is_free = self.options.method.is_none() && candidate.configuration.method == Method::Verlet;
        if is_free && needed >= FINER * FINER {
            self.adaptive(Method::Dop853)
        } else {
            candidate.finer(needed.max(FINER))
        }
    }

    /// Makes a run, with the propagated error of its steps where that is asked for; `None` where it does not come to its end.
    fn run(&mut self, candidate: Candidate, propagates: bool) -> Result<Option<Answer<O::Records>>> {
        let Self { system, start, options, go_on, .. } = *self;
        let Candidate { configuration: Configuration { method, options: implicit }, control } = candidate;
        let AccuracyOptions { accuracy, duration, interval, .. } = *options;
        let doing = describe(&candidate.configuration, control);
        let mut state = start.clone();
        let threshold = propagates.then_some(accuracy);
        let mut monitor = Monitor::new(system, &state, MonitorOptions { threshold, stops_unstable: true })?;
        let mut records = self.observer.begin(&monitor)?;
        let (mut failed, mut motion) = (None, 0.0_f64);
        let is_free = system.prescribed().iter().next().is_none();
        let (observer, spent) = (&mut *self.observer, self.spent);
        let mut see = |number: u64, sample: &State, monitor: &Monitor| {
            let deformed = if is_free { rigidly_aligned(&start.positions, &sample.positions) } else { Vec::new() };
            let moved = if is_free { &deformed } else { &sample.positions };
            let displacement =
                moved.iter().zip(&start.positions).map(|(x, start)| (x - start).norm_squared()).sum::<f64>();
            motion = motion.max(displacement.sqrt());
            failed = observer.record(&mut records, number, sample, monitor).err();
            observer.progress(&SearchProgress { run: &doing, part: (sample.time - start.time) / duration, spent });
            if failed.is_some() || !go_on() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let (outcome, stepper): (Outcome, Box<dyn TimeStepper>) = match control {
            StepControl::Step(dt) => {
                let mut stepper = method.stepper(system, start, &implicit)?;
                let mut sampler = Sampler::new(start, interval, duration);
                let schedule = Schedule::duration(dt, duration);
                let outcome = run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, |_, state, monitor| {
                    if !go_on() {
                        return ControlFlow::Break(());
                    }
                    sampler.observe(system, state, |number, sample| see(number, sample, monitor))
                });
                (outcome, stepper)
            }
            StepControl::Adaptive { rtol, first_step } => {
                let mut stepper = adaptive_stepper(method, system, start, &implicit)?;
                let how = AdaptiveOptions {
                    duration,
                    rtol,
                    first_step,
                    sampling: OutputTimes::Every(interval),
                    part_of: None,
                };
                let outcome = run_adaptive_monitored(&mut *stepper, system, &mut state, &how, &mut monitor, &mut see);
                (outcome, stepper)
            }
        };
        failed.map_or(Ok(()), Err)?;
        let solver = stepper.linear_solver();
        let factor = solver.and_then(LinearSolver::factor);
        let statistics = *stepper.statistics();
        let cost = self.costs.cost(&statistics.work, factor.map(|factor| factor.size));
        self.spent += cost;
        self.runs += 1;
        let ErrorIndicators { estimate, predictable_until, .. } = monitor.indicators(&state);
        Ok((outcome.status() == Status::Completed).then(|| Answer {
            configuration: candidate.configuration,
            control,
            steps: outcome.steps,
            statistics,
            solver: SolverReport {
                name: solver.map_or("none", LinearSolver::name),
                preconditioner: solver.and_then(LinearSolver::preconditioner).unwrap_or("none"),
                choice: solver.and_then(LinearSolver::choice),
                factor,
            },
            estimated_error: estimate,
            verdict: Verdict::Interrupted,
            predictable_until,
            motion: motion / extent(&state.positions, &start.positions),
            cost,
            total_cost: self.spent,
            runs: self.runs,
            state,
            records,
        }))
    }
}

/// A configuration and its step or tolerance, for people.
fn describe(configuration: &Configuration, control: StepControl) -> String {
    let name = configuration.method.name();
    match control {
        StepControl::Step(dt) => format!("{name} with dt = {} s", significant(dt, 4)),
        StepControl::Adaptive { rtol, .. } => format!("{name} with rtol = {rtol:.1e}"),
    }
}
