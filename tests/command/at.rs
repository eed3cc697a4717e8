//! Commands at another state than a scene's start: `--at FILE`, and `matrix --steps N`.

use crate::run::TRIANGLE;
use crate::sandbox::{Sandbox, repository_scene};
use serde_json::{Value, json};

fn run(sandbox: &Sandbox, arguments: &str) {
    let arguments: Vec<&str> = arguments.split(' ').collect();
    sandbox.sprung(&[&["run"][..], &arguments, &["--quiet"]].concat()).ends_with(0);
}

const MATRICES: [&str; 6] = ["A.mtx", "M.mtx", "G.mtx", "K.mtx", "b.mtx", "dofs.csv"];

/// The matrices after so many steps are those at the state with which a run of so many steps ended, to the byte, and others than at the start.
#[test]
fn matrices_after_steps_are_those_at_the_state_of_a_run() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "9");
    sandbox.put("triangle.toml", TRIANGLE);
    for scene in ["cloth.toml".to_owned(), "triangle.toml".to_owned(), repository_scene("moving_anchor.toml")] {
        let matrix =
            |more: &[&str]| sandbox.sprung(&[&["matrix", &scene, "--dt", "0.005"], more].concat()).ends_with(0);
        run(&sandbox, &format!("{scene} --dt 0.005 --steps 7 --out o"));
        matrix(&["--at", "o/final.json", "--out", "at"]);
        matrix(&["--steps", "7", "--out", "steps"]);
        // From the state of a file, so many steps more.
        run(&sandbox, &format!("{scene} --dt 0.005 --steps 3 --out third"));
        matrix(&["--at", "third/final.json", "--steps", "4", "--out", "after"]);
        matrix(&["--at", "third/final.json", "--out", "third-at"]);
        let values = |folder: &str| -> Vec<f64> {
            let text = sandbox.read(&format!("{folder}/b.mtx"));
            let lines = text.lines().skip_while(|line| line.starts_with('%')).skip(1);
            lines.map(|line| line.rsplit(' ').next().unwrap().parse().unwrap()).collect()
        };
        let [after, steps, third] = [values("after"), values("steps"), values("third-at")];
        let distance = |other: &[f64]| steps.iter().zip(other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert_eq!(after.len(), steps.len(), "{scene}");
        assert!(distance(&after) < 1e-4 * distance(&third), "{scene}");
        matrix(&["--out", "start"]);
        for name in MATRICES {
            assert_eq!(sandbox.read(&format!("at/{name}")), sandbox.read(&format!("steps/{name}")), "{scene} {name}");
        }
        let entries =
            |file: &str| sandbox.read(file).lines().skip_while(|line| line.starts_with('%')).collect::<String>();
        assert_ne!(entries("at/A.mtx"), entries("start/A.mtx"), "{scene}");
        assert_eq!(entries("at/M.mtx"), entries("start/M.mtx"), "{scene}");
    }
    let answer = sandbox.sprung(&["matrix", "triangle.toml", "--steps", "7", "--json"]).ends_with(0).json();
    assert_eq!(answer["time"], 0.07);
}

/// Past its critical step a spring that is pressed has no step under `full`; what is said is that the way there broke down.
#[test]
fn matrices_of_a_state_that_is_not_reached_are_not_written() {
    let sandbox = Sandbox::with("fast.toml", &TRIANGLE.replace("[[0.3, 0.0]", "[[1e150, 0.0]"));
    let answer = sandbox.sprung(&["matrix", "fast.toml", "--dt", "10", "--steps", "3", "--out", "o"]).ends_with(1);
    answer.complains(&["non-finite in step"]);
    assert_eq!(sandbox.names("."), ["fast.toml"]);
}

/// A run in two parts is the run, to the bit: with a path that has a kink in the second part, gravity that changes, a rest length that shrinks. Time, records and
/// duration count on from the state.
#[test]
fn a_run_goes_on_from_the_state_of_another() {
    let sandbox = Sandbox::new();
    let scene = TRIANGLE
        .replace("gravity = [0.0, -9.81]", "gravity = { times = [0.0, 0.08], values = [[0.0, -9.81], [0.0, 4.0]] }")
        .replace("[time]", "[[springs.actuation]]\nsprings = [1]\npath = { times = [0.0, 0.1], factors = [1.0, 0.5] }\n\n[[constraints]]\nparticles = [0]\npath = { times = [0.0, 0.07, 0.09], offsets = [[0, 0], [0.2, 0], [0, 0.1]] }\n\n[time]");
    sandbox.put("driven.toml", &scene);
    run(&sandbox, "driven.toml --steps 10 --out whole");
    run(&sandbox, "driven.toml --steps 6 --out first");
    run(&sandbox, "driven.toml --steps 4 --at first/final.json --out second --frames 1");
    let (whole, second) = (sandbox.json("whole/final.json"), sandbox.json("second/final.json"));
    for key in ["positions", "velocities"] {
        for (a, b) in numbers(&whole[key]).into_iter().zip(numbers(&second[key])) {
            approx::assert_abs_diff_eq!(a, b, epsilon = 1e-14);
        }
    }
    assert_eq!((&second["time"], &second["steps"]), (&json!(0.1), &json!(4)));
    let times: Vec<f64> = sandbox.csv("second/energy.csv").iter().map(|row| row[0]).collect();
    assert_eq!((times.len(), times[0], times[4]), (5, 0.06, 0.1));
    // What moves by itself has no rounding of its own.
    sandbox.put("triangle.toml", TRIANGLE);
    run(&sandbox, "triangle.toml --steps 10 --out whole");
    run(&sandbox, "triangle.toml --steps 6 --out first");
    run(&sandbox, "triangle.toml --duration 0.04 --at first/final.json --out second");
    for key in ["positions", "velocities", "time"] {
        assert_eq!(sandbox.json("whole/final.json")[key], sandbox.json("second/final.json")[key], "{key}");
    }
    // A search and adaptive steps start there too.
    run(&sandbox, "driven.toml --rtol 1e-3 --duration 0.04 --at first/final.json --out second");
    assert_eq!(sandbox.json("second/summary.json")["time"], 0.1);
    run(&sandbox, "driven.toml --accuracy 1e-2 --duration 0.04 --at first/final.json --out second");
    assert_eq!(sandbox.json("second/summary.json")["time"], 0.1);
    assert_eq!(sandbox.csv("second/energy.csv")[0][0], 0.06);
}

fn numbers(rows: &Value) -> Vec<f64> {
    rows.as_array().unwrap().iter().flat_map(|row| row.as_array().unwrap()).map(|x| x.as_f64().unwrap()).collect()
}

/// Two particles on a line: the scene is changed in mid-run. A spring without a rest length of its own keeps the distance of the scene's positions, not that of the state.
#[test]
fn a_scene_is_changed_in_mid_run() {
    let sandbox = Sandbox::new();
    let scene = |constraints: &str, stiffness: &str| {
        let scene = format!(
            "particles = {{ positions = [[0], [1]], velocities = [[0], [2]], masses = 1 }}\n\
             springs = {{ pairs = [[0, 1]], stiffness = {stiffness} }}\n{constraints}time = {{ dt = 0.125, duration = 0.5 }}"
        );
        sandbox.put("line.toml", &scene);
    };
    let entry = |name: &str| {
        let text = sandbox.read(name);
        text.lines().last().unwrap().split(' ').next_back().unwrap().parse::<f64>().unwrap()
    };
    scene("constraints = [{ particles = [0] }]\n", "8");
    run(&sandbox, "line.toml --out first");
    let [stretched, fast] =
        ["positions", "velocities"].map(|key| sandbox.json("first/final.json")[key][1][0].as_f64().unwrap());
    assert!(stretched > 1.5);
    sandbox.sprung(&["matrix", "line.toml", "--at", "first/final.json", "--out", "m"]).ends_with(0);
    // b = m v/dt − k (l − l0) with l0 = 1 m, the distance at the scene's start.
    approx::assert_relative_eq!(entry("m/b.mtx"), fast / 0.125 - 8.0 * (stretched - 1.0), max_relative = 1e-13);
    assert_eq!(entry("m/K.mtx"), -8.0);
    // Stiffer, and let go.
    scene("", "80");
    sandbox.sprung(&["matrix", "line.toml", "--at", "first/final.json", "--out", "m"]).ends_with(0);
    assert_eq!((entry("m/K.mtx"), sandbox.read("m/dofs.csv").lines().count()), (-80.0, 3));
    run(&sandbox, "line.toml --at first/final.json --out second");
    assert!(sandbox.json("second/final.json")["positions"][0][0].as_f64().unwrap() > 0.1);
    // Held in flight: it stays where it was caught, at rest.
    scene("constraints = [{ particles = [0, 1] }]\n", "8");
    run(&sandbox, "line.toml --at first/final.json --out caught");
    let caught = sandbox.json("caught/final.json");
    assert_eq!((&caught["positions"][1][0], &caught["velocities"][1][0]), (&json!(stretched), &json!(0.0)));
    // Led on from where it was caught.
    scene("constraints = [{ particles = [0] }, { particles = [1], velocity = [3] }]\n", "8");
    run(&sandbox, "line.toml --at first/final.json --out led");
    let led = sandbox.json("led/final.json")["positions"][1][0].as_f64().unwrap();
    approx::assert_relative_eq!(led, stretched + 3.0 * 0.5, max_relative = 1e-14);
}

#[test]
fn the_other_commands_look_at_the_state_too() {
    let sandbox = Sandbox::with("triangle.toml", TRIANGLE);
    run(&sandbox, "triangle.toml --steps 6 --out o");
    let inspect =
        |more: &[&str]| sandbox.sprung(&[&["inspect", "triangle.toml", "--json"], more].concat()).ends_with(0).json();
    let (at, steps) = (inspect(&["--at", "o/final.json"]), inspect(&["--steps", "6"]));
    assert_eq!((&at["time"], &at["lambda_min"]), (&steps["time"], &steps["lambda_min"]));
    assert_ne!(at["lambda_min"], inspect(&[])["lambda_min"]);
    let text = |more: &[&str]| sandbox.sprung(&[&["inspect", "triangle.toml"], more].concat()).ends_with(0).stdout;
    let (at, start) = (text(&["--at", "o/final.json"]), "falling triangle at this state: ");
    assert!(at.starts_with("falling triangle at this state, t = 0.0600 s: "), "{at}");
    assert!(sandbox.read("out/falling-triangle/inspect.html").contains(" − K at t\u{a0}=\u{a0}0.0600\u{a0}s, "));
    assert!(text(&[]).starts_with(start));
    assert!(sandbox.read("out/falling-triangle/inspect.html").contains(" − K at the initial state, "));
    let further = inspect(&["--at", "o/final.json", "--steps", "2"]);
    assert_eq!(further["lambda_min"], inspect(&["--steps", "8"])["lambda_min"]);

    let answer = sandbox.sprung(&["view", "triangle.toml", "--at", "o/final.json", "-o", "there.html"]).ends_with(0);
    assert!(answer.stdout.contains("the scene at t = 0.06 s"), "{}", answer.stdout);
    sandbox.sprung(&["view", "triangle.toml", "-o", "start.html"]).ends_with(0);
    assert_ne!(sandbox.read("there.html"), sandbox.read("start.html"));
    let answer = sandbox.sprung(&["view", "o", "--at", "o/final.json"]).ends_with(2);
    answer.complains(&["o: --at shows a scene at another state, and this is a run"]);
}

/// A state that does not fit is refused by file, key, index and value, and nothing is written.
#[test]
fn states_that_do_not_fit_are_refused() {
    let sandbox = Sandbox::with("triangle.toml", TRIANGLE);
    let good = r#"{"time": 0.5, "positions": [[0, 0], [1, 0], [0, 1]], "velocities": [[0, 0], [0, 0], [0, 0]]}"#;
    let cases = [
        (
            good.replace("[[0, 0], [1, 0], [0, 1]]", "[[0, 0], [1, 0]]"),
            "positions = a list of 2: must have one entry for each of the 3 particles",
        ),
        (
            good.replace("[[0, 0], [0, 0], [0, 0]]", "[]"),
            "velocities = a list of 0: must have one entry for each of the 3 particles",
        ),
        (good.replace("[1, 0]", "[1, 0, 2]"), "positions[1] = [1.0, 0.0, 2.0]: must have 2 entries"),
        (good.replace("[1, 0]", "[1]"), "positions[1] = [1.0]: must have 2 entries"),
        (good.replace("[1, 0]", "[1, null]"), "positions[1][1]: is null"),
        (good.replace("[1, 0]", "[1, NaN]"), "positions[1][1]: "),
        (good.replace("[1, 0]", "[1, 1e999]"), "positions[1][1]: number out of range"),
        (good.replace("[1, 0]", "[1, 1e151]"), "positions[1] = [1.0, 1e151]: must be at most 1e150"),
        (
            good.replace("[1, 0]", "[0, 0]"),
            "positions[1] = [0.0, 0.0]: is where particle 0 is: spring 0 has zero length",
        ),
        (good.replace("0.5", "\"soon\""), "time: "),
        (good.replace("\"time\": 0.5,", ""), "time"),
        (good.replace("0.5", "1e18"), "time = 1000000000000000000: is too late for steps of 0.01 s"),
        (String::new(), "must be a state as final.json has it: the text ends in a value"),
        (TRIANGLE.into(), "must be a state as final.json has it: expected "),
    ];
    for (text, part) in &cases {
        sandbox.put("state.json", text);
        let answer = sandbox.sprung(&["run", "triangle.toml", "--at", "state.json"]).ends_with(2);
        answer.complains(&["state.json: ", part]);
        assert_eq!(sandbox.names("."), ["state.json", "triangle.toml"], "{text}");
    }
    sandbox.sprung(&["matrix", "triangle.toml", "--at", "none.json"]).ends_with(2).complains(&["none.json: "]);
    sandbox.put("state.json", good);
    sandbox.sprung(&["run", "triangle.toml", "--at", "state.json"]).ends_with(0);
}
