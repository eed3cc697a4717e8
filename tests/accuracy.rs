//! The choice for a required accuracy: what it chooses, that the error is kept, and what it costs; exact reductions change
//! nothing.

use sprung::accuracy::{Pace, Reduction, Requirement, choose, preset, reduce, relative_position_error, trial};
use sprung::integrate::{Equations, ImplicitOptions, Method, Schedule, Status, StiffnessPolicy, run};
use sprung::linear::SolverOptions;
use sprung::scene::Scene;
use sprung::{Spring, State, System, SystemBuilder};
use std::ops::ControlFlow;
use std::path::Path;

mod command;
use command::{Sandbox, repository_scene};

fn scene(name: &str) -> (System, State, f64) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("verification/scenes").join(name);
    let scene = Scene::load(path).unwrap();
    let (system, state) = scene.build().unwrap();
    (system, state, scene.time.duration.unwrap())
}

fn requirement(accuracy: f64, duration: f64) -> Requirement {
    Requirement { accuracy, duration, par: faer::Par::Seq, method: None, stiffness: None, solver: None }
}

/// Implicit midpoint at steps far shorter than any choice here needs.
fn fine_answer(system: &System, start: &State, duration: f64) -> State {
    let mut state = start.clone();
    let mut stepper = Method::ImplicitMidpoint.stepper(system, start, &ImplicitOptions::default()).unwrap();
    let schedule = Schedule::duration(duration / 20_000.0, duration);
    let outcome = run(stepper.as_mut(), &mut state, &schedule, |_, _| ControlFlow::Continue(()));
    assert_eq!(outcome.status(), Status::Completed);
    state
}

#[test]
fn the_error_is_kept_and_the_work_is_locked() {
    // (scene, accuracy, method, force evaluations and solves of the chosen run)
    let cases = [
        ("tetrahedron.toml", 1e-2, Method::Verlet, (12, 0)),
        ("tetrahedron.toml", 1e-4, Method::Verlet, (103, 0)),
        ("stiff_pendulum.toml", 1e-2, Method::Verlet, (675, 0)),
        ("compressed_chain.toml", 1e-4, Method::Verlet, (255, 0)),
    ];
    for (name, accuracy, method, counts) in cases {
        let (system, start, duration) = scene(name);
        let choice = choose(&system, &start, &requirement(accuracy, duration), &|| true).unwrap().unwrap();
        let run = trial(&system, &start, &choice.configuration, choice.pace, duration, &|| true).unwrap();
        let work = run.statistics.work;
        let answer = fine_answer(&system, &start, duration);
        let error = relative_position_error(&run.state.positions, &answer.positions, &start.positions);
        assert!(error <= accuracy && choice.estimated_error <= accuracy, "{name}: {error:e}, {choice:?}");
        assert_eq!(choice.configuration.method, method, "{name}: {}", choice.reason);
        assert_eq!((work.force_evaluations, work.solves), counts, "{name}: {}", choice.reason);
    }
}

#[test]
fn what_is_asked_for_is_kept() {
    let (system, start, duration) = scene("tetrahedron.toml");
    let asked = Requirement { method: Some(Method::LinearBackwardEuler), ..requirement(1e-2, duration) };
    let choice = choose(&system, &start, &asked, &|| true).unwrap().unwrap();
    assert_eq!(choice.configuration.method, Method::LinearBackwardEuler);
    assert!(choice.estimated_error <= 1e-2);
    assert!(matches!(choice.pace, Pace::Step(dt) if dt < 0.01));
}

#[test]
fn an_interrupted_choice_is_none() {
    let (system, start, duration) = scene("tetrahedron.toml");
    assert!(choose(&system, &start, &requirement(1e-4, duration), &|| false).unwrap().is_none());
}

/// Two chains that share a held particle: one swings in the plane z = 0.3, the other hangs at rest, exactly at its length.
fn two_parts() -> (System, State) {
    let mut builder = SystemBuilder::new();
    let spring = |rest_length| Spring { stiffness: 30.0, rest_length, damping: 0.1 };
    let anchor = builder.particle([0.0, 0.0, 0.3], 1.0);
    let a = builder.particle([1.0, 0.25, 0.3], 0.5);
    let b = builder.particle([2.0, 0.0, 0.3], 0.7);
    let c = builder.particle([0.0, -1.0, 0.3], 0.4);
    let d = builder.particle([0.5, -1.0, 1.3], 0.4);
    builder.spring(anchor, a, spring(0.9));
    builder.spring(a, b, spring(1.2));
    builder.spring(anchor, c, spring(1.0));
    builder.spring(c, d, spring((0.25f64 + 1.0).sqrt()));
    builder.hold(anchor);
    builder.velocities[b] = nalgebra::Vector3::new(0.3, -0.2, 0.0);
    builder.build().unwrap()
}

#[test]
fn reductions_are_found() {
    let (system, state) = two_parts();
    let reduced = reduce(&system, &state);
    assert!(reduced.reductions.contains(&Reduction::Axis { axis: 'z', coordinates: 2 }), "{:?}", reduced.reductions);
    assert!(
        reduced.reductions.contains(&Reduction::AtRest { particles: 2, coordinates: 6 }),
        "{:?}",
        reduced.reductions
    );
    assert_eq!((system.dofs().len(), reduced.system.dofs().len()), (12, 4));
}

#[test]
fn reductions_do_not_change_the_motion() {
    let (system, start) = two_parts();
    let reduced = reduce(&system, &start).system;
    for method in Method::ALL {
        // The full stiffness: a policy that looks at definiteness would look at different matrices.
        let options = ImplicitOptions {
            stiffness: StiffnessPolicy::Always(sprung::Stiffness::Tension),
            linear: SolverOptions::default(),
        };
        let motion = |system: &System| {
            let mut state = start.clone();
            let mut stepper = method.stepper(system, &start, &options).unwrap();
            let outcome =
                run(stepper.as_mut(), &mut state, &Schedule::steps(0.01, 200), |_, _| ControlFlow::Continue(()));
            assert_eq!(outcome.status(), Status::Completed, "{}", method.name());
            state
        };
        let (full, less) = (motion(&system), motion(&reduced));
        if method.is_implicit() {
            // Another elimination order rounds differently; Newton's methods stop at a relative residual of 1e-10.
            let newton = method.equations() == Equations::Nonlinear;
            let error = relative_position_error(&less.positions, &full.positions, &start.positions);
            assert!(error <= if newton { 1e-8 } else { 1e-12 }, "{}: {error:e}", method.name());
        } else {
            assert_eq!(full, less, "{}", method.name());
        }
    }
}

#[test]
fn nothing_is_reduced_where_something_moves() {
    let (system, state) = two_parts();
    // A velocity out of the plane, and a force on the part at rest.
    let mut tilted = state.clone();
    tilted.velocities[2].z = 1e-9;
    assert!(!reduce(&system, &tilted).reductions.iter().any(|r| matches!(r, Reduction::Axis { .. })));
    let mut pulled = state.clone();
    pulled.positions[3].y = -1.01;
    assert!(!reduce(&system, &pulled).reductions.iter().any(|r| matches!(r, Reduction::AtRest { .. })));
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
fn the_command_says_what_it_chose() {
    let folder = Sandbox::new();
    let tetrahedron = repository_scene("tetrahedron.toml");
    folder.sprung(&["run", &tetrahedron, "--accuracy", "1e-2", "--out", "o"]).ends_with(0);
    let summary = folder.json("o/summary.json");
    assert_eq!(summary["method"], "verlet");
    assert_eq!(summary["accuracy"], 0.01);
    assert!(summary["estimated_error"].as_f64().unwrap() <= 0.01);
    assert!(summary["reason"].as_str().unwrap().contains("force evaluations"));
    folder.sprung(&["run", &tetrahedron, "--method", "auto", "--out", "p"]).ends_with(0);
    assert_eq!(folder.json("p/summary.json")["method"], "w2");
    folder.sprung(&["run", &tetrahedron, "--accuracy", "2"]).ends_with(2);
    folder.sprung(&["run", &tetrahedron, "--accuracy", "1e-2", "--rtol", "1e-3"]).ends_with(2);
}
