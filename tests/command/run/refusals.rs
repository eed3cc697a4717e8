//! What `sprung run` refuses, before it writes anything.

use super::triangle;
use crate::sandbox::Sandbox;

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
