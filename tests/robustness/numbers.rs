//! Numbers at the ends of their range: runs of no length, of uncountable steps, to rest and beyond the largest double.

use crate::command::Sandbox;
use serde_json::Value;

/// A mass on a spring along one axis.
const SPRING: &str = r#"
[particles]
positions = [[0], [1]]
velocities = [[0], [0.2]]
masses = 0.01
[springs]
pairs = [[0, 1]]
stiffness = 1000
rest_lengths = 1
[[constraints]]
particles = [0]
[time]
dt = 0.01
duration = 0
"#;

fn sandbox() -> Sandbox {
    let sandbox = Sandbox::new();
    sandbox.put("spring.toml", SPRING);
    sandbox
}

/// A motion of no length can be simulated; there is nothing in it to choose a step by.
#[test]
fn no_duration_no_choice() {
    let sandbox = sandbox();
    for arguments in [&["run", "spring.toml", "--accuracy", "1e-2"][..], &["chart", "spring.toml", "--budget", "1"]] {
        sandbox.sprung(arguments).ends_with(2).complains(&["spring.toml: time.duration = 0: must be positive"]);
    }
    let summary = sandbox.sprung(&["run", "spring.toml", "--json"]).ends_with(0).json();
    assert_eq!((&summary["steps"], &summary["time"]), (&0.into(), &0.0.into()));
}

/// A step that would take more than 2⁵³ steps to the end is refused with its value; one that is long beside the run is cut
/// short; a time beyond the largest double is no end.
#[test]
fn steps_must_be_countable() {
    let sandbox = sandbox();
    for dt in ["1e-310", "1e-17"] {
        for more in [&[][..], &["--rtol", "1e-2"], &["--method", "forward-euler"]] {
            let arguments = [&["run", "spring.toml", "--duration", "1", "--dt", dt], more].concat();
            sandbox.sprung(&arguments).ends_with(2).complains(&["spring.toml: time.dt = ", dt, "more than 2^53 steps"]);
        }
    }
    let endless = ["run", "spring.toml", "--dt", "1e308", "--steps", "100"];
    sandbox.sprung(&endless).ends_with(2).complains(&["time.duration = inf: must be finite"]);
    let short = ["run", "spring.toml", "--dt", "1", "--duration", "1e-10", "--json"];
    let summary = sandbox.sprung(&short).ends_with(0).json();
    assert_eq!((&summary["steps"], &summary["time"]), (&1.into(), &1e-10.into()));
}

/// Backward Euler damps a motion by a constant factor in every step, down to where squares of its numbers vanish and further to
/// where the numbers do. Every solver follows it there.
#[test]
fn motions_come_to_rest_with_every_solver() {
    let sandbox = sandbox();
    for solver in ["llt", "ldlt", "cg", "cg-assembled"] {
        for more in
            [&[][..], &["--stiffness", "full"], &["--preconditioner", "none"], &["--preconditioner", "multigrid"]]
        {
            let arguments = ["run", "spring.toml", "--steps", "600", "--solver", solver, "--out", "o"];
            sandbox.sprung(&[&arguments, more].concat()).ends_with(0);
            let last = sandbox.json("o/final.json");
            let speed = last["velocities"][1][0].as_f64().unwrap();
            assert!(speed.abs() < 1e-300, "{solver}: {speed}");
        }
    }
}

/// Steps of 0.01 s add up to a little less than a kink at 0.07 s that the seventh step lands on: what moves from there on moves
/// at the new velocity, in the results and in the damping of the eighth step.
#[test]
fn velocities_after_a_kink_are_the_new_ones() {
    let sandbox = Sandbox::new();
    let scene = |kink: f64, dt: f64| {
        format!(
            "[particles]\npositions = [[0], [1]]\nmasses = 1\n[springs]\npairs = [[0, 1]]\nstiffness = 1\ndamping = 1\n\
             [[constraints]]\nparticles = [0]\npath = {{ times = [0, {kink}, 1], offsets = [[0], [0], [1]] }}\n\
             [time]\ndt = {dt}\nduration = {}\n",
            8.0 * dt
        )
    };
    sandbox.put("kink.toml", &scene(0.07, 0.01));
    for method in ["forward-euler", "symplectic-euler", "w2", "implicit-midpoint"] {
        let arguments = ["run", "kink.toml", "--method", method, "--steps", "7", "--out", "o"];
        sandbox.sprung(&arguments).ends_with(0);
        let velocity = sandbox.json("o/final.json")["velocities"][0][0].as_f64().unwrap();
        assert!((velocity - 1.0 / 0.93).abs() < 1e-12, "{method}: {velocity}");
    }
    // In the eighth step of forward Euler nothing but the damping of the new velocity moves the other end: v = dt b v₀/m.
    sandbox.sprung(&["run", "kink.toml", "--method", "forward-euler", "--out", "o"]).ends_with(0);
    let velocity = sandbox.json("o/final.json")["velocities"][1][0].as_f64().unwrap();
    assert!((velocity - 0.01 / 0.93).abs() < 1e-12, "{velocity}");
}

/// A path whose speed is no number, and motions that leave the range of doubles: refused, or ended with a status of their own
/// and the last state that can be written.
#[test]
fn what_is_not_finite_is_not_written() {
    let sandbox = Sandbox::new();
    let with = |motion: &str| {
        format!(
            "[particles]\npositions = [[0], [1]]\nmasses = 1\n[springs]\npairs = [[0, 1]]\nstiffness = 1\n\
                 [[constraints]]\nparticles = [0]\n{motion}\n[time]\ndt = 0.1\nduration = 1\n"
        )
    };
    sandbox.put("jump.toml", &with("path = { times = [0, 1e-320], offsets = [[0], [0.2]] }"));
    let rule = "constraints[0].path.times[1] = ";
    sandbox.sprung(&["run", "jump.toml"]).ends_with(2).complains(&["jump.toml: ", rule, "finite speed"]);
    sandbox.put("jump.toml", &with("path = { times = [0, 1], offsets = [[-1e308], [1e308]] }"));
    sandbox.sprung(&["run", "jump.toml"]).ends_with(2).complains(&[rule, "finite speed"]);

    sandbox.put("away.toml", &with("velocity = [1e308]"));
    let methods =
        ["linear-backward-euler", "backward-euler", "w2", "implicit-midpoint", "forward-euler", "symplectic-euler"];
    for method in methods {
        let arguments = ["run", "away.toml", "--method", method, "--steps", "100", "--out", "o", "--frames", "1"];
        sandbox.sprung(&arguments).ends_with(1);
        let files = ["summary.json", "final.json"].map(|name| sandbox.json(&format!("o/{name}")));
        assert_eq!(files[0]["status"], "non-finite", "{method}");
        assert!(all_numbers(&files[1]), "{method}: {}", files[1]);
        let energies = sandbox.read("o/energy.csv");
        assert!(!energies.contains("inf") && !energies.contains("NaN"), "{method}: {energies}");
    }
}

/// Speeds that can be written have squares that cannot: the run ends with the state before.
#[test]
fn energies_that_overflow_end_the_run() {
    let sandbox = Sandbox::new();
    let scene = |speed: &str| {
        format!(
            "gravity = [1e149]\n[particles]\npositions = [[0]]\nvelocities = [[{speed}]]\nmasses = 1\n\
             [time]\ndt = 0.1\nduration = 100\n"
        )
    };
    for (speed, least) in [("1e149", 1), ("1e160", 0)] {
        sandbox.put("fast.toml", &scene(speed));
        for method in ["linear-backward-euler", "forward-euler", "w2"] {
            let arguments = ["run", "fast.toml", "--method", method, "--out", "o", "--frames", "1"];
            sandbox.sprung(&arguments).ends_with(1).complains(&["error: non-finite in step "]);
            let [summary, last] = ["summary.json", "final.json"].map(|name| sandbox.json(&format!("o/{name}")));
            assert_eq!(summary["status"], "non-finite", "{method}");
            let steps = summary["steps"].as_u64().unwrap();
            assert!(steps >= least && last["steps"] == steps && all_numbers(&last), "{method}: {summary}");
            let rows = sandbox.read("o/energy.csv");
            assert!(!rows.contains("inf") && !rows.contains("NaN"), "{method}: {rows}");
        }
    }
}

fn all_numbers(value: &Value) -> bool {
    match value {
        Value::Null => false,
        Value::Array(list) => list.iter().all(all_numbers),
        Value::Object(map) => map.values().all(all_numbers),
        _ => true,
    }
}
