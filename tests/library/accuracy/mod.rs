//! The choice for a required accuracy: what it chooses, that the error is kept, and what it costs.

use sprung::accuracy::{
    Answer, Audience, Configuration, Pace, Requirement, SearchProgress, Verdict, answer, preset,
    relative_position_error, trial,
};
use sprung::integrate::{ImplicitOptions, Method, Monitor, Status};
use sprung::linear::SolverOptions;
use sprung::scene::{Kind, Scene, builtin};
use sprung::{Spring, State, System, SystemBuilder};
use std::path::Path;

mod jumps;
mod reductions;

use crate::sandbox::{Sandbox, repository_scene};

fn scene(name: &str) -> (System, State, f64) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/verify/scenes").join(name);
    let scene = Scene::load(path).unwrap();
    let (system, state) = scene.build().unwrap();
    (system, state, scene.time.duration.unwrap())
}

fn requirement(accuracy: f64, duration: f64) -> Requirement {
    Requirement {
        accuracy,
        duration,
        interval: duration / 20.0,
        par: faer::Par::Seq,
        method: None,
        stiffness: None,
        solver: None,
    }
}

fn found(system: &System, start: &State, requirement: &Requirement) -> Answer<()> {
    answer(system, start, requirement, &mut (), &|| true).unwrap().unwrap()
}

/// DOP853 at a tolerance far smaller than any answer here needs.
fn fine_answer(system: &System, start: &State, duration: f64) -> State {
    answer_by_tolerance(system, start, duration, 1e-12)
}

fn answer_by_tolerance(system: &System, start: &State, duration: f64, rtol: f64) -> State {
    let configuration = Configuration { method: Method::Dop853, options: ImplicitOptions::default() };
    let pace = Pace::Adaptive { rtol, first_step: None };
    let run = trial(system, start, &configuration, pace, duration, &|| true).unwrap();
    assert_eq!(run.status, Status::Completed);
    run.state
}

#[test]
fn the_error_is_kept_at_a_few_times_the_cost_of_the_answer() {
    for name in ["tetrahedron.toml", "stiff_pendulum.toml", "compressed_chain.toml", "moving_anchor.toml"] {
        let (system, start, duration) = scene(name);
        let exact = fine_answer(&system, &start, duration);
        for accuracy in [1e-1, 1e-2, 1e-4, 1e-6] {
            let found = found(&system, &start, &requirement(accuracy, duration));
            let error = relative_position_error(&found.state.positions, &exact.positions, &start.positions);
            let estimate = found.estimated_error.unwrap();
            assert!(error <= accuracy && estimate <= accuracy, "{name} {accuracy:e}: {error:e}, said {estimate:e}");
            assert_eq!(found.verdict, Verdict::Confirmed, "{name} {accuracy:e}");
            assert!(found.runs >= 2 && found.cost < found.total_cost, "{name} {accuracy:e}");
            assert!(found.total_cost <= 8.0 * found.cost, "{name} {accuracy:e}: {} {}", found.total_cost, found.cost);
        }
    }
}

/// Steps of half a second agree on the end of a fast vibration that none of them resolves.
#[test]
fn agreement_of_steps_that_resolve_nothing_is_not_believed() {
    let mut builder = SystemBuilder::new();
    for x in [-0.0956, -0.0168] {
        builder.particle([x, 0.0, 0.0], 0.15);
    }
    builder.velocities[0].x = -0.2;
    builder.spring(0, 1, Spring { stiffness: 5.8, rest_length: 0.07, damping: 0.02 });
    let (system, start) = builder.build().unwrap();
    let exact = fine_answer(&system, &start, 1.0);
    for method in [None, Some(Method::W2), Some(Method::LinearBackwardEuler), Some(Method::Rodas4)] {
        let found = found(&system, &start, &Requirement { method, ..requirement(1e-2, 1.0) });
        let error = relative_position_error(&found.state.positions, &exact.positions, &start.positions);
        assert_eq!(found.verdict, Verdict::Confirmed, "{method:?}");
        assert!(error <= 1e-2, "{method:?}: {error:e}");
    }
}

/// A vibration of 1000 periods and a few millionths of the spring's length. Long steps of DOP853 calm it, and two runs without it agree: only
/// its energy is missing.
#[test]
fn vibrations_that_die_out_in_long_steps_are_missed() {
    let (amplitude, omega) = (4e-6, 1000.0 * std::f64::consts::TAU);
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0 + amplitude, 0.0, 0.0], 1.0);
    builder.spring(0, 1, Spring { stiffness: omega * omega, rest_length: 1.0, damping: 0.0 });
    builder.hold(0);
    let (system, start) = builder.build().unwrap();
    let exact = [start.positions[0], start.positions[1]];
    let found = found(&system, &start, &requirement(1e-6, 1.0));
    let error = relative_position_error(&found.state.positions, &exact, &start.positions);
    assert_eq!(found.verdict, Verdict::Confirmed);
    assert!(error <= 1e-6, "{error:e}, said {:e}", found.estimated_error.unwrap());
}

/// Where the fastest vibration sets the steps, a few runs with steps of one length are enough.
#[test]
fn many_digits_take_few_runs_with_equal_steps() {
    let (system, start, duration) = scene("tetrahedron.toml");
    let exact = fine_answer(&system, &start, duration);
    for accuracy in [1e-5, 1e-6, 1e-8] {
        let found = found(&system, &start, &requirement(accuracy, duration));
        let error = relative_position_error(&found.state.positions, &exact.positions, &start.positions);
        assert!(
            matches!((found.configuration.method, found.pace), (Method::Dop853, Pace::Step(_))),
            "{:?}",
            found.pace
        );
        assert!(error <= accuracy && found.runs <= 4, "{accuracy:e}: {error:e} in {} runs", found.runs);
        assert!(found.total_cost <= 3.0 * found.cost, "{accuracy:e}: {} {}", found.total_cost, found.cost);
    }
}

/// Three particles that hang on springs of ω = 1000/s and more, where their weight holds them, the lowest pulled down by `stretch` m.
fn hanging(stretch: f64) -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.gravity.y = -10.0;
    builder.particle([0.0; 3], 1.0);
    for i in 1..=3 {
        // A stiffness of 10⁶ N carries 10 N for each particle below.
        let below = f64::from(4 - i);
        let y = builder.positions[i as usize - 1].y - (1.0 + 1e-5 * below);
        builder.particle([0.0, y - if i == 3 { stretch } else { 0.0 }, 0.0], 1.0);
        builder.spring(i as usize - 1, i as usize, Spring { stiffness: 1e6, rest_length: 1.0, damping: 0.0 });
    }
    builder.hold(0);
    builder.build().unwrap()
}

/// An explicit answer takes thousands of steps, whether anything moves or not.
#[test]
fn what_hangs_still_costs_little_and_what_vibrates_is_not_calmed() {
    let (system, start) = hanging(0.0);
    let still = found(&system, &start, &requirement(1e-3, 10.0));
    assert_eq!((still.configuration.method, &still.verdict), (Method::Bdf2, &Verdict::Confirmed));
    assert!(still.total_cost < 2000.0, "{}", still.total_cost);
    assert!(relative_position_error(&still.state.positions, &start.positions, &start.positions) < 1e-3);

    let (system, start) = hanging(0.05);
    let exact = fine_answer(&system, &start, 1.0);
    let moving = found(&system, &start, &requirement(1e-3, 1.0));
    assert_ne!(moving.configuration.method, Method::Bdf2);
    assert_eq!(moving.verdict, Verdict::Confirmed);
    assert!(relative_position_error(&moving.state.positions, &exact.positions, &start.positions) <= 1e-3);
}

#[test]
fn what_is_asked_for_is_kept() {
    let (system, start, duration) = scene("tetrahedron.toml");
    for method in [Method::LinearBackwardEuler, Method::W2, Method::SymplecticEuler, Method::Dop853] {
        let found = found(&system, &start, &Requirement { method: Some(method), ..requirement(1e-2, duration) });
        assert_eq!((found.configuration.method, found.verdict), (method, Verdict::Confirmed));
        let exact = fine_answer(&system, &start, duration);
        assert!(relative_position_error(&found.state.positions, &exact.positions, &start.positions) <= 1e-2);
    }
}

/// What is recorded of every run.
#[derive(Default)]
struct Listener {
    begun: u32,
    progress: u32,
}

impl Audience for Listener {
    type Records = Vec<State>;

    fn begin(&mut self, _: &Monitor) -> sprung::Result<Vec<State>> {
        self.begun += 1;
        Ok(Vec::new())
    }

    fn record(&mut self, records: &mut Vec<State>, number: u64, state: &State, _: &Monitor) -> sprung::Result<()> {
        records.push(state.clone());
        assert_eq!(records.len() as u64, number);
        Ok(())
    }

    fn progress(&mut self, progress: &SearchProgress<'_>) {
        assert!((0.0..=1.0).contains(&progress.part) && progress.spent > 0.0 && progress.left >= 0.0, "{progress:?}");
        self.progress += 1;
    }
}

/// The records are those of the run that is the answer, at multiples of the interval, and end with the answer itself.
#[test]
fn the_answer_is_recorded_as_it_is_computed() {
    let (system, start, duration) = scene("moving_anchor.toml");
    for accuracy in [1e-2, 1e-6] {
        let mut listener = Listener::default();
        let asked = requirement(accuracy, duration);
        let found = answer(&system, &start, &asked, &mut listener, &|| true).unwrap().unwrap();
        assert_eq!(found.records.len(), 20);
        assert_eq!(found.records.last(), Some(&found.state));
        for (number, state) in (1..).zip(&found.records) {
            assert!((state.time - f64::from(number) * asked.interval).abs() < 1e-9 * duration);
            let exact = fine_answer(&system, &start, state.time);
            let error = relative_position_error(&state.positions, &exact.positions, &start.positions);
            assert!(error <= 2.0 * accuracy, "{accuracy:e}, record {number}: {error:e}");
        }
        assert_eq!(listener.begun, found.runs);
        assert!(listener.progress > found.runs);
    }
}

/// Nothing when stopped at once; the last completed run, with what is known of it, when stopped later.
#[test]
fn an_interrupted_search_leaves_the_best_so_far() {
    let (system, start, duration) = scene("tetrahedron.toml");
    let asked = requirement(1e-6, duration);
    assert!(answer(&system, &start, &asked, &mut (), &|| false).unwrap().is_none());
    let calls = std::cell::Cell::new(0u32);
    let counted = |limit: u32| {
        calls.set(0);
        let calls = &calls;
        move || {
            calls.set(calls.get() + 1);
            calls.get() < limit
        }
    };
    let whole = answer(&system, &start, &asked, &mut (), &counted(u32::MAX)).unwrap().unwrap();
    assert_eq!(whole.verdict, Verdict::Confirmed);
    // In the last run, which is the answer.
    let limit = calls.get() / 10 * 9;
    let go_on = counted(limit);
    let stopped = answer(&system, &start, &asked, &mut (), &go_on).unwrap().unwrap();
    assert_eq!(stopped.verdict, Verdict::Interrupted);
    assert_eq!(stopped.state.time, start.time + duration);
    assert!(stopped.estimated_error.is_none_or(|error| error > 1e-6));
}

/// Three rods that swing over the top forget how they began: no tolerance follows them for a minute, and the answer says how long one
/// does.
#[test]
fn motions_that_forget_are_told() {
    let mut builder = SystemBuilder::new();
    let held = builder.particle([0.0, 0.0, 0.0], 1.0);
    builder.hold(held);
    for p in 1..4 {
        builder.particle([0.3 * f64::from(p), 0.4 * f64::from(p), 0.0], 1.0);
        builder.spring(p as usize - 1, p as usize, Spring { stiffness: 2e3, rest_length: 0.5, damping: 0.0 });
    }
    builder.gravity(0.0, -9.81, 0.0);
    let (system, start) = builder.build().unwrap();
    let found = found(&system, &start, &requirement(1e-3, 60.0));
    assert!(matches!(found.verdict, Verdict::Unconfirmed(_)), "{:?}", found.verdict);
    let horizon = found.horizon.unwrap();
    assert!(0.0 < horizon.known && horizon.known < horizon.most && horizon.most < 60.0, "{horizon:?}");
    assert!(horizon.spread > 0.1 && found.estimated_error.unwrap() > 1e-3, "{horizon:?}");
}

/// A chain that swings magnifies errors: of its first two runs with adaptive steps, which are a sixth of its extent apart, it is the finer one that
/// errs by that.
#[test]
fn where_errors_are_magnified_two_runs_do_not_count_for_less_than_they_differ() {
    let scene = builtin(Kind::Chain, 10).unwrap();
    let (system, start) = scene.build().unwrap();
    let duration = scene.time.duration.unwrap();
    let exact = fine_answer(&system, &start, duration);
    let asked = Requirement { interval: (1.0 / 60.0f64).min(duration / 100.0), ..requirement(0.1, duration) };
    let found = found(&system, &start, &asked);
    let error = relative_position_error(&found.state.positions, &exact.positions, &start.positions);
    assert!(error <= 0.1 && found.verdict == Verdict::Confirmed, "{error} {:?}", found.verdict);
}

#[test]
fn the_preset_fits_the_scene() {
    let (system, start, _) = scene("tetrahedron.toml");
    let (configuration, _) = preset(&system, &start, 0.01, SolverOptions::default()).unwrap();
    assert_eq!(configuration.method, Method::W2);
    let (system, start, _) = scene("compressed_chain.toml");
    let (configuration, _) = preset(&system, &start, 0.1, SolverOptions::default()).unwrap();
    assert_eq!(configuration.method, Method::LinearBackwardEuler);
}

#[test]
fn the_command_says_what_it_found() {
    let folder = Sandbox::new();
    let tetrahedron = repository_scene("tetrahedron.toml");
    folder.sprung(&["run", &tetrahedron, "--accuracy", "1e-2", "--frames", "5", "--out", "o"]).ends_with(0);
    let summary = folder.json("o/summary.json");
    assert_eq!((&summary["status"], &summary["accuracy"]), (&"completed".into(), &0.01.into()));
    assert_eq!(summary["error"]["kind"], "confirmed");
    assert!(summary["error"]["estimate"].as_f64().unwrap() <= 0.01);
    let (run, total) = (summary["effort"]["run"].as_f64().unwrap(), summary["effort"]["total"].as_f64().unwrap());
    assert!(0.0 < run && run < total, "{run} {total}");
    assert!(summary["reason"].as_str().unwrap().contains("force evaluations"));
    // Nothing but results is left in the folder.
    let mut names = folder.names("o");
    names.sort();
    assert_eq!(names, ["energy.csv", "final.json", "frames", "frames.pvd", "summary.json", "trajectory.npz"]);
    let rows = std::fs::read_to_string(folder.path("o/energy.csv")).unwrap().lines().count();
    let frames = std::fs::read_dir(folder.path("o/frames")).unwrap().count();
    assert!(rows > 10 && frames == (rows - 2) / 5 + 1, "{rows} rows, {frames} frames");
    folder.sprung(&["run", &tetrahedron, "--method", "auto", "--out", "p"]).ends_with(0);
    assert_eq!(folder.json("p/summary.json")["method"], "w2");
    folder.sprung(&["run", &tetrahedron, "--accuracy", "2"]).ends_with(2);
    folder.sprung(&["run", &tetrahedron, "--accuracy", "1e-2", "--rtol", "1e-3"]).ends_with(2);
}
