//! The sweep: every configuration at every step size that fits into the time, measured against the reference.

use super::reference::ABOVE_THE_FLOOR;
use super::{Deadline, Progress, Quality, Reference};
use crate::accuracy::{Configuration, StepControl, Trial, trial};
use crate::error::Result;
use crate::integrate::{ImplicitOptions, Method, Status, StiffnessPolicy};
use crate::linear::{CostModel, SolverChoice, SolverOptions};
use crate::spring::Stiffness;
use crate::system::{State, System};
use crate::work::Work;
use faer::Par;
use serde::Serialize;
use std::time::{Duration, Instant};

/// One run of the sweep.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Run {
    /// The method's name.
    pub method: &'static str,
    /// The stiffness policy's name; `none` for a method without matrices.
    pub stiffness: &'static str,
    /// The linear solver used; `none` for a method without matrices.
    pub solver: &'static str,
    /// Tolerance of conjugate gradients; `None` for other solvers.
    pub tolerance: Option<f64>,
    /// Relative tolerance of adaptive steps; `None` for steps of one length.
    pub rtol: Option<f64>,
    /// Time step, in s; of adaptive steps the mean.
    pub dt: f64,
    /// How the run ended.
    pub status: Status,
    /// What broke it.
    pub failure: Option<String>,
    /// The [relative position error](crate::accuracy::relative_position_error) at the end time; `None` for a run that did
    /// not get there.
    pub error: Option<f64>,
    /// Other errors at the end time.
    pub quality: Option<Quality>,
    /// The shortest of `repeats` repetitions after a first one, in s; of the first where there was time for no other.
    pub wall_seconds: f64,
    /// Repetitions after the first.
    pub repeats: u32,
    /// What was done, on any machine.
    pub work: Work,
    /// The [cost](CostModel) of the work, in force evaluations.
    pub cost: f64,
}

/// What runs are made on and measured by.
pub(super) struct Bench<'s> {
    pub system: &'s System,
    pub start: &'s State,
    pub duration: f64,
    pub reference: &'s Reference,
    pub costs: CostModel,
}

/// Repetitions of a run that are timed, after a first one that warms caches up.
const REPEATS: u32 = 3;

/// A run that takes this long is not repeated: its noise is small against its length.
const LONG: Duration = Duration::from_millis(100);

impl Bench<'_> {
    /// Runs and measures; `None` when the deadline came first.
    pub fn measure(&self, configuration: &Configuration, pace: StepControl, deadline: Deadline) -> Result<Option<Run>> {
        let in_time = || deadline.allows(Duration::ZERO);
        let once = || trial(self.system, self.start, configuration, pace, self.duration, &in_time);
        let first = once()?;
        if first.status == Status::Interrupted {
            return Ok(None);
        }
        let (mut repeats, mut best) = (0, None::<Duration>);
        if first.wall < LONG {
            while repeats < REPEATS && deadline.allows(first.wall) {
                let again = once()?.wall;
                best = Some(best.map_or(again, |best| best.min(again)));
                repeats += 1;
            }
        }
        let wall = best.unwrap_or(first.wall);
        Ok(Some(self.run(configuration, pace, first, repeats, wall)))
    }

    fn run(&self, configuration: &Configuration, pace: StepControl, trial: Trial, repeats: u32, wall: Duration) -> Run {
        let completed = trial.status == Status::Completed;
        let quality = completed.then(|| Quality::of(self.system, &trial.state, &self.reference.state, self.start));
        let work = trial.statistics.work;
        let (dt, rtol) = match pace {
            StepControl::Step(dt) => (dt, None),
            StepControl::Adaptive { rtol, .. } => (self.duration / trial.steps.max(1) as f64, Some(rtol)),
        };
        let iterates = configuration.method.is_implicit() && work.factorizations == 0;
        Run {
            method: configuration.method.name(),
            stiffness: configuration.stiffness(),
            solver: trial.solver,
            tolerance: iterates.then_some(configuration.options.linear.tolerance.strictest()),
            rtol,
            dt,
            status: trial.status,
            failure: trial.failure.map(|failed| failed.failure.to_string()),
            error: quality.map(|quality| quality.error),
            quality,
            wall_seconds: wall.as_secs_f64(),
            repeats,
            work,
            cost: self.costs.cost(&work, trial.factor),
        }
    }
}

/// The configurations that a sweep compares: each method under each option that it has, by factorization, and
/// linearised backward Euler, bdf2 and the W-method by conjugate gradients too.
pub fn configurations(par: Par) -> Vec<Configuration> {
    let policies = Stiffness::ALL.map(StiffnessPolicy::Always).into_iter().chain([StiffnessPolicy::OnDemand]);
    let with = |method, stiffness, solver| {
        let linear = SolverOptions { solver, par, ..SolverOptions::default() };
        Configuration { method, options: ImplicitOptions { stiffness, linear } }
    };
    let mut all = Vec::new();
    for method in [Method::LinearBackwardEuler, Method::Bdf2, Method::W2] {
        all.extend(policies.clone().map(|policy| with(method, policy, SolverChoice::Llt)));
        all.push(with(method, StiffnessPolicy::OnDemand, SolverChoice::Cg));
    }
    let others = [
        Method::BackwardEuler,
        Method::Rodas4,
        Method::ImplicitMidpoint,
        Method::Verlet,
        Method::Dop853,
        Method::ForwardEuler,
        Method::SymplecticEuler,
    ];
    all.extend(others.map(|method| with(method, StiffnessPolicy::OnDemand, SolverChoice::Llt)));
    all
}

/// A run of a sweep has at least this many steps.
const FEWEST_STEPS: f64 = 4.0;

/// The tolerance of the first adaptive run; a quarter of it, and so on, follow: half the steps of a second-order method.
const COARSEST_TOLERANCE: f64 = 0.1;

/// A configuration on its way to smaller steps.
struct Lane {
    configuration: Configuration,
    pace: StepControl,
    last: Option<Duration>,
    open: bool,
}

/// Runs all configurations with steps halved from round to round, so that all curves are about as long when the time is
/// over. A curve ends when it reaches the error of the reference, or when its next run would not fit.
pub(super) fn sweep(
    bench: &Bench<'_>,
    dt: f64,
    par: Par,
    deadline: Deadline,
    progress: &mut dyn Progress,
) -> Result<Vec<Run>> {
    let begin = Instant::now();
    let dt = coarsest(dt, bench.duration);
    let lane = |configuration, pace| Lane { configuration, pace, last: None, open: true };
    let all = configurations(par);
    let on_demand = |c: &&Configuration| {
        c.method.estimates_errors()
            && c.options.stiffness == StiffnessPolicy::OnDemand
            && c.options.linear.solver == SolverChoice::Llt
    };
    let adaptive = StepControl::Adaptive { rtol: COARSEST_TOLERANCE, first_step: Some(dt) };
    let mut lanes: Vec<Lane> = all.iter().map(|&configuration| lane(configuration, StepControl::Step(dt))).collect();
    lanes.extend(all.iter().filter(on_demand).map(|&configuration| lane(configuration, adaptive)));
    let mut runs = Vec::new();
    while lanes.iter().any(|lane| lane.open) && deadline.allows(Duration::ZERO) {
        for lane in lanes.iter_mut().filter(|lane| lane.open) {
            if !fits(lane.last, deadline.left()) {
                lane.open = false;
                continue;
            }
            let measured = bench.measure(&lane.configuration, lane.pace, deadline)?;
            progress.at(begin.elapsed(), lane.configuration.method.name());
            let Some(run) = measured else {
                lane.open = false;
                continue;
            };
            lane.last = Some(Duration::from_secs_f64(run.wall_seconds.max(0.0)));
            let is_at_floor = |error: f64| error <= ABOVE_THE_FLOOR * bench.reference.error_estimate;
            lane.open = !run.error.is_some_and(is_at_floor);
            runs.push(run);
            lane.pace = match lane.pace {
                StepControl::Step(dt) => StepControl::Step(0.5 * dt),
                StepControl::Adaptive { rtol, first_step } => {
                    StepControl::Adaptive { rtol: 0.25 * rtol, first_step: first_step.map(|step| 0.5 * step) }
                }
            };
        }
    }
    Ok(runs)
}

/// Whether the run after one that took so long may be begun. Half the step, twice the work; a quarter of what is left must do for each.
fn fits(last: Option<Duration>, left: Duration) -> bool {
    !left.is_zero() && last.is_none_or(|last| 8 * last <= left)
}

/// The largest of dt, 2dt, 4dt, … that leaves a few steps; smaller than dt where even dt does not.
fn coarsest(dt: f64, duration: f64) -> f64 {
    let doublings = (duration / dt / FEWEST_STEPS).log2().floor();
    dt * doublings.exp2()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::fixtures;

    /// An oscillator, and where it is after this time.
    fn oscillator(duration: f64) -> (System, State, Reference) {
        let (system, start) = fixtures::oscillator();
        let mut state = start.clone();
        state.positions[1].x = 1.0 + 0.3 * duration.cos();
        (system, start, Reference { method: "exact".into(), error_estimate: 1e-4, state })
    }

    fn bench(scene: &(System, State, Reference), duration: f64) -> Bench<'_> {
        let (system, start, reference) = scene;
        Bench { system, start, duration, reference, costs: CostModel::of(system) }
    }

    fn far() -> Deadline {
        Deadline::from(Instant::now() + Duration::from_secs(7200))
    }

    /// Every curve ends with its first run that is as good as the reference, and goes there by halves, or by quarters of the tolerance.
    #[test]
    fn curves_go_by_halves_to_the_floor() {
        let scene = oscillator(1.0);
        let bench = bench(&scene, 1.0);
        let mut told = Vec::new();
        let runs = sweep(&bench, 0.01, Par::Seq, far(), &mut |_, what: &str| told.push(what.to_owned())).unwrap();
        assert_eq!(told, runs.iter().map(|run| run.method).collect::<Vec<_>>());
        let all = configurations(Par::Seq);
        assert_eq!(all.len(), 22);
        for par in [Par::Seq, Par::rayon(2)] {
            assert!(configurations(par).iter().all(|configuration| configuration.options.linear.par == par));
        }
        let mut curves: Vec<Vec<&Run>> = Vec::new();
        for run in &runs {
            let way = |run: &Run| (run.method, run.stiffness, run.solver, run.rtol.is_some());
            match curves.iter_mut().find(|curve| way(curve[0]) == way(run)) {
                Some(curve) => curve.push(run),
                None => curves.push(vec![run]),
            }
        }
        let adaptive: Vec<_> = curves.iter().filter(|curve| curve[0].rtol.is_some()).collect();
        let methods: Vec<_> = adaptive.iter().map(|curve| (curve[0].method, curve[0].solver)).collect();
        assert_eq!(methods, [("bdf2", "llt"), ("w2", "llt"), ("rodas4", "llt"), ("dop853", "none")]);
        assert_eq!(curves.len(), all.len() + adaptive.len());
        for curve in curves {
            for (round, run) in curve.iter().enumerate() {
                let is_last = round + 1 == curve.len();
                assert_eq!(run.error.unwrap() <= 3e-4, is_last, "{run:?}");
                match run.rtol {
                    // 0.01 s, doubled as long as four steps are left.
                    None => assert_eq!(run.dt, 0.16 * 0.5f64.powi(round as i32), "{run:?}"),
                    Some(rtol) => {
                        assert_eq!(rtol, 0.1 * 0.25f64.powi(round as i32), "{run:?}");
                        let first_step = Some(0.16 * 0.5f64.powi(round as i32));
                        let is_same = |c: &&Configuration| {
                            (c.method.name(), c.stiffness()) == (run.method, run.stiffness)
                                && c.options.linear.solver == SolverChoice::Llt
                        };
                        let configuration = all.iter().find(is_same).unwrap();
                        let pace = StepControl::Adaptive { rtol, first_step };
                        let alone = trial(bench.system, bench.start, configuration, pace, 1.0, &|| true).unwrap();
                        assert_eq!((alone.statistics.work, 1.0 / alone.steps as f64), (run.work, run.dt), "{run:?}");
                    }
                }
                assert_eq!(run.tolerance.is_some(), run.solver == "cg", "{run:?}");
            }
        }
    }

    /// Steps that follow an estimate have the mean for their length, and the first of them is as long as the steps of one length are: with a loose
    /// tolerance a run from a step half as long takes other steps.
    #[test]
    fn adaptive_runs_have_a_mean_step() {
        let scene = oscillator(3.0);
        let bench = bench(&scene, 3.0);
        let configuration = Configuration { method: Method::Dop853, options: ImplicitOptions::default() };
        let pace = StepControl::Adaptive { rtol: 1e-6, first_step: Some(0.1) };
        let run = bench.measure(&configuration, pace, far()).unwrap().unwrap();
        let alone = trial(bench.system, bench.start, &configuration, pace, 3.0, &|| true).unwrap();
        assert!(alone.steps > 1);
        // Far from a tenth of a second long: three more are timed.
        assert_eq!(run.repeats, 3);
        assert_eq!((run.dt, run.rtol, run.status), (3.0 / alone.steps as f64, Some(1e-6), Status::Completed));
        let over = Deadline::from(Instant::now());
        assert_eq!(bench.measure(&configuration, pace, over).unwrap(), None);
        assert!(sweep(&bench, 0.01, Par::Seq, over, &mut |_, _: &str| {}).unwrap().is_empty());
    }

    #[test]
    fn runs_may_take_a_quarter_of_the_time_that_is_left() {
        let seconds = Duration::from_secs;
        for (last, left, expected) in [
            (None, seconds(1), true),
            (None, seconds(0), false),
            (Some(seconds(0)), seconds(0), false),
            (Some(seconds(1)), seconds(8), true),
            (Some(seconds(1)), seconds(9), true),
            (Some(seconds(1)), seconds(7), false),
        ] {
            assert_eq!(fits(last, left), expected, "{last:?} {left:?}");
        }
    }

    #[test]
    fn sweeps_begin_with_a_few_steps() {
        for (dt, duration, expected) in [(0.25, 8.0, 2.0), (0.25, 7.9, 1.0), (3.0, 4.0, 0.75), (3.0, 8.0, 1.5)] {
            assert_eq!(coarsest(dt, duration), expected);
        }
    }

    /// From coarse to fine, by conjugate gradients, with the tolerance that is asked for.
    #[test]
    fn tolerances_go_by_hundreds() {
        let scene = oscillator(1.0);
        let bench = bench(&scene, 1.0);
        let runs = crate::chart::tolerance::study(&bench, Method::W2, 0.25, far()).unwrap();
        let found: Vec<_> = runs.iter().map(|run| (run.method, run.solver, run.dt, run.tolerance.unwrap())).collect();
        let expected = [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12].map(|tolerance| ("w2", "cg", 0.25, tolerance));
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            assert!((found.0, found.1, found.2) == (expected.0, expected.1, expected.2));
            assert!((found.3 / expected.3 - 1.0).abs() < 1e-12, "{found:?}");
        }
        let none = crate::chart::tolerance::study(&bench, Method::W2, 0.25, Instant::now().into()).unwrap();
        assert!(none.is_empty());
    }
}
