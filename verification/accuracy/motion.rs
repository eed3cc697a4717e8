//! The cost of answers on one scene, and the cheapest single run that would have done.

use crate::commands::Timed;
use crate::runs::Runs;
use crate::study::reference::Reference;
use crate::timing::shortest;
use cpu_time::ThreadTime;
use sprung::accuracy::{
    AccuracyOptions, Configuration, StepControl, Verdict, relative_position_error, run_to_accuracy, trial,
};
use sprung::integrate::{Equations, ImplicitOptions, Method, Status, StiffnessPolicy};
use sprung::linear::{CostModel, SolverChoice, SolverOptions};
use sprung::{State, Stiffness, System};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::error::Error;

pub const ACCURACIES: [f64; 6] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6];

/// A reference must be better than the accuracy by so much to say what has it.
const TELLING: f64 = 0.1;

/// Steps of the sweep to a power of two, and tolerances to a decade.
const PER_OCTAVE: f64 = 3.0;
const PER_DECADE: f64 = 3.0;

/// Steps of the coarsest run.
const FEWEST_STEPS: f64 = 4.0;

/// The finest tolerance.
const FINEST: f64 = 1e-11;

/// A single run that is good enough: what it costs.
#[derive(Debug, Clone)]
struct Single {
    configuration: Configuration,
    pace: StepControl,
    cost: f64,
}

/// A scene to be simulated, and how it ends.
pub struct Motion<'a> {
    pub system: &'a System,
    pub start: &'a State,
    pub duration: f64,
    pub costs: CostModel,
    pub reference: &'a Reference,
    pub commands: Option<Timed<'a>>,
    pub says_runs: bool,
}

/// An answer beside the cheapest single run.
pub struct Row {
    pub accuracy: f64,
    pub method: &'static str,
    pub estimate: Option<f64>,
    pub confirmed: bool,
    pub error: f64,
    pub cost: f64,
    pub total: f64,
    /// The cheapest run, and its cost.
    pub cheapest: String,
    pub least: f64,
    /// The cost of the cheapest from which on all finer runs of its ladder are good enough too.
    pub least_for_sure: f64,
    /// The time of the search over that of the cheapest run alone.
    pub slower: f64,
    /// The time of the whole command over that of the command that makes the cheapest run.
    pub command_slower: Option<f64>,
}

/// Every way to run: methods, each with its stiffness policies and solvers, with steps of one length and adaptive ones.
fn ways() -> Vec<(Configuration, bool)> {
    let mut ways = Vec::new();
    let explicit_first = |method: &Method| method.is_implicit();
    let mut methods = Method::ALL.to_vec();
    methods.sort_by_key(explicit_first);
    for method in methods {
        let mut options = vec![ImplicitOptions::default()];
        if method.is_implicit() {
            for solver in [SolverChoice::Llt, SolverChoice::Cg] {
                let linear = SolverOptions { solver, ..SolverOptions::default() };
                options.push(ImplicitOptions { linear, ..ImplicitOptions::default() });
            }
        }
        if matches!(method.equations(), Equations::Linear | Equations::Nonlinear) {
            for stiffness in [Stiffness::Tension, Stiffness::Axial] {
                let stiffness = StiffnessPolicy::Always(stiffness);
                options.push(ImplicitOptions { stiffness, ..ImplicitOptions::default() });
            }
        }
        for options in options {
            ways.push((Configuration { method, options }, false));
            if method.estimates_errors() {
                ways.push((Configuration { method, options }, true));
            }
        }
    }
    ways
}

impl Motion<'_> {
    fn error(&self, state: &State) -> f64 {
        relative_position_error(&state.positions, &self.reference.points(), &self.start.positions)
    }

    fn asks(&self) -> Vec<f64> {
        ACCURACIES.into_iter().filter(|accuracy| self.reference.error <= TELLING * accuracy).collect()
    }

    fn options(&self, accuracy: f64) -> AccuracyOptions {
        let (method, stiffness, solver) = (None, None, None);
        // As the command does where no step is given.
        let interval = self.duration / 600.0;
        let duration = self.duration;
        AccuracyOptions { accuracy, duration, interval, par: faer::Par::Seq, method, stiffness, solver }
    }

    /// Improves on the cheapest run of every accuracy, `best`, which begins with the runs that are answers: nothing that costs more
    /// than all of them is of use. `sure` gets the cost of the cheapest of which finer runs are good enough too.
    fn sweep(&self, best: &mut BTreeMap<usize, Single>, sure: &mut BTreeMap<usize, f64>) -> Result<(), Box<dyn Error>> {
        let asks = self.asks();
        for (configuration, adaptive) in ways() {
            // Costs and errors, infinite where a run does not come to its end.
            let mut ladder: Vec<(f64, f64)> = Vec::new();
            // A tolerance of one is none.
            for j in u32::from(adaptive).. {
                let most = best.values().map(|single| single.cost).fold(0.0, f64::max);
                let pace = if adaptive {
                    StepControl::Adaptive { rtol: 10f64.powf(-f64::from(j) / PER_DECADE), first_step: None }
                } else {
                    let steps = FEWEST_STEPS * (f64::from(j) / PER_OCTAVE).exp2();
                    StepControl::Step(self.duration / steps.ceil())
                };
                let over = match pace {
                    StepControl::Adaptive { rtol, .. } => rtol < FINEST,
                    StepControl::Step(dt) => self.duration / dt > most,
                };
                if over {
                    break;
                }
                // Every step costs an evaluation at least.
                let left = Cell::new(most);
                let go_on = || {
                    left.set(left.get() - 1.0);
                    left.get() > 0.0
                };
                let run = trial(self.system, self.start, &configuration, pace, self.duration, &go_on)?;
                let cost = self.costs.cost(&run.statistics.work, run.factor);
                let error = if run.status == Status::Completed { self.error(&run.state) } else { f64::INFINITY };
                if cost <= most {
                    ladder.push((cost, error));
                }
                if error.is_finite() {
                    for (ask, _) in asks.iter().enumerate().filter(|(_, accuracy)| error <= **accuracy) {
                        if best.get(&ask).is_none_or(|single| cost < single.cost) {
                            best.insert(ask, Single { configuration, pace, cost });
                        }
                    }
                }
                if cost > most {
                    break;
                }
            }
            for (ask, accuracy) in asks.iter().enumerate() {
                let cheapest = ladder.iter().rev().take_while(|(_, error)| error <= accuracy).last();
                if let (Some((cost, _)), Some(least)) = (cheapest, sure.get_mut(&ask)) {
                    *least = least.min(*cost);
                }
            }
        }
        Ok(())
    }

    /// Answers of all accuracies that the reference can tell.
    pub fn rows(&self) -> Result<Vec<Row>, Box<dyn Error>> {
        let (mut best, mut answers) = (BTreeMap::new(), Vec::new());
        for (ask, accuracy) in self.asks().into_iter().enumerate() {
            let options = self.options(accuracy);
            let mut runs = Runs::new(self.says_runs);
            let Some(found) = run_to_accuracy(self.system, self.start, &options, &mut runs, &|| true)? else {
                continue;
            };
            let error = self.error(&found.state);
            if self.says_runs {
                runs.say();
                eprintln!("    {:>9.0}  in all for {accuracy:e}", found.total_cost);
            }
            // The answer itself is a single run.
            let cost = if error <= accuracy { found.cost } else { found.total_cost };
            best.insert(ask, Single { configuration: found.configuration, pace: found.control, cost });
            answers.push((ask, accuracy, found, error));
        }
        let mut sure = best.iter().map(|(ask, single)| (*ask, single.cost)).collect();
        self.sweep(&mut best, &mut sure)?;
        let mut rows = Vec::new();
        for (ask, accuracy, found, error) in answers {
            let Some(Single { configuration, pace, cost }) = best.get(&ask).cloned() else { continue };
            let options = self.options(accuracy);
            let searched = || run_to_accuracy(self.system, self.start, &options, &mut (), &|| true).map(|_| ());
            let ran = || trial(self.system, self.start, &configuration, pace, self.duration, &|| true).map(|_| ());
            let slower = shortest(|| time(searched))? / shortest(|| time(ran))?;
            let command_slower = self.commands.map(|timed| timed.slower(accuracy, &configuration, pace)).transpose()?;
            let pace = match pace {
                StepControl::Step(_) => "",
                StepControl::Adaptive { .. } => " --rtol",
            };
            rows.push(Row {
                accuracy,
                method: found.configuration.method.name(),
                estimate: found.estimated_error,
                confirmed: found.verdict == Verdict::Confirmed,
                error,
                cost: found.cost,
                total: found.total_cost,
                cheapest: format!("{}{pace}", configuration.method.name()),
                least: cost,
                least_for_sure: sure.get(&ask).copied().unwrap_or(cost),
                slower,
                command_slower,
            });
        }
        Ok(rows)
    }
}

/// In s.
fn time(work: impl FnOnce() -> sprung::Result<()>) -> sprung::Result<f64> {
    let clock = ThreadTime::now();
    work()?;
    Ok(clock.elapsed().as_secs_f64())
}
