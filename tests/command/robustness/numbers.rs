//! Numbers at the ends of their range: runs of no length, of uncountable steps, to rest and beyond the largest double.

use crate::sandbox::Sandbox;
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
    Sandbox::with("spring.toml", SPRING)
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
            sandbox.sprung(&arguments).ends_with(2).complains(&["--dt = ", dt, "more than 2^53 steps"]);
        }
    }
    let endless = ["run", "spring.toml", "--dt", "1e308", "--steps", "100"];
    sandbox.sprung(&endless).ends_with(2).complains(&["duration = inf: must be finite"]);
    // Where no step is given.
    sandbox.put("free.toml", &SPRING.replace("dt =", "# dt ="));
    for more in [&[][..], &["--accuracy", "0.1"]] {
        let answer = sandbox.sprung(&[&["run", "free.toml", "--duration", "5e-324"], more].concat()).ends_with(2);
        answer.complains(&["error: --duration = 5e-324: is too short to be divided into steps\n"]);
    }
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
    sandbox.put("jump.toml", &with("path = { times = [0, 1e-3], offsets = [[-1e149], [1e149]] }"));
    sandbox.sprung(&["run", "jump.toml"]).ends_with(2).complains(&[rule, "finite speed"]);

    // Within what states may have, and away in the first step.
    sandbox.put("away.toml", &with("velocity = [1e150]").replace("dt = 0.1\nduration = 1", "dt = 10\nduration = 100"));
    let methods =
        ["linear-backward-euler", "backward-euler", "w2", "implicit-midpoint", "forward-euler", "symplectic-euler"];
    for method in methods {
        let arguments = ["run", "away.toml", "--method", method, "--steps", "100", "--out", "o", "--frames", "1"];
        sandbox.sprung(&arguments).ends_with(1);
        let files = ["summary.json", "final.json"].map(|name| sandbox.json(&format!("o/{name}")));
        assert_eq!(files[0]["status"], "non-finite", "{method}");
        assert!(all_numbers(&files[1]) && all_numbers(&files[0]["energy"]), "{method}: {files:?}");
        let energies = sandbox.read("o/energy.csv");
        assert!(!energies.contains("inf") && !energies.contains("NaN"), "{method}: {energies}");
    }
}

/// Speeds that can be written have squares that cannot: the run ends with the state before.
#[test]
fn energies_that_overflow_end_the_run() {
    let sandbox = Sandbox::new();
    // Beyond the largest speed of a state; within it, beyond the largest energy.
    for (speed, gravity, mass) in [("9e149", "1e150", "1"), ("1e149", "1e149", "1"), ("1e100", "1e100", "1e107")] {
        let scene = format!(
            "gravity = [{gravity}]\n[particles]\npositions = [[0]]\nvelocities = [[{speed}]]\nmasses = {mass}\n\
             [time]\ndt = 0.1\nduration = 100\n"
        );
        sandbox.put("fast.toml", &scene);
        for method in ["linear-backward-euler", "forward-euler", "w2", "bdf2", "verlet"] {
            let arguments = ["run", "fast.toml", "--method", method, "--out", "o", "--frames", "1"];
            sandbox.sprung(&arguments).ends_with(1).complains(&["error: non-finite in step "]);
            let [summary, last] = ["summary.json", "final.json"].map(|name| sandbox.json(&format!("o/{name}")));
            assert_eq!(summary["status"], "non-finite", "{method}");
            assert!(last["steps"] == summary["steps"] && all_numbers(&last), "{method}: {summary}");
            assert!(all_numbers(&summary["energy"]), "{method}: {summary}");
            let rows = sandbox.read("o/energy.csv");
            assert!(!rows.contains("inf") && !rows.contains("NaN"), "{method}: {rows}");
        }
    }
}

/// Every number of a scene from where squares are numbers no more to where numbers end: what cannot be computed with is refused
/// with its key, and what is computed is finite in every file.
#[test]
fn numbers_at_the_ends_of_their_range_are_refused_or_computed_with() {
    let sandbox = Sandbox::new();
    let scene = |number: &str, value: f64| {
        let at = |name: &str, default: f64| if name == number { value } else { default };
        format!(
            "gravity = [{:e}, 0]\n[particles]\npositions = [[0, 0], [{:e}, 0], [0, 1]]\n\
             velocities = [[0, 0], [0, {:e}], [0, 0]]\nmasses = {:e}\n[springs]\npairs = [[0, 1], [1, 2]]\n\
             stiffness = {:e}\ndamping = {:e}\nrest_lengths = {:e}\n[[constraints]]\nparticles = [0]\nvelocity = [{:e}, 0]\n\
             [time]\ndt = {dt:e}\nduration = {:e}\n",
            at("gravity", 0.0),
            at("positions[1]", 1.0),
            at("velocities[1]", 0.1),
            at("masses", 1.0),
            at("stiffness", 10.0),
            at("damping", 0.0),
            at("rest_lengths", 0.9),
            at("velocity", 0.0),
            2.0 * at("dt", 0.01),
            dt = at("dt", 0.01),
        )
    };
    let names = [
        "gravity",
        "positions[1]",
        "velocities[1]",
        "masses",
        "stiffness",
        "damping",
        "rest_lengths",
        "velocity",
        "dt",
    ];
    let (mut refused, mut broken, mut completed) = (0, 0, 0);
    for name in names {
        for value in [1e149, 1e150, 1.1e150, 1e153, 1e154, 1e200, 1e300, 8e307, 1e-150, 1e-200, 1e-300] {
            sandbox.put("ends.toml", &scene(name, value));
            for command in [
                "run ends.toml --quiet --out o",
                "run ends.toml --quiet --out o --method w2",
                "run ends.toml --quiet --out o --method symplectic-euler",
                "matrix ends.toml --out o",
                "inspect ends.toml --json --out o",
            ] {
                let answer = sandbox.sprung(&command.split(' ').collect::<Vec<_>>());
                let context = format!("{name} = {value:e}: {command}: {}", answer.stderr);
                assert!(!answer.stderr.contains("panicked"), "{context}");
                match answer.status {
                    Some(2) => {
                        refused += 1;
                        let rules =
                            [name, "makes an energy beyond the largest number", "is a spring of zero current length"];
                        let named = rules.iter().any(|rule| answer.stderr.contains(rule));
                        assert!(named && answer.stderr.contains("ends.toml: "), "{context}");
                        continue;
                    }
                    Some(1) => broken += 1,
                    Some(0) => completed += 1,
                    status => panic!("{status:?} {context}"),
                }
                if command.starts_with("run") {
                    let [summary, last] = ["o/summary.json", "o/final.json"].map(|name| sandbox.json(name));
                    assert!(all_numbers(&last) && all_numbers(&summary["energy"]), "{context}: {summary}");
                    for text in [sandbox.read("o/energy.csv"), summary.to_string(), answer.stderr] {
                        assert!(!has_no_number(&text), "{context}: {text}");
                    }
                } else if command.starts_with("matrix") && answer.status == Some(0) {
                    assert!(!has_no_number(&sandbox.read("o/A.mtx")), "{context}");
                }
            }
        }
    }
    assert!(refused > 30 && broken > 30 && completed > 100, "{refused} {broken} {completed}");
}

/// Whether infinities or NaN are among the words of a text.
fn has_no_number(text: &str) -> bool {
    let mut words = text.split(|c: char| !c.is_alphanumeric());
    words.any(|word| ["inf", "nan", "infinity"].contains(&word.to_lowercase().as_str()))
}

fn all_numbers(value: &Value) -> bool {
    match value {
        Value::Null => false,
        Value::Array(list) => list.iter().all(all_numbers),
        Value::Object(map) => map.values().all(all_numbers),
        _ => true,
    }
}
