//! A system and a state, written as a scene, give the same system in the same state, moving on in the same way.

use approx::assert_relative_eq;
use sprung::scene::{Kind, Scene, builtin};
use sprung::system::Axes;
use sprung::{Constraint, Motion, State, System};

fn same_system(left: &System, right: &System) {
    assert_eq!(left.dimension(), right.dimension());
    assert_eq!(left.gravity(), right.gravity());
    assert_eq!(left.masses(), right.masses());
    assert_eq!(left.pairs(), right.pairs());
    assert_eq!(left.springs(), right.springs());
    assert_eq!(left.dofs(), right.dofs());
    assert_eq!(left.active_springs(), right.active_springs());
}

fn rebuilt(system: &System, state: &State) -> (System, State) {
    Scene::from_toml(&Scene::snapshot("kept", system, state).to_toml()).unwrap().build().unwrap()
}

#[test]
fn every_builtin_scene_comes_back_from_its_system() {
    for kind in Kind::ALL {
        let (system, state) = builtin(kind, kind.default_size()).unwrap().build().unwrap();
        let (again, start) = rebuilt(&system, &state);
        same_system(&system, &again);
        assert_eq!(state, start);
    }
}

#[test]
fn a_state_on_the_way_starts_a_scene_of_its_own() {
    let (system, mut state) = builtin(Kind::Pendulum, 3).unwrap().build().unwrap();
    state.time = 1.25;
    for (i, (x, v)) in state.positions.iter_mut().zip(&mut state.velocities).enumerate().skip(1) {
        x.y -= 0.1 / (i as f64 + 2.0);
        v.x = -1.0 / (i as f64 + 6.0);
    }
    let (again, start) = rebuilt(&system, &state);
    same_system(&system, &again);
    assert_eq!(State { time: 0.0, ..state }, start);
}

/// Every kind of motion, some of it overridden, on different axes of four particles.
fn moving() -> (System, State) {
    let path = |times: [f64; 3]| Motion::Path {
        times: times.to_vec(),
        offsets: vec![[0.0, 0.1, 0.2].into(), [0.5, 0.0, 0.0].into(), [0.3, -0.4, 0.7].into()],
    };
    let constrain = |particles: &[usize], axes: &[usize], motion| Constraint {
        particles: particles.to_vec(),
        axes: Axes::of(axes),
        motion,
    };
    let mut builder = sprung::SystemBuilder::new();
    for i in 0..4 {
        builder.particle([f64::from(i), 0.3 * f64::from(i * i), 0.1], 1.0 + f64::from(i));
    }
    builder.constrain(constrain(&[0, 1, 2], &[0, 1, 2], Motion::Velocity([0.1, 0.2, -0.3].into())));
    builder.constrain(constrain(&[1], &[1, 2], path([0.0, 0.7, 3.1])));
    builder.constrain(constrain(&[2, 3], &[0], Motion::Held));
    builder.constrain(constrain(&[3], &[2], path([0.5, 0.9, 1.0])));
    builder.build().unwrap()
}

#[test]
fn motions_go_on_from_any_time() {
    // Before, on and between the breakpoints, and after the last.
    for kept_at in [0.0, 0.3, 0.7, 0.95, 2.0, 5.0] {
        let (system, mut state) = moving();
        state.time = kept_at;
        state.prescribe(&system);
        let (again, mut later) = rebuilt(&system, &state);
        same_system(&system, &again);
        // Off the breakpoints, where rounding could choose another piece and so another velocity.
        for elapsed in [0.0, 0.01, 0.123, 0.456, 1.5, 4.321] {
            state.time = kept_at + elapsed;
            later.time = elapsed;
            state.prescribe(&system);
            later.prescribe(&again);
            for particle in 0..4 {
                // Times and positions of a few units are rounded to 1e-15, and speeds go up to 7 m/s.
                assert_relative_eq!(state.positions[particle], later.positions[particle], epsilon = 1e-14);
            }
        }
    }
}

#[test]
fn at_time_zero_every_motion_is_kept_to_the_bit() {
    let (system, state) = moving();
    let (again, start) = rebuilt(&system, &state);
    assert_eq!(state, start);
    let motions = |system: &System| {
        let motion =
            |(dof, start, motion): (_, f64, usize)| (dof, start, system.prescribed().motions()[motion].clone());
        system.prescribed().iter().map(motion).collect::<Vec<_>>()
    };
    assert_eq!(motions(&system), motions(&again));
}
