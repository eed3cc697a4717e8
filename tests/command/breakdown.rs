//! `sprung run` on scenes that break down: the status, the message, and what is left behind.

use crate::sandbox::{Sandbox, repository_scene};
use serde_json::{Value, json};

/// Runs a scene that breaks down and checks what every such run must leave behind.
#[track_caller]
fn breaks_down(scene: &str, arguments: &[&str], status: &str, message: &str) -> (Sandbox, Value) {
    let sandbox = Sandbox::new();
    let answer = sandbox.sprung(&[&["run", scene, "--json", "--out", "o"], arguments].concat()).ends_with(1);
    let summary = sandbox.json("o/summary.json");
    assert_eq!(answer.json(), summary);
    assert_eq!(summary["status"], status);

    let failure = &summary["failure"];
    assert!(failure["message"].as_str().unwrap().contains(message), "{failure}");
    answer.complains(&["error: ", status, failure["message"].as_str().unwrap()]);
    // The last good state: the one at the start of the step that failed.
    let steps = summary["steps"].as_u64().unwrap();
    assert_eq!(failure["step"], steps + 1);
    assert_eq!(failure["time"], summary["time"]);
    let last = sandbox.json("o/final.json");
    assert_eq!((&last["time"], &last["steps"]), (&summary["time"], &summary["steps"]));
    let coordinates = [&last["positions"], &last["velocities"]].map(|rows| rows.as_array().unwrap().clone()).concat();
    assert!(coordinates.iter().flat_map(|row| row.as_array().unwrap()).all(Value::is_number), "not finite: {last}");
    assert_eq!(sandbox.csv("o/energy.csv").len() as u64, steps + 1);
    (sandbox, summary)
}

#[test]
fn an_indefinite_matrix_ends_the_run() {
    let chain = repository_scene("compressed_chain.toml");
    breaks_down(&chain, &["--stiffness", "full", "--solver", "llt", "--dt", "0.1"], "indefinite", "particle");
}

#[test]
fn a_solver_that_does_not_converge_ends_the_run() {
    let scene = repository_scene("two_springs.toml");
    let arguments = ["--solver", "cg", "--tolerance", "1e-300"];
    breaks_down(&scene, &arguments, "not-converged", "conjugate gradients");
}

#[test]
fn an_explosion_ends_the_run_with_its_last_finite_state() {
    let scene = repository_scene("two_springs.toml");
    let arguments =
        ["--method", "forward-euler", "--dt", "1e150", "--steps", "10", "--frames", "1", "--allow-unstable"];
    let (sandbox, summary) = breaks_down(&scene, &arguments, "non-finite", "not finite");
    let steps = summary["steps"].as_u64().unwrap() as usize;
    assert_eq!(sandbox.names("o/frames").len(), steps + 1);
    assert_eq!(sandbox.read("o/frames.pvd").matches("<DataSet").count(), steps + 1);
}

/// What a new user would try first: a method of second order on the ready cloth, with a step that it does not stand.
#[test]
fn energy_from_nowhere_ends_the_run() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "20");
    let arguments = ["run", "cloth.toml", "--method", "w2", "--dt", "0.01", "--steps", "50", "--out", "o"];
    sandbox.sprung(&arguments).ends_with(1).complains(&["unstable", "from nowhere", "--allow-unstable"]);
    let summary = sandbox.json("o/summary.json");
    assert_eq!(summary["status"], "unstable");
    let (steps, failed) = (summary["steps"].as_u64().unwrap(), summary["failure"]["step"].as_u64().unwrap());
    assert!(steps < failed && failed < 20, "{steps} {failed}");
    // The state kept is from before: its energy is less than what the cloth can have released by then.
    let last = sandbox.json("o/final.json");
    assert_eq!((&last["time"], &last["steps"]), (&summary["time"], &summary["steps"]));
    assert!(summary["energy"]["imbalance"].as_f64().unwrap() < 0.1);
    // The record ends with the step before: so much appeared at once that nothing was waited for.
    let imbalances: Vec<f64> = sandbox.csv("o/energy.csv").iter().map(|row| row[7]).collect();
    assert!(imbalances.len() as u64 == failed && imbalances.iter().all(|imbalance| *imbalance < 0.1), "{imbalances:?}");

    sandbox.sprung(&[&arguments[..], &["--allow-unstable"]].concat()).ends_with(0);
    let summary = sandbox.json("o/summary.json");
    assert_eq!((&summary["status"], &summary["steps"]), (&"completed".into(), &50.into()));
    assert!(summary["energy"]["imbalance"].as_f64().unwrap() > 1e3);
}

#[test]
fn ends_that_meet_end_the_run() {
    // Particle 1 is led onto particle 0, which can move up and down only and is not pulled there.
    let scene = r#"
    [particles]
    positions = [[0, 0], [1, 0]]
    masses = 1
    [springs]
    pairs = [[1, 0]]
    stiffness = 1
    [[constraints]]
    particles = [0]
    axes = ["x"]
    [[constraints]]
    particles = [1]
    path = { times = [0, 1], offsets = [[0, 0], [-1, 0]] }
    [time]
    dt = 0.5
    duration = 2
    "#;
    let files = Sandbox::with("meeting.toml", scene);
    let path = files.path("meeting.toml");
    let (_, summary) = breaks_down(path.to_str().unwrap(), &[], "degenerate-spring", "spring 0 has length zero");
    assert_eq!((&summary["scene"], &summary["time"]), (&json!("meeting"), &json!(1.0)));
}
