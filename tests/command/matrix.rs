//! `sprung matrix`: files that hold the linear system of the first step.

use crate::sandbox::{Sandbox, repository_scene};
use nalgebra::{DMatrix, DVector};
use serde_json::json;
use sprung::assembly::SymmetricMatrix;
use sprung::integrate::StepMatrices;
use sprung::{Scene, Stiffness};

/// One-dimensional, every number exact in binary: two free particles and one that is led away.
const LINE: &str = r#"
name = "line"
gravity = [-1]
particles = { positions = [[0], [2.5], [6.5]], velocities = [[1], [-1], [9]], masses = [2, 3, 1] }
springs = { pairs = [[0, 1], [1, 2]], stiffness = 8, rest_lengths = [2, 4], damping = [0.5, 0] }
constraints = [{ particles = [2], velocity = [0.5] }]
time = { dt = 0.5 }
"#;

/// The matrix of a file, both triangles; checks the header.
fn matrix(sandbox: &Sandbox, name: &str) -> DMatrix<f64> {
    let text = sandbox.read(name);
    assert!(text.starts_with("%%MatrixMarket matrix coordinate real symmetric\n"), "{text}");
    let mut lines =
        text.lines().skip_while(|line| line.starts_with('%')).map(|line| line.split(' ').collect::<Vec<_>>());
    let size: Vec<usize> = lines.next().unwrap().iter().map(|field| field.parse().unwrap()).collect();
    let mut full = DMatrix::zeros(size[0], size[1]);
    let mut entries = 0;
    for fields in lines {
        let [row, column] = [0, 1].map(|at| fields[at].parse::<usize>().unwrap() - 1);
        let value: f64 = fields[2].parse().unwrap();
        assert!(row >= column, "{fields:?} is above the diagonal");
        full[(row, column)] = value;
        full[(column, row)] = value;
        entries += 1;
    }
    assert_eq!(entries, size[2]);
    full
}

/// The vector of a file; checks the header.
fn vector(sandbox: &Sandbox, name: &str) -> DVector<f64> {
    let text = sandbox.read(name);
    assert!(text.starts_with("%%MatrixMarket matrix array real general\n"), "{text}");
    let mut lines = text.lines().skip_while(|line| line.starts_with('%'));
    let size = lines.next().unwrap();
    let values: Vec<f64> = lines.map(|line| line.parse().unwrap()).collect();
    assert_eq!(size, format!("{} 1", values.len()));
    DVector::from_vec(values)
}

fn dense(matrix: &SymmetricMatrix) -> DMatrix<f64> {
    DMatrix::from(&matrix.to_coo())
}

#[test]
fn a_small_system_is_the_one_worked_out_by_hand() {
    let sandbox = Sandbox::with("line.toml", LINE);
    sandbox.sprung(&["matrix", "line.toml"]).ends_with(0);
    let names = ["A.mtx", "G.mtx", "K.mtx", "M.mtx", "b.mtx", "dofs.csv"];
    assert_eq!(sandbox.names("out/line"), names);

    let square = |values: [f64; 4]| DMatrix::from_row_slice(2, 2, &values);
    // k/l0 is 4 and 2 N/m; the spring to the led particle adds to the diagonal only.
    assert_eq!(matrix(&sandbox, "out/line/M.mtx"), square([2.0, 0.0, 0.0, 3.0]));
    assert_eq!(matrix(&sandbox, "out/line/G.mtx"), square([-0.5, 0.5, 0.5, -0.5]));
    assert_eq!(matrix(&sandbox, "out/line/K.mtx"), square([-4.0, 4.0, 4.0, -6.0]));
    // M/dt² − G/dt − K
    assert_eq!(matrix(&sandbox, "out/line/A.mtx"), square([8.0 + 1.0 + 4.0, -5.0, -5.0, 12.0 + 1.0 + 6.0]));
    // M v/dt + M gravity + f_el, and −A_fc δx_c with A_fc = −2 N/m and δx_c = 0.25 m. The strain of spring 0 is 1/4.
    let b = DVector::from_vec(vec![4.0 - 2.0 + 2.0, -6.0 - 3.0 - 2.0 + 0.5]);
    assert_eq!(vector(&sandbox, "out/line/b.mtx"), b);
    assert_eq!(sandbox.read("out/line/dofs.csv"), "row,particle,axis\n0,0,x\n1,1,x\n");
}

#[test]
fn every_option_writes_what_the_library_assembles() {
    let sandbox = Sandbox::new();
    let file = repository_scene("two_springs.toml");
    let (system, state) = Scene::load(&file).unwrap().build().unwrap();
    for option in Stiffness::ALL {
        let arguments = ["matrix", &file, "--stiffness", option.name(), "--dt", "0.03", "--out", "o"];
        sandbox.sprung(&arguments).ends_with(0);
        let expected = StepMatrices::assemble(&system, &state, option, 0.03).unwrap();
        let files = ["o/A.mtx", "o/M.mtx", "o/G.mtx", "o/K.mtx"].map(|name| matrix(&sandbox, name));
        let [a, m, g, k] = &files;
        let masses = DMatrix::from_diagonal(&DVector::from_vec(expected.m.clone()));
        assert_eq!(files, [dense(&expected.a), masses, dense(&expected.g), dense(&expected.k)]);
        assert_eq!(vector(&sandbox, "o/b.mtx").as_slice(), expected.b);

        let composed = m / (0.03 * 0.03) - g / 0.03 - k;
        approx::assert_relative_eq!(*a, composed, epsilon = 0.0, max_relative = 1e-14);
        // Spring 1 is compressed: only "full" keeps what makes K indefinite.
        let indefinite = k.clone().symmetric_eigenvalues().max() > 1e-10;
        assert_eq!(indefinite, option == Stiffness::Full, "{}", option.name());
    }
}

#[test]
fn solving_the_files_gives_the_first_step_of_a_run() {
    let sandbox = Sandbox::new();
    let file = repository_scene("moving_anchor.toml");
    sandbox.sprung(&["matrix", &file, "--stiffness", "tension", "--out", "o"]).ends_with(0);
    sandbox.sprung(&["run", &file, "--stiffness", "tension", "--steps", "1", "--out", "o"]).ends_with(0);
    let displacement = matrix(&sandbox, "o/A.mtx").cholesky().unwrap().solve(&vector(&sandbox, "o/b.mtx"));

    let (_, state) = Scene::load(&file).unwrap().build().unwrap();
    let last = sandbox.json("o/final.json");
    let mut rows = 0;
    for line in sandbox.read("o/dofs.csv").lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let [row, particle] = [0, 1].map(|at| fields[at].parse::<usize>().unwrap());
        let axis = ["x", "y", "z"].iter().position(|name| *name == fields[2]).unwrap();
        let moved = last["positions"][particle][axis].as_f64().unwrap() - state.positions[particle][axis];
        approx::assert_abs_diff_eq!(moved, displacement[row], epsilon = 1e-14);
        rows += 1;
    }
    assert!(rows == displacement.len() && displacement.amax() > 1e-4, "{rows} rows, {}", displacement.amax());
}

#[test]
fn the_default_is_the_full_stiffness() {
    let sandbox = Sandbox::new();
    let file = repository_scene("two_springs.toml");
    sandbox.sprung(&["matrix", &file, "--out", "default"]).ends_with(0);
    sandbox.sprung(&["matrix", &file, "--out", "full", "--stiffness", "full"]).ends_with(0);
    for name in sandbox.names("full") {
        assert_eq!(sandbox.read(&format!("default/{name}")), sandbox.read(&format!("full/{name}")));
    }
}

#[test]
fn rows_are_the_free_coordinates_by_particle_then_axis() {
    let sandbox = Sandbox::new();
    let scene = r#"
    particles = { positions = [[0, 0], [1, 0], [2, 1]], masses = 1 }
    springs = { pairs = [[0, 1], [1, 2]], stiffness = 5 }
    constraints = [{ particles = [0] }, { particles = [2], axes = ["x"] }]
    "#;
    sandbox.put("roller.toml", scene);
    sandbox.sprung(&["matrix", "roller.toml", "--dt", "0.1", "--out", "o"]).ends_with(0);
    assert_eq!(sandbox.read("o/dofs.csv"), "row,particle,axis\n0,1,x\n1,1,y\n2,2,y\n");
    assert_eq!(matrix(&sandbox, "o/A.mtx").shape(), (3, 3));
    // Without damping.
    assert_eq!(matrix(&sandbox, "o/G.mtx"), DMatrix::zeros(3, 3));
}

#[test]
fn a_scene_in_which_nothing_can_move_has_empty_matrices() {
    let sandbox = Sandbox::with(
        "held.toml",
        "particles = { positions = [[1, 2]], masses = 1 }\nconstraints = [{ particles = [0] }]",
    );
    sandbox.sprung(&["matrix", "held.toml", "--dt", "0.1", "--out", "o"]).ends_with(0);
    assert_eq!(matrix(&sandbox, "o/A.mtx").shape(), (0, 0));
    assert_eq!(vector(&sandbox, "o/b.mtx").len(), 0);
    assert_eq!(sandbox.read("o/dofs.csv"), "row,particle,axis\n");
}

#[test]
fn json_is_alone_on_stdout_and_quiet_is_silent() {
    let sandbox = Sandbox::with("line.toml", LINE);
    let answer = sandbox.sprung(&["matrix", "line.toml", "--json", "--out", "o"]).ends_with(0);
    let expected = json!({
        "scene": "line", "time": 0.0, "dt": 0.5, "stiffness": "full", "particles": 3, "springs": 2, "dofs": 2,
        "entries": { "A": 3, "M": 2, "G": 3, "K": 3 }, "out": "o",
    });
    assert_eq!(answer.json(), expected);
    assert_eq!(answer.stderr, "");
    let answer = sandbox.sprung(&["matrix", "line.toml", "--quiet"]).ends_with(0);
    assert_eq!((answer.stdout.as_str(), answer.stderr.as_str()), ("", ""));
    let answer = sandbox.sprung(&["matrix", "line.toml"]).ends_with(0);
    assert!(answer.stdout.contains("2 degrees of freedom"), "{}", answer.stdout);
}

#[test]
fn unusable_arguments_are_refused_before_anything_is_written() {
    let sandbox = Sandbox::with("line.toml", LINE);
    let cases: [(&[&str], &[&str]); 7] = [
        (&["matrix", "line.toml", "--dt", "-1"], &["'-1'", "--dt"]),
        (&["matrix", "line.toml", "--stiffness", "on-demand"], &["'on-demand'", "--stiffness", "tension"]),
        (&["matrix", "line.toml", "--out", "line.toml"], &["line.toml", "not a directory"]),
        (&["matrix", "missing.toml"], &["missing.toml"]),
        (&["matrix", "line.toml", "--steps", "-3"], &["'-3'", "--steps"]),
        (&["matrix", "line.toml", "--steps", "3", "--at", "x.json"], &["x.json"]),
        (&["matrix", "line.toml", "--threads", "0"], &["'0'", "--threads", "must be a whole number from 1 to 1024"]),
    ];
    for (arguments, parts) in cases {
        sandbox.sprung(arguments).ends_with(2).complains(parts);
        assert_eq!(sandbox.names("."), ["line.toml"], "{arguments:?}");
    }
}

/// Where no step is given the customary one is taken, and that is said.
#[test]
fn a_step_that_is_not_given_is_named() {
    let sandbox = Sandbox::with("timeless.toml", LINE.split("time =").next().unwrap());
    let answer = sandbox.sprung(&["matrix", "timeless.toml", "--json"]).ends_with(0);
    assert_eq!(answer.json()["dt"], 0.01);
    answer.complains(&["no dt was given", "0.01 s"]);
}

#[test]
fn a_matrix_that_overflows_is_a_failed_computation() {
    let sandbox = Sandbox::with("line.toml", LINE);
    let answer = sandbox.sprung(&["matrix", "line.toml", "--dt", "1e-170"]).ends_with(1);
    answer.complains(&["A has entries that are not finite", "1e-170"]);
    assert_eq!(sandbox.names("."), ["line.toml"]);
}
