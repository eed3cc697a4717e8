//! `sprung equilibrium`, `sprung modes` and `sprung mechanisms`.

use crate::run::TRIANGLE;
use crate::sandbox::Sandbox;
use serde_json::{Value, json};
use std::fs::File;

/// Two bars from supports up to a joint that carries a weight.
fn truss(height: f64, mass: f64) -> String {
    format!(
        r#"
name = "truss"
gravity = [0.0, -9.81]
[particles]
positions = [[-1.0, 0.0], [1.0, 0.0], [0.0, {height}]]
masses = [1.0, 1.0, {mass}]
[springs]
pairs = [[0, 2], [1, 2]]
stiffness = 1000.0
[[constraints]]
particles = [0, 1]
"#
    )
}

/// A square of bars at rest on nothing, with so many of its diagonals.
fn square(diagonals: usize) -> String {
    let pairs = ["[0, 1], [1, 2], [2, 3], [3, 0]", ", [0, 2]", ", [1, 3]"][..=diagonals].concat();
    format!(
        r#"
name = "square"
[particles]
positions = [[0, 0], [1, 0], [1, 1], [0, 1]]
masses = 2.0
[springs]
pairs = [{pairs}]
stiffness = 4.0
damping = 0.1
"#
    )
}

/// An equilateral triangle at rest, with κ = 4 N/m and masses of 2 kg: ω² = 3κ/2m twice and 3κ/m once.
const EQUILATERAL: &str = r#"
name = "triangle"
[particles]
positions = [[0.0, 0.0], [1.0, 0.0], [0.5, 0.8660254037844386]]
masses = 2.0
[springs]
pairs = [[0, 1], [1, 2], [2, 0]]
stiffness = 4.0
rest_lengths = 1.0
damping = 0.1
"#;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

/// An array of a NumPy archive with its shape.
fn array(sandbox: &Sandbox, file: &str, name: &str) -> (Vec<u64>, Vec<f64>) {
    let mut archive = zip::ZipArchive::new(File::open(sandbox.path(file)).unwrap()).unwrap();
    let npy = npyz::NpyFile::new(archive.by_name(&format!("{name}.npy")).unwrap()).unwrap();
    (npy.shape().to_vec(), npy.into_vec().unwrap())
}

#[test]
fn a_cloth_comes_to_rest() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "6");
    let answer = sandbox.sprung(&["equilibrium", "cloth.toml", "--json"]).ends_with(0);
    let found = answer.json();
    assert_eq!(answer.stderr, "");
    assert_eq!(found, sandbox.json("out/cloth/equilibrium.json"));
    assert_eq!(sandbox.names("out/cloth"), ["equilibrium.html", "equilibrium.json"]);
    assert_eq!(found["status"], "stable");
    assert!(found["residual"].as_f64().unwrap() <= 1e-10);
    assert_eq!(found["inertia"]["negative"], 0);
    assert_eq!(found["inertia"]["zero"], 0);
    assert_eq!(found["critical_loads"], json!([]));
    // Other commands start there, and nothing moves.
    let state = "out/cloth/equilibrium.json";
    let run = ["run", "cloth.toml", "--at", state, "--dt", "0.01", "--steps", "20", "--out", "run"];
    sandbox.sprung(&run).ends_with(0);
    let after = sandbox.json("run/final.json");
    for (x, y) in found["positions"].as_array().unwrap().iter().zip(after["positions"].as_array().unwrap()) {
        for (x, y) in numbers(x).into_iter().zip(numbers(y)) {
            approx::assert_abs_diff_eq!(x, y, epsilon = 1e-7);
        }
    }
    let again = sandbox.sprung(&["equilibrium", "cloth.toml", "--at", state, "--json", "--out", "o"]).ends_with(0);
    assert!(again.json()["iterations"].as_u64().unwrap() <= 1);
    let vibrations = sandbox.sprung(&["modes", "cloth.toml", "--at", state, "-n", "3", "--json"]).ends_with(0).json();
    assert_eq!((&vibrations["complete"], &vibrations["zero_modes"]), (&json!(true), &json!(0)));
    assert!(vibrations["imbalance"].as_f64().unwrap() <= 1e-10);
    let same = sandbox.sprung(&["modes", "cloth.toml", "--at", "equilibrium", "-n", "3", "--json"]).ends_with(0).json();
    for (a, b) in numbers(&vibrations["eigenvalues"]).into_iter().zip(numbers(&same["eigenvalues"])) {
        approx::assert_relative_eq!(a, b, max_relative = 1e-6);
    }
}

#[test]
fn a_body_that_falls_has_no_equilibrium() {
    let sandbox = Sandbox::with("triangle.toml", TRIANGLE);
    let answer = sandbox.sprung(&["equilibrium", "triangle.toml", "--json", "--out", "o"]).ends_with(1);
    let found = answer.json();
    assert_eq!((&found["status"], &found["falling"]), (&json!("none"), &json!([0, 1, 2])));
    answer.complains(&["error: none: nothing holds particles 0–2 against their load"]);
    let answer = sandbox.sprung(&["modes", "triangle.toml", "--at", "equilibrium", "--out", "modes"]).ends_with(1);
    assert_eq!(answer.stdout, "");
    answer.complains(&["no equilibrium was found: none: nothing holds particles 0–2"]);
    assert_eq!(sandbox.names("."), ["o", "triangle.toml"]);
}

#[test]
fn a_body_without_a_load_is_indifferent() {
    let sandbox = Sandbox::with("square.toml", &square(1));
    let found = sandbox.sprung(&["equilibrium", "square.toml", "--json"]).ends_with(0).json();
    assert_eq!((&found["status"], &found["inertia"]["zero"]), (&json!("indifferent"), &json!(3)));
}

/// The limit point of the textbook, P = 2k (1 − (a/l0)^{2/3})^{3/2}, and the files of a load path.
#[test]
fn a_shallow_truss_snaps_through() {
    let sandbox = Sandbox::new();
    let (height, mass): (f64, f64) = (0.3, 1.7);
    sandbox.put("truss.toml", &truss(height, mass));
    let answer = sandbox.sprung(&["equilibrium", "truss.toml", "--load-path", "10", "--json"]).ends_with(0);
    let found = answer.json();
    let limit = 2000.0 * (1.0 - 1.0 / f64::hypot(1.0, height).powf(2.0 / 3.0)).powf(1.5);
    let critical = numbers(&found["critical_loads"]);
    assert_eq!((critical.len(), &found["critical_kinds"]), (1, &json!(["limit point"])));
    assert!((critical[0] * mass * 9.81 / limit - 1.0).abs() < 1e-8, "{critical:?}");
    assert_eq!(found["status"], "stable");
    assert_eq!(sandbox.names("out/truss"), ["buckling.html", "equilibrium.html", "equilibrium.json", "load-path.svg"]);
    assert!(sandbox.read("out/truss/load-path.svg").contains("limit point at"));
    let buckling = sandbox.read("out/truss/buckling.html");
    assert!(buckling.contains("limit point at") && buckling.contains("of the full load"));
    assert!(sandbox.read("out/truss/equilibrium.html").contains("\"clock\":[\"load\",\"\"]"));
    // Without a path an older picture of one goes.
    sandbox.sprung(&["equilibrium", "truss.toml"]).ends_with(0);
    assert_eq!(sandbox.names("out/truss"), ["equilibrium.html", "equilibrium.json"]);
}

#[test]
fn modes_are_those_of_the_textbook() {
    let sandbox = Sandbox::with("triangle.toml", EQUILATERAL);
    let found = sandbox.sprung(&["modes", "triangle.toml", "--json"]).ends_with(0).json();
    assert_eq!(found, sandbox.json("out/triangle/modes.json"));
    assert_eq!(sandbox.names("out/triangle"), ["modes.html", "modes.json", "modes.npz"]);
    assert_eq!((&found["scene"], &found["at"]), (&json!("triangle"), &json!("start")));
    assert_eq!((&found["zero_modes"], &found["complete"]), (&json!(3), &json!(true)));
    let eigenvalues = numbers(&found["eigenvalues"]);
    for (value, expected) in eigenvalues.iter().zip([3.0, 3.0, 6.0]) {
        approx::assert_relative_eq!(*value, expected, max_relative = 1e-12);
    }
    assert!(found["counted_below"].as_f64().unwrap() > 5.9);
    for (frequency, value) in numbers(&found["frequencies"]).into_iter().zip(&eigenvalues) {
        approx::assert_relative_eq!(frequency, value.sqrt() / std::f64::consts::TAU, max_relative = 1e-12);
    }
    // G is K scaled: ζ = ω b/(2 κ).
    for (ratio, value) in numbers(&found["damping_ratios"]).into_iter().zip(&eigenvalues) {
        approx::assert_relative_eq!(ratio, value.sqrt() * 0.1 / 8.0, max_relative = 1e-9);
    }
    let file = "out/triangle/modes.npz";
    assert_eq!(array(&sandbox, file, "eigenvalues"), (vec![3], eigenvalues));
    for name in ["frequencies", "damping_ratios", "residuals"] {
        assert_eq!(array(&sandbox, file, name), (vec![3], numbers(&found[name])), "{name}");
    }
    assert_eq!(array(&sandbox, file, "effective_masses").0, [3, 3]);
    for name in ["shapes", "zero_shapes"] {
        let (shape, values) = array(&sandbox, file, name);
        assert_eq!(shape, [3, 3, 2], "{name}");
        // Orthonormal in M.
        for (k, a) in values.chunks(6).enumerate() {
            for (l, b) in values.chunks(6).enumerate() {
                let product: f64 = a.iter().zip(b).map(|(a, b)| 2.0 * a * b).sum();
                approx::assert_abs_diff_eq!(product, f64::from(u8::from(k == l)), epsilon = 1e-10);
            }
        }
    }
    let first = sandbox.sprung(&["modes", "triangle.toml", "-n", "1", "--json"]).ends_with(0).json();
    assert_eq!((numbers(&first["eigenvalues"]).len(), &first["complete"]), (1, &json!(true)));
}

/// A pressed column is no equilibrium's neighbour: its motion grows, and says so; frequencies are null.
/// Loose parts and parts that hang by one spring are named.
#[test]
fn modes_name_loose_parts() {
    let sandbox = Sandbox::new();
    let scene = |pairs: &str, end: &str| {
        format!(
            r#"
name = "triangles"
[particles]
positions = [[0, 0], [1, 0], [0, 1], [3, 0], [4, 0], [3, 1], [6, 0], [7, 0], [6, 1]]
masses = 1.0
[springs]
pairs = [[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [6, 7], [7, 8], [8, 6]{pairs}]
stiffness = 2.0
{end}"#
        )
    };
    sandbox.put("apart.toml", &scene("", ""));
    let text = sandbox.sprung(&["modes", "apart.toml"]).ends_with(0).stdout;
    assert!(text.contains("9 zero modes: 9 rigid motions, 0 mechanisms"), "{text}");
    assert!(text.contains("3 loose parts move freely: particles 0–2; 3–5; 6–8\n"), "{text}");
    assert!(!text.contains("hang"), "{text}");
    // The second hangs by a spring from the first, which is held, the third from the second: they turn about the support, and about the springs.
    sandbox.put("hanging.toml", &scene(", [1, 3], [4, 6]", "[[constraints]]\nparticles = [0, 1, 2]"));
    let answer = sandbox.sprung(&["modes", "hanging.toml"]).ends_with(0);
    assert!(answer.stdout.contains("4 zero modes: 1 rigid motion, 3 mechanisms"), "{}", answer.stdout);
    assert!(answer.stdout.contains("particles 3–8 hang by one spring\n"), "{}", answer.stdout);
    assert!(!answer.stdout.contains("loose"), "{}", answer.stdout);
    let found = sandbox.json("out/triangles/modes.json");
    assert_eq!((&found["parts"], &found["hanging"]), (&json!([]), &json!([[3, 4, 5, 6, 7, 8]])));
}

#[test]
fn growing_modes_have_no_frequency() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("column", "3");
    let answer = sandbox.sprung(&["modes", "column.toml", "-n", "2", "--json"]).ends_with(0).json();
    assert!(numbers(&answer["eigenvalues"])[0] < 0.0, "{answer}");
    assert_eq!((&answer["frequencies"][0], &answer["damping_ratios"][0]), (&Value::Null, &Value::Null));
    let text = sandbox.sprung(&["modes", "column.toml", "-n", "2"]).ends_with(0).stdout;
    assert!(text.contains("grows"), "{text}");
}

#[test]
fn a_square_has_a_mechanism_until_it_has_a_diagonal() {
    let sandbox = Sandbox::new();
    let find = |diagonals: usize| {
        sandbox.put("square.toml", &square(diagonals));
        sandbox.sprung(&["mechanisms", "square.toml", "--json"]).ends_with(0).json()
    };
    let found = find(0);
    for (key, value) in [
        ("scene", json!("square")),
        ("degrees_of_freedom", json!(8)),
        ("springs", json!(4)),
        ("rank", json!(4)),
        ("mechanisms", json!(4)),
        ("rigid_motions", json!(3)),
        ("self_stresses", json!(0)),
        ("decided", json!(true)),
        ("prestress_stable", json!(false)),
    ] {
        assert_eq!(found[key], value, "{key}");
    }
    assert_eq!((found["movers"].as_array().unwrap().len(), found["gap"].as_array().unwrap().len()), (1, 2));
    assert_eq!(found["added_springs"].as_array().unwrap().len(), 1);
    assert_eq!(sandbox.names("out/square"), ["mechanisms.html", "mechanisms.json"]);
    let text = sandbox.sprung(&["mechanisms", "square.toml"]).ends_with(0).stdout;
    assert!(text.contains("1 mechanism beside 3 rigid motions"), "{text}");
    // The page of an earlier scene goes.
    let found = find(1);
    assert_eq!((&found["mechanisms"], &found["self_stresses"]), (&json!(3), &json!(0)));
    assert_eq!(sandbox.names("out/square"), ["mechanisms.json"]);
    assert_eq!(find(2)["self_stresses"], 1);
}

#[test]
fn json_is_alone_on_stdout_and_quiet_is_silent() {
    let sandbox = Sandbox::with("square.toml", &square(0));
    for command in ["equilibrium", "modes", "mechanisms"] {
        let answer = sandbox.sprung(&[command, "square.toml", "--quiet"]).ends_with(0);
        assert_eq!((answer.stdout.as_str(), answer.stderr.as_str()), ("", ""), "{command}");
        let text = sandbox.sprung(&[command, "square.toml"]).ends_with(0).stdout;
        let page = text.lines().last().unwrap().strip_prefix("open ").unwrap();
        assert!(sandbox.path(page).is_file(), "{page}");
    }
}

/// The files are the same for any number of threads.
#[test]
fn files_do_not_depend_on_threads() {
    let sandbox = Sandbox::new();
    sandbox.put("net.toml", &sandbox.sprung(&["new", "network", "--size", "30"]).ends_with(0).stdout);
    for command in ["equilibrium", "modes", "mechanisms"] {
        for threads in ["1", "2"] {
            sandbox.sprung(&[command, "net.toml", "--threads", threads, "--out", threads]);
        }
    }
    assert_eq!(sandbox.names("1"), sandbox.names("2"));
    for name in sandbox.names("1") {
        let read = |folder: &str| std::fs::read(sandbox.path(folder).join(&name)).unwrap();
        assert!(read("1") == read("2"), "{name}");
    }
}

#[test]
fn a_scene_in_which_nothing_can_move_is_no_failure() {
    let sandbox = Sandbox::with(
        "held.toml",
        "particles = { positions = [[1, 2]], masses = 1 }\nconstraints = [{ particles = [0] }]",
    );
    let found = sandbox.sprung(&["equilibrium", "held.toml", "--json", "--out", "o"]).ends_with(0).json();
    assert_eq!(found["status"], "stable");
    let answer = sandbox.sprung(&["modes", "held.toml", "--json", "--out", "o"]).ends_with(0);
    assert_eq!((&answer.json()["eigenvalues"], answer.stderr.as_str()), (&json!([]), ""));
    let found = sandbox.sprung(&["mechanisms", "held.toml", "--json", "--out", "o"]).ends_with(0).json();
    assert_eq!(found["mechanisms"], 0);
    assert_eq!(
        sandbox.names("o"),
        ["equilibrium.html", "equilibrium.json", "mechanisms.json", "modes.json", "modes.npz"]
    );
}

#[test]
fn unusable_arguments_are_refused_before_anything_is_written() {
    let sandbox = Sandbox::with("square.toml", &square(0));
    sandbox.put("other.json", r#"{"time": 0.0, "positions": [[0, 0]], "velocities": [[0, 0]]}"#);
    sandbox.put("bad.toml", &square(0).replace("[1, 0],", "[0, 0],"));
    let cases: [(&[&str], &[&str]); 9] = [
        (&["equilibrium", "missing.toml"], &["missing.toml"]),
        (&["equilibrium", "square.toml", "--load-path", "0"], &["'0'", "--load-path", "above zero"]),
        (&["equilibrium", "square.toml", "--at", "other.json"], &["other.json", "positions", "4"]),
        (&["modes", "square.toml", "-n", "0"], &["'0'", "above zero"]),
        (&["modes", "square.toml", "--at", "nowhere.json"], &["nowhere.json"]),
        (&["modes", "square.toml", "--at", "other.json"], &["other.json", "positions", "4"]),
        (&["mechanisms", "square.toml", "--out", "square.toml"], &["square.toml", "not a directory"]),
        (&["mechanisms", "square.toml", "--at", "nowhere.json"], &["nowhere.json"]),
        (&["mechanisms", "bad.toml"], &["bad.toml", "springs"]),
    ];
    for (arguments, parts) in cases {
        sandbox.sprung(arguments).ends_with(2).complains(parts);
        assert_eq!(sandbox.names("."), ["bad.toml", "other.json", "square.toml"], "{arguments:?}");
    }
}
