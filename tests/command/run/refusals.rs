//! What `sprung run` refuses, before it writes anything.

use super::{TRIANGLE, triangle};
use crate::sandbox::Sandbox;

#[test]
fn unusable_arguments_are_refused_before_anything_is_written() {
    let sandbox = triangle();
    sandbox.put("timeless.toml", &TRIANGLE[..TRIANGLE.find("[time]").unwrap()]);
    let cases: [(&[&str], &[&str]); 20] = [
        (&["run"], &["SCENE"]),
        (&["run", "missing.toml"], &["missing.toml"]),
        (&["run", "triangle.toml", "--dt", "0"], &["'0'", "--dt", "positive"]),
        (&["run", "triangle.toml", "--dt", "-0.1"], &["'-0.1'", "--dt", "positive"]),
        (&["run", "triangle.toml", "--dt", "nan"], &["'nan'", "--dt"]),
        (&["run", "triangle.toml", "--dt", "soon"], &["'soon'", "--dt", "not a number"]),
        (&["run", "triangle.toml", "--duration", "inf"], &["'inf'", "--duration"]),
        (&["run", "triangle.toml", "--steps", "-1"], &["'-1'", "--steps", "whole number"]),
        (&["run", "triangle.toml", "--steps", "1.5"], &["'1.5'", "--steps", "whole number"]),
        (&["run", "triangle.toml", "--frames", "0"], &["'0'", "--frames", "above zero"]),
        (&["run", "triangle.toml", "--threads", "0"], &["'0'", "--threads"]),
        (&["run", "triangle.toml", "--tolerance", "1"], &["'1'", "--tolerance", "between 0 and 1"]),
        (&["run", "triangle.toml", "--method", "rk4"], &["'rk4'", "--method", "linear-backward-euler"]),
        (&["run", "triangle.toml", "--stiffness", "soft"], &["'soft'", "--stiffness", "on-demand"]),
        (&["run", "triangle.toml", "--solver", "qr"], &["'qr'", "--solver", "cg-assembled"]),
        (&["run", "triangle.toml", "--preconditioner", "ilu"], &["'ilu'", "--preconditioner", "block-jacobi"]),
        (&["run", "triangle.toml", "--out"], &["--out"]),
        (&["run", "timeless.toml"], &["timeless.toml", "--duration", "time.duration"]),
        (&["run", "timeless.toml", "--dt", "0.1"], &["timeless.toml", "--duration", "time.duration"]),
        (&["run", "triangle.toml", "--out", "triangle.toml"], &["triangle.toml", "not a directory"]),
    ];
    for (arguments, parts) in cases {
        let answer = sandbox.sprung(arguments).ends_with(2);
        answer.complains(parts);
        assert_eq!(answer.stdout, "", "{arguments:?}");
        assert_eq!(sandbox.names("."), ["timeless.toml", "triangle.toml"], "{arguments:?}");
    }
}

#[test]
fn a_scene_whose_prescribed_motion_starts_on_another_particle_is_refused() {
    let sandbox = Sandbox::new();
    let scene = r#"
    particles = { positions = [[0], [1]], masses = 1 }
    springs = { pairs = [[0, 1]], stiffness = 1 }
    constraints = [{ particles = [1], path = { times = [0], offsets = [[-1]] } }]
    time = { dt = 0.1, duration = 1 }
    "#;
    sandbox.put("on_top.toml", scene);
    let answer = sandbox.sprung(&["run", "on_top.toml"]).ends_with(2);
    answer.complains(&["on_top.toml", "springs.pairs[0] = [0, 1]", "zero current length"]);
}

#[test]
fn a_run_that_cannot_write_all_of_its_files_does_not_start() {
    let sandbox = triangle();
    std::fs::create_dir_all(sandbox.path("o/final.json")).unwrap();
    sandbox.put("o/summary.json", "old");
    sandbox.sprung(&["run", "triangle.toml", "--out", "o"]).ends_with(2).complains(&["final.json", "directory"]);
    assert_eq!(sandbox.names("o"), ["final.json", "summary.json"]);
    assert_eq!(sandbox.read("o/summary.json"), "old");
}
