//! Which system a scene becomes: rows of 1, 2 and 3 numbers, one number for all, defaults, constraints, nothing at all.

use sprung::scene::Scene;
use sprung::{State, System};

fn build(toml: &str) -> (System, State) {
    Scene::from_toml(toml).unwrap().build().unwrap()
}

/// The rows, one entry per free degree of freedom, as "0x 0y 1x …".
fn dofs(system: &System) -> String {
    let names: Vec<String> = system.dofs().iter().map(|dof| format!("{}{}", dof.particle, dof.axis_name())).collect();
    names.join(" ")
}

#[test]
fn the_length_of_the_rows_is_the_dimension() {
    for (rows, dimension, expected) in [
        ("[[1], [2]]", 1, "0x 1x"),
        ("[[1, 5], [2, 5]]", 2, "0x 0y 1x 1y"),
        ("[[1, 5, 6], [2, 5, 6]]", 3, "0x 0y 0z 1x 1y 1z"),
    ] {
        let (system, state) = build(&format!("particles = {{ positions = {rows}, masses = 1 }}"));
        assert_eq!((system.dimension(), dofs(&system).as_str()), (dimension, expected));
        let absent = |x: &nalgebra::Vector3<f64>| x.iter().skip(dimension).all(|&c| c == 0.0);
        assert!(state.positions.iter().all(absent));
        assert_eq!(state.positions[1].x, 2.0);
    }
}

#[test]
fn an_empty_scene_is_valid_and_has_the_dimension_of_its_gravity() {
    for (text, dimension) in [
        ("", 3),
        ("particles = {}\nsprings = {}\nconstraints = []", 3),
        ("gravity = [-9.81]", 1),
        ("gravity = [0, -9.81]\nparticles.masses = 1", 2),
    ] {
        let (system, state) = build(text);
        assert_eq!((system.dimension(), system.particles(), system.dofs().len()), (dimension, 0, 0), "{text:?}");
        assert!(system.springs().is_empty() && state.positions.is_empty());
    }
}

#[test]
fn one_number_is_for_all_and_what_is_absent_has_its_default() {
    let (system, state) = build(
        "particles = { positions = [[0, 0], [3, 4], [3, 0]], masses = 2 }
         springs = { pairs = [[0, 1], [1, 2]], stiffness = 7 }",
    );
    assert_eq!(system.masses(), [2.0; 3]);
    assert_eq!(system.gravity().norm(), 0.0);
    assert!(state.velocities.iter().all(|v| v.norm() == 0.0));
    let springs: Vec<_> = system.springs().iter().map(|s| (s.stiffness, s.rest_length, s.damping)).collect();
    assert_eq!(springs, [(7.0, 5.0, 0.0), (7.0, 4.0, 0.0)]);
    assert!(!system.is_damped());
}

#[test]
fn lists_are_taken_in_order() {
    let (system, state) = build(include_str!("../common/valid.toml"));
    assert_eq!(system.masses(), [1.0, 2.0, 3.0]);
    assert_eq!(system.pairs(), [[0, 1], [1, 2]]);
    let springs: Vec<_> = system.springs().iter().map(|s| (s.stiffness, s.rest_length, s.damping)).collect();
    assert_eq!(springs, [(100.0, 1.0, 0.3), (200.0, 1.2, 0.0)]);
    assert_eq!(system.gravity().as_slice(), [0.0, -9.81, 0.0]);
    assert_eq!(state.positions[2].as_slice(), [1.5, 0.9, 0.2]);
}

/// A particle at (1, 2) with the given constraints; its positions at the given times.
fn motion(constraints: &str, times: &[f64]) -> (String, Vec<[f64; 2]>) {
    let (system, mut state) = build(&format!("particles = {{ positions = [[1, 2]], masses = 1 }}\n{constraints}"));
    let at = |time: &f64| {
        state.time = *time;
        state.prescribe(&system);
        [state.positions[0].x, state.positions[0].y]
    };
    (dofs(&system), times.iter().map(at).collect())
}

#[test]
fn without_a_motion_all_axes_are_held() {
    let expected = (String::new(), vec![[1.0, 2.0], [1.0, 2.0]]);
    assert_eq!(motion("[[constraints]]\nparticles = [0]", &[0.0, 3.0]), expected);
}

#[test]
fn a_velocity_moves_only_the_prescribed_axes() {
    let constraint = "[[constraints]]\nparticles = [0]\naxes = [\"x\", \"x\"]\nvelocity = [0.5, 9]";
    assert_eq!(motion(constraint, &[0.0, 3.0]), ("0y".into(), vec![[1.0, 2.0], [2.5, 2.0]]));
}

#[test]
fn a_path_is_linear_in_between_and_clamped_at_both_ends() {
    let constraint = "[[constraints]]\nparticles = [0]\npath = { times = [1, 3], offsets = [[0.5, 0], [1.5, -4]] }";
    let expected = vec![[1.5, 2.0], [1.5, 2.0], [2.0, 0.0], [2.5, -2.0], [2.5, -2.0]];
    assert_eq!(motion(constraint, &[0.0, 1.0, 2.0, 3.0, 7.0]), (String::new(), expected));
}

#[test]
fn later_constraints_override_earlier_ones_axis_by_axis() {
    let constraints = "[[constraints]]\nparticles = [0]\nvelocity = [1, 1]\n
        [[constraints]]\nparticles = [0]\naxes = [\"y\"]\n";
    assert_eq!(motion(constraints, &[2.0]), (String::new(), vec![[3.0, 2.0]]));
}

#[test]
fn an_empty_list_of_axes_prescribes_nothing() {
    assert_eq!(motion("[[constraints]]\nparticles = [0]\naxes = []", &[1.0]), ("0x 0y".into(), vec![[1.0, 2.0]]));
}

#[test]
fn a_path_under_way_at_time_zero_moves_the_start_but_not_the_rest_length() {
    let (system, state) = build(
        "particles = { positions = [[0], [1]], masses = 1 }
         springs = { pairs = [[0, 1]], stiffness = 1 }
         constraints = [{ particles = [1], path = { times = [-1, 1], offsets = [[0], [1]] } }]",
    );
    assert_eq!((state.positions[1].x, state.velocities[1].x), (1.5, 0.5));
    assert_eq!(system.springs()[0].rest_length, 1.0);
}
