//! The sweep: every configuration at every step size that fits into the time, measured against the reference.

use super::reference::ABOVE_THE_FLOOR;
use super::run::Bench;
use super::{Deadline, Progress, Run};
use crate::accuracy::{Configuration, StepControl};
use crate::error::Result;
use crate::integrate::{ImplicitOptions, Method, StiffnessPolicy};
use crate::linear::{SolverChoice, SolverOptions};
use crate::spring::Stiffness;
use faer::Par;
use std::time::{Duration, Instant};

/// The configurations that a sweep compares: each method under each option that it has, and those with options by conjugate gradients too.
pub fn configurations(par: Par) -> Vec<Configuration> {
    // The options of the notes and the default; [`definiteness`](super::definiteness) compares the others too.
    let options = [Stiffness::Full, Stiffness::Tension, Stiffness::Axial].map(StiffnessPolicy::Always);
    let policies = options.into_iter().chain([StiffnessPolicy::OnDemand]);
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

struct SweepCurve {
    configuration: Configuration,
    control: StepControl,
    last: Option<Duration>,
    is_open: bool,
}

/// Runs all configurations with steps halved from round to round, so that all curves are about as long when the time is over. A curve ends when it
/// reaches the error of the reference, or when its next run would not fit. Adaptive steps have a tolerance of 0.1 first, and a quarter from round to
/// round: half the steps of a second-order method.
pub(super) fn sweep(
    bench: &Bench<'_>,
    dt: f64,
    par: Par,
    deadline: Deadline,
    progress: &mut Progress<'_>,
) -> Result<Vec<Run>> {
    let begin = Instant::now();
    let dt = coarsest(dt, bench.duration);
    let curve = |configuration, control| SweepCurve { configuration, control, last: None, is_open: true };
    let all = configurations(par);
    let adapts = |c: &&Configuration| {
        c.method.estimates_errors()
            && c.options.stiffness == StiffnessPolicy::OnDemand
            && c.options.linear.solver == SolverChoice::Llt
    };
    let adaptive = StepControl::Adaptive { rtol: 0.1, first_step: Some(dt) };
    let mut curves: Vec<SweepCurve> = all.iter().map(|&c| curve(c, StepControl::Step(dt))).collect();
    curves.extend(all.iter().filter(adapts).map(|&c| curve(c, adaptive)));
    let mut runs = Vec::new();
    while curves.iter().any(|curve| curve.is_open) && deadline.allows(Duration::ZERO) {
        for curve in curves.iter_mut().filter(|curve| curve.is_open) {
            curve.is_open = false;
            if !fits(curve.last, deadline.left()) {
                continue;
            }
            let measured = bench.measure(&curve.configuration, curve.control, deadline)?;
            progress(begin.elapsed(), curve.configuration.method.name());
            let Some(run) = measured else { continue };
            curve.last = Some(Duration::from_secs_f64(run.wall_seconds.max(0.0)));
            let is_at_floor = |error: f64| error <= ABOVE_THE_FLOOR * bench.reference.error_estimate;
            curve.is_open = !run.error.is_some_and(is_at_floor);
            runs.push(run);
            curve.control = match curve.control {
                StepControl::Step(dt) => StepControl::Step(0.5 * dt),
                StepControl::Adaptive { rtol, first_step } => {
                    StepControl::Adaptive { rtol: 0.25 * rtol, first_step: first_step.map(|step| 0.5 * step) }
                }
            };
        }
    }
    Ok(runs)
}

/// True where the run after one that took so long may begin: half the step, twice the work, and a quarter of what is left must do for each.
fn fits(last: Option<Duration>, left: Duration) -> bool {
    !left.is_zero() && last.is_none_or(|last| 8 * last <= left)
}

/// The largest of dt, 2dt, 4dt, … that leaves four steps; smaller than dt where even dt does not.
fn coarsest(dt: f64, duration: f64) -> f64 {
    dt * (duration / dt / 4.0).log2().floor().exp2()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::trial;
    use crate::chart::Reference;
    use crate::chart::curve::curves;
    use crate::integrate::Status;
    use crate::linear::CostModel;
    use crate::system::{State, System, fixtures};

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
        let curves: Vec<Vec<&Run>> = curves(&runs).into_iter().map(|curve| curve.runs).collect();
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
                        let control = StepControl::Adaptive { rtol, first_step };
                        let alone = trial(bench.system, bench.start, configuration, control, 1.0, &|| true).unwrap();
                        assert_eq!((alone.statistics.work, 1.0 / alone.steps as f64), (run.work, run.dt), "{run:?}");
                    }
                }
                assert_eq!(run.tolerance.is_some(), run.solver == "cg", "{run:?}");
            }
        }
    }

    /// A run far from a tenth of a second long is timed three times more.
    #[test]
    fn runs_are_repeated_while_there_is_time() {
        let scene = oscillator(3.0);
        let bench = bench(&scene, 3.0);
        let configuration = Configuration { method: Method::Dop853, options: ImplicitOptions::default() };
        let control = StepControl::Adaptive { rtol: 1e-6, first_step: Some(0.1) };
        let run = bench.measure(&configuration, control, far()).unwrap().unwrap();
        assert_eq!((run.repeats, run.rtol, run.status), (3, Some(1e-6), Status::Completed));
        let over = Deadline::from(Instant::now());
        assert_eq!(bench.measure(&configuration, control, over).unwrap(), None);
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
            (Some(seconds(1)), seconds(7), false),
        ] {
            assert_eq!(fits(last, left), expected, "{last:?} {left:?}");
        }
        // A sweep begins with a few steps.
        for (dt, duration, expected) in [(0.25, 8.0, 2.0), (0.25, 7.9, 1.0), (3.0, 4.0, 0.75), (3.0, 8.0, 1.5)] {
            assert_eq!(coarsest(dt, duration), expected);
        }
    }
}
