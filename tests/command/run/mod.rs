//! `sprung run`: options, files, outcomes.

mod refusals;

use crate::sandbox::Sandbox;
use serde_json::{Value, json};
use sprung::integrate::{ImplicitOptions, Method, Schedule, run};
use sprung::{Scene, State};
use std::ops::ControlFlow;

/// A planar triangle that falls and turns; soft, so that every method gets through.
pub const TRIANGLE: &str = r#"
name = "falling triangle"
gravity = [0.0, -9.81]
[particles]
positions = [[0.0, 0.0], [1.1, 0.1], [0.3, 0.9]]
velocities = [[0.3, 0.0], [0.0, 0.7], [0.0, 0.0]]
masses = [0.5, 0.7, 1.1]
[springs]
pairs = [[0, 1], [1, 2], [2, 0]]
stiffness = [30.0, 20.0, 25.0]
rest_lengths = [1.0, 0.9, 0.8]
damping = 0.1
[time]
dt = 0.01
duration = 0.1
"#;

fn triangle() -> Sandbox {
    Sandbox::with("triangle.toml", TRIANGLE)
}

#[test]
fn writes_the_motion_that_the_library_computes() {
    let sandbox = triangle();
    sandbox.sprung(&["run", "triangle.toml"]).ends_with(0);

    let (system, mut state) = Scene::from_toml(TRIANGLE).unwrap().build().unwrap();
    let mut stepper = Method::LinearBackwardEuler.stepper(&system, &state, &ImplicitOptions::default()).unwrap();
    run(stepper.as_mut(), &mut state, &Schedule::duration(0.01, 0.1), |_, _| ControlFlow::Continue(()));
    let rows = |rows: &[nalgebra::Vector3<f64>]| rows.iter().map(|row| json!([row.x, row.y])).collect::<Vec<_>>();

    assert_eq!(sandbox.names("out/falling-triangle"), ["energy.csv", "final.json", "summary.json"]);
    let expected = json!({
        "scene": "falling triangle", "time": 0.1, "steps": 10,
        "positions": rows(&state.positions), "velocities": rows(&state.velocities),
        "reactions": { "particles": [], "forces": [] },
    });
    assert_eq!(sandbox.json("out/falling-triangle/final.json"), expected);
}

#[test]
fn the_summary_says_what_was_done() {
    let sandbox = triangle();
    sandbox.sprung(&["run", "triangle.toml", "--no-error-estimate", "--out", "o"]).ends_with(0);
    let summary = sandbox.json("o/summary.json");
    let expected = [
        ("scene", json!("falling triangle")),
        ("status", json!("completed")),
        ("method", json!("linear-backward-euler")),
        ("stiffness", json!("on-demand")),
        ("solver", json!("llt")),
        ("dt", json!(0.01)),
        ("steps", json!(10)),
        ("time", json!(0.1)),
        ("particles", json!(3)),
        ("springs", json!(3)),
        ("dofs", json!(6)),
        ("failure", Value::Null),
    ];
    for (key, value) in expected {
        assert_eq!(summary[key], value, "{key}");
    }
    let work = json!({
        "force_evaluations": 10, "assemblies": 10, "symbolic_factorizations": 1, "factorizations": 10, "solves": 10,
        "iterative_solves": 0, "cg_iterations": 0, "plain_iterations": 0, "multigrid_iterations": 0, "warm_starts": 0, "multigrid_setups": 0, "newton_iterations": 0,
    });
    assert_eq!(summary["work"], work);
    // Two particles of three axes: one dense triangle.
    let factor = &summary["factor"];
    assert_eq!(factor["flops"], json!(91.0));
    assert_eq!(factor["ordering"], json!("minimum-degree"));
    assert!(factor["entries"].as_u64().unwrap() >= 21);
    for time in ["analysis_seconds", "factor_seconds", "solve_seconds"] {
        assert!(factor[time].as_f64().unwrap() > 0.0, "{time}");
    }
    assert!(summary["wall_seconds"].as_f64().unwrap() > 0.0);
    assert!(summary["max_relative_residual"].as_f64().unwrap() < 1e-12);
}

#[test]
fn energies_are_recorded_at_every_step_and_add_up() {
    let sandbox = triangle();
    sandbox.sprung(&["run", "triangle.toml", "--out", "o"]).ends_with(0);
    let rows = sandbox.csv("o/energy.csv");
    let summary = sandbox.json("o/summary.json");

    assert_eq!(rows.len(), 11);
    for (step, row) in rows.iter().enumerate() {
        assert_eq!(row[0], if step == 10 { 0.1 } else { step as f64 * 0.01 });
        assert_eq!(row[4], row[1] + row[2] + row[3]);
    }
    // The initial energies by hand: ½ Σ m v² and −Σ m g·y.
    approx::assert_relative_eq!(rows[0][1], 0.5 * (0.5 * 0.09 + 0.7 * 0.49), max_relative = 1e-14);
    approx::assert_relative_eq!(rows[0][3], 9.81 * (0.7 * 0.1 + 1.1 * 0.9), max_relative = 1e-14);
    let balance = ["work", "dissipated", "imbalance"].map(|key| summary["energy"][key].as_f64().unwrap());
    assert_eq!([&summary["energy"]["initial"], &summary["energy"]["final"]], [rows[0][4], rows[10][4]]);
    assert_eq!(rows[10][5..], balance);
    assert_eq!(rows[0][5..], [0.0; 3]);
    for row in &rows {
        approx::assert_abs_diff_eq!(row[7], row[4] - rows[0][4] - row[5] + row[6], epsilon = 1e-14);
    }
}

#[test]
fn ends_exactly_at_the_duration() {
    let sandbox = triangle();
    let times = |arguments: &[&str]| {
        sandbox.sprung(&[&["run", "triangle.toml", "--out", "o"], arguments].concat()).ends_with(0);
        let steps = sandbox.json("o/summary.json")["steps"].as_u64().unwrap();
        let rows: Vec<f64> = sandbox.csv("o/energy.csv").iter().map(|row| row[0]).collect();
        assert_eq!(rows.len() as u64, steps + 1);
        assert_eq!(sandbox.json("o/final.json")["time"], *rows.last().unwrap());
        rows
    };
    // 3 · 0.1 is not 0.3 in binary; 4 · 0.03 is more than 0.1; the scene's duration is 0.1.
    assert_eq!(times(&["--dt", "0.1", "--duration", "0.3"]), [0.0, 0.1, 0.2, 0.3]);
    assert_eq!(times(&["--dt", "0.03"]), [0.0, 0.03, 0.06, 0.09, 0.1]);
    assert_eq!(times(&["--dt", "0.3"]), [0.0, 0.1]);
    // A number of steps wins over both durations.
    assert_eq!(times(&["--dt", "0.25", "--steps", "2", "--duration", "9"]), [0.0, 0.25, 0.5]);
    assert_eq!(times(&["--steps", "0"]), [0.0]);
}

#[test]
fn a_shorter_last_step_is_a_real_step() {
    let sandbox = triangle();
    sandbox.sprung(&["run", "triangle.toml", "--dt", "0.08", "--out", "o"]).ends_with(0);
    let (system, mut state) = Scene::from_toml(TRIANGLE).unwrap().build().unwrap();
    let mut stepper = Method::LinearBackwardEuler.stepper(&system, &state, &ImplicitOptions::default()).unwrap();
    for dt in [0.08, 0.1 - 0.08] {
        stepper.step(&mut state, dt).unwrap();
    }
    let State { positions, .. } = state;
    let expected: Vec<_> = positions.iter().map(|row| json!([row.x, row.y])).collect();
    assert_eq!(sandbox.json("o/final.json")["positions"], json!(expected));
}

#[test]
fn every_method_stiffness_solver_and_preconditioner_runs_and_is_named() {
    let sandbox = triangle();
    let summary = |arguments: &[&str]| {
        let answer = sandbox.sprung(&[&["run", "triangle.toml", "--json", "--dt", "0.002"], arguments].concat());
        answer.ends_with(0).json()
    };
    for method in ["linear-backward-euler", "backward-euler", "forward-euler", "symplectic-euler"] {
        let summary = summary(&["--method", method]);
        assert_eq!(summary["method"], method);
        let explicit = matches!(method, "forward-euler" | "symplectic-euler");
        assert_eq!(summary["solver"], if explicit { "none" } else { "llt" });
        assert_eq!(summary["stiffness"], if explicit { "none" } else { "on-demand" });
    }
    for stiffness in ["on-demand", "full", "tension", "axial"] {
        assert_eq!(summary(&["--stiffness", stiffness])["stiffness"], stiffness);
    }
    for solver in ["llt", "ldlt", "cg", "cg-assembled"] {
        let summary = summary(&["--solver", solver]);
        assert_eq!(summary["solver"], solver);
        // The triangle's springs are pressed: its matrix may be indefinite, which blocks watch.
        assert_eq!(summary["preconditioner"], if solver.starts_with("cg") { "block-jacobi" } else { "none" });
        assert_eq!(summary["work"]["cg_iterations"] != 0, solver.starts_with("cg"));
    }
    for preconditioner in ["none", "jacobi", "block-jacobi", "multigrid"] {
        let summary = summary(&["--solver", "cg", "--preconditioner", preconditioner]);
        assert_eq!(summary["preconditioner"], preconditioner);
    }
}

#[test]
fn the_tolerance_reaches_conjugate_gradients() {
    let sandbox = triangle();
    let residual = |tolerance: &str| {
        let answer = sandbox.sprung(&["run", "triangle.toml", "--json", "--solver", "cg", "--tolerance", tolerance]);
        answer.ends_with(0).json()["max_relative_residual"].as_f64().unwrap()
    };
    let (loose, tight) = (residual("1e-2"), residual("1e-12"));
    assert!(1e-12 < loose && loose <= 1e-2, "{loose}");
    assert!(tight <= 1e-12, "{tight}");
}

#[test]
fn json_is_alone_on_stdout_and_quiet_is_silent() {
    let sandbox = triangle();
    let answer = sandbox.sprung(&["run", "triangle.toml", "--out", "o", "--json"]).ends_with(0);
    assert_eq!(answer.json(), sandbox.json("o/summary.json"));
    assert_eq!(answer.stderr, "");

    let answer = sandbox.sprung(&["run", "triangle.toml", "--quiet"]).ends_with(0);
    assert_eq!((answer.stdout.as_str(), answer.stderr.as_str()), ("", ""));
    let answer = sandbox.sprung(&["run", "triangle.toml", "--quiet", "--json"]).ends_with(0);
    assert_eq!(answer.json()["status"], "completed");

    let answer = sandbox.sprung(&["run", "triangle.toml"]).ends_with(0);
    for part in ["falling triangle: completed at t = 0.1 s after 10 steps", "solver llt"] {
        assert!(answer.stdout.contains(part), "{part:?} is not in {}", answer.stdout);
    }
}

#[test]
fn options_given_in_vain_are_named() {
    let sandbox = triangle();
    let answer = sandbox.sprung(&["run", "triangle.toml", "--method", "symplectic-euler", "--solver", "cg"]);
    answer.ends_with(0).complains(&["note: --solver has no effect with symplectic-euler"]);
    let answer = sandbox.sprung(&["run", "triangle.toml", "--method", "rodas4", "--stiffness", "axial"]);
    answer.ends_with(0).complains(&["note: --stiffness has no effect with rodas4"]);
    assert_eq!(sandbox.json("out/falling-triangle/summary.json")["stiffness"], "full");
    let answer = sandbox.sprung(&["run", "triangle.toml", "--method", "verlet", "--rtol", "1e-3"]);
    answer.ends_with(2).complains(&["verlet has none: use bdf2, w2, rodas4, dop853"]);
    let answer = sandbox.sprung(&["run", "triangle.toml", "--solver", "llt", "--tolerance", "1e-3"]);
    answer.ends_with(0).complains(&["note: --tolerance has no effect with llt"]);
}

#[test]
fn frames_are_the_steps_asked_for() {
    let sandbox = triangle();
    sandbox.sprung(&["run", "triangle.toml", "--out", "o", "--frames", "4"]).ends_with(0);
    let names = ["frame_000000.vtp", "frame_000004.vtp", "frame_000008.vtp"];
    assert_eq!(sandbox.names("o/frames"), names);
    let series = sandbox.read("o/frames.pvd");
    for (name, time) in names.iter().zip(["0.0", "0.04", "0.08"]) {
        let entry = format!(r#"timestep="{time}" part="0" file="frames/{name}""#);
        assert!(series.contains(&entry), "{entry} is not in {series}");
    }

    sandbox.sprung(&["run", "triangle.toml", "--out", "without"]).ends_with(0);
    assert_eq!(sandbox.names("without"), ["energy.csv", "final.json", "summary.json"]);
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "12");
    for solver in ["llt", "ldlt", "cg", "cg-assembled"] {
        let states = ["1", "2", "5"].map(|threads| {
            let arguments = ["run", "cloth.toml", "--steps", "3", "--solver", solver, "--threads", threads];
            sandbox.sprung(&arguments).ends_with(0);
            sandbox.read("out/cloth/final.json")
        });
        assert!(states.iter().all(|state| *state == states[0]), "{solver}");
    }
}

#[test]
fn nor_do_they_where_the_factorization_is_split() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "102");
    let states = ["1", "3"].map(|threads| {
        // The first step of a flat cloth rounds alike however it is split; the second does not.
        let arguments = ["run", "cloth.toml", "--steps", "2", "--solver", "llt", "--threads", threads];
        sandbox.sprung(&arguments).ends_with(0);
        sandbox.read("out/cloth/final.json")
    });
    assert!(states[0] == states[1]);
}

#[test]
fn files_of_an_earlier_run_are_replaced() {
    let sandbox = triangle();
    for name in ["summary.json", "final.json", "energy.csv", "notes.txt"] {
        sandbox.put(&format!("o/{name}"), "old");
    }
    sandbox.sprung(&["run", "triangle.toml", "--out", "o"]).ends_with(0);
    assert_eq!(sandbox.json("o/summary.json")["steps"], 10);
    assert_eq!(sandbox.json("o/final.json")["steps"], 10);
    assert_eq!(sandbox.csv("o/energy.csv").len(), 11);
    assert_eq!(sandbox.read("o/notes.txt"), "old");
}

/// A scene without a step: steps that follow an error estimate, records at an interval, and what that was.
#[test]
fn without_a_step_the_run_chooses_its_own() {
    let sandbox = Sandbox::with("timeless.toml", &TRIANGLE.replace("dt = 0.01", ""));
    let answer = sandbox.sprung(&["run", "timeless.toml", "--out", "o"]).ends_with(0);
    assert_eq!(answer.stderr, "");
    let summary = sandbox.json("o/summary.json");
    assert_eq!((&summary["rtol"], &summary["time"]), (&json!(0.01), &json!(0.1)));
    assert!(summary["reason"].as_str().unwrap().contains("no dt is given"), "{}", summary["reason"]);
    let times: Vec<f64> = sandbox.csv("o/energy.csv").iter().map(|row| row[0]).collect();
    assert_eq!(times.len(), 301);
    approx::assert_relative_eq!(times[1], 0.1 / 300.0, max_relative = 1e-12);
    assert_eq!(times[300], 0.1);
    assert_eq!(summary["error"]["kind"], "indicator");
    assert!(summary["error"]["estimate"].as_f64().unwrap() < 0.02, "{}", summary["error"]);
    assert_eq!(summary["warnings"], json!([]));
    // Long runs have as many records.
    sandbox.sprung(&["run", "timeless.toml", "--out", "o", "--duration", "3"]).ends_with(0);
    assert_eq!(sandbox.csv("o/energy.csv").len(), 301);

    // Methods of fixed steps, and numbers of steps, need one.
    for arguments in [&["--method", "backward-euler"][..], &["--steps", "10"]] {
        let arguments = [&["run", "timeless.toml", "--out", "o"], arguments].concat();
        sandbox.sprung(&arguments).ends_with(0).complains(&["no dt was given", "0.01 s"]);
        let summary = sandbox.json("o/summary.json");
        assert_eq!((&summary["dt"], &summary["steps"]), (&json!(0.01), &json!(10)));
    }
}

/// The ready cloth with linearised backward Euler at a customary step hangs on the wrong side, and the run says so.
#[test]
fn a_run_that_is_wrong_says_so() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "10");
    let run = ["run", "cloth.toml", "--duration", "0.5", "--out", "o"];
    let answer = sandbox.sprung(&[&run[..], &["--dt", "0.01"]].concat()).ends_with(0);
    for part in ["warning: the relative position error at the end is about", "predictable until"] {
        assert!(answer.stderr.contains(part), "{part:?} is not in {}", answer.stderr);
    }
    let summary = sandbox.json("o/summary.json");
    // The truth is 1.9, by an independent integrator.
    let estimate = summary["error"]["estimate"].as_f64().unwrap();
    assert!((0.19..19.0).contains(&estimate), "{estimate}");
    assert_eq!(summary["warnings"].as_array().unwrap().len(), 1);

    // Without a step it is right, and says that too.
    let answer = sandbox.sprung(&run).ends_with(0);
    assert!(!answer.stderr.contains("warning"), "{}", answer.stderr);
    let estimate = sandbox.json("o/summary.json")["error"]["estimate"].as_f64().unwrap();
    assert!(estimate < 0.05, "{estimate}");
}

/// A chain that whips is 40 % off after 2 s, and what says so is what the motion has made of errors; until 1 s it is calm.
#[test]
fn a_run_that_magnifies_its_errors_says_so() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("chain", "6");
    let run = |duration| sandbox.sprung(&["run", "chain.toml", "--duration", duration, "--out", "o"]).ends_with(0);
    assert_eq!(run("1").stderr, "");
    let answer = run("2");
    for part in [
        "the relative position error at the end is about",
        "predictable until",
        "the motion magnifies the errors of its steps",
    ] {
        assert!(answer.stderr.contains(part), "{part:?} is not in {}", answer.stderr);
    }
    let estimate = sandbox.json("o/summary.json")["error"]["estimate"].as_f64().unwrap();
    assert!((0.04..4.0).contains(&estimate), "{estimate}");
}

#[test]
fn effort_is_counted_in_force_evaluations() {
    let sandbox = triangle();
    let summary = |arguments: &[&str]| {
        let arguments = [&["run", "triangle.toml", "--json", "--out", "o"], arguments].concat();
        sandbox.sprung(&arguments).ends_with(0).json()
    };
    let explicit = summary(&["--method", "symplectic-euler", "--no-error-estimate"]);
    assert_eq!(explicit["effort"], json!({ "run": 10.0, "total": 10.0 }));
    let implicit = summary(&[]);
    // A step is a force evaluation, an assembly, a factorization and a solve.
    assert!(implicit["effort"]["run"].as_f64().unwrap() > 30.0, "{}", implicit["effort"]);
    let chosen = summary(&["--accuracy", "1e-2"]);
    assert!(chosen["effort"]["total"].as_f64().unwrap() > chosen["effort"]["run"].as_f64().unwrap());
}
