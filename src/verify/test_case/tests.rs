//! Steps, sizes and twins of small systems, by hand.

use super::*;
use crate::system::Motion;

fn spring(stiffness: f64, rest_length: f64, damping: f64) -> Spring {
    Spring { stiffness, rest_length, damping }
}

/// Particles of 2, 1 and 4 kg at x = 1, 3 and 8 m of the plane, joined by these springs; the first held, the last one led along x.
fn row(springs: [Spring; 2]) -> TestCase {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    builder.gravity(0.0, -9.0, 0.0);
    for (x, mass) in [(1.0, 2.0), (3.0, 1.0), (8.0, 4.0)] {
        builder.particle([x, 0.0, 0.0], mass);
    }
    builder.velocities[1] = Vector3::new(0.5, -1.0, 0.0);
    springs.into_iter().enumerate().for_each(|(n, spring)| {
        builder.spring(n, n + 1, spring);
    });
    builder.hold(0);
    let motion = Motion::Velocity(Vector3::new(2.0, 0.0, 0.0));
    builder.constrain(Constraint { particles: vec![2], axes: Axes::of(&[0]), motion });
    let (system, state) = builder.build().unwrap();
    TestCase { name: "row".into(), system, state, dt: 0.1 }
}

/// The springs are 2 and 5 m long. The stiffness of each is k over the shorter of length and rest length: 8/2 and 6/3 N/m, together
/// 6 N/m at the particle of 1 kg, so ω² ≤ 12. Of damping there are `2 (b₁ + b₂)/m` per second.
#[test]
fn a_step_resolves_vibrations_and_decays() {
    let step = |b: f64| row([spring(8.0, 4.0, b), spring(6.0, 3.0, 2.0 * b)]).resolving_step();
    assert!((step(0.125) - 0.5 / 12f64.sqrt()).abs() < 1e-15);
    assert!((step(2.0) - 0.5 / 12.0).abs() < 1e-15);
    assert!(
        (row([spring(8.0, 1.0, 0.0), spring(6.0, 12.0, 0.0)]).resolving_step() - 0.5 / 18.4f64.sqrt()).abs() < 1e-15
    );
}

/// Nothing pulls a lone particle, and between particles in one place no step is short enough.
#[test]
fn without_a_rate_the_step_is_a_second() {
    let mut builder = SystemBuilder::new();
    builder.particle([1.0, 2.0, 3.0], 1.0);
    let (system, state) = builder.build().unwrap();
    let lone = TestCase { name: "lone".into(), system, state, dt: 0.1 };
    assert_eq!((lone.resolving_step(), lone.extent()), (1.0, 1.0));
    let mut collapsed = row([spring(8.0, 4.0, 0.0); 2]);
    collapsed.state.positions[1] = collapsed.state.positions[0];
    assert_eq!(collapsed.resolving_step(), 1.0);
}

#[test]
fn the_size_is_the_largest_distance_from_the_mean() {
    let row = row([spring(8.0, 4.0, 0.0); 2]);
    assert_eq!((row.centre(), row.extent()), (Vector3::new(4.0, 0.0, 0.0), 4.0));
}

#[test]
fn twins_have_other_rest_lengths_and_nothing_else() {
    let row = row([spring(8.0, 3.0, 0.25), spring(6.0, 3.0, 0.0)]);
    let lengths = |twin: &TestCase| twin.system.springs().iter().map(|s| s.rest_length).collect::<Vec<_>>();
    assert_eq!(lengths(&row.relaxed().unwrap()), [2.0, 5.0]);
    assert_eq!(lengths(&row.stretched().unwrap()), [1.6, 3.0]);
    assert_eq!(lengths(&row.squeezed().unwrap()), [3.0, 6.25]);
    for twin in [row.stretched().unwrap(), row.squeezed().unwrap()] {
        assert_eq!((twin.state, twin.dt, twin.system.dofs().len()), (row.state.clone(), 0.1, 3));
        assert_eq!((twin.system.masses(), twin.system.gravity()), (row.system.masses(), row.system.gravity()));
        assert_eq!(
            twin.system.springs().iter().map(|s| (s.stiffness, s.damping)).collect::<Vec<_>>(),
            [(8.0, 0.25), (6.0, 0.0)]
        );
    }
}

#[test]
fn twins_are_freed_relaxed_or_put_into_space() {
    let row = row([spring(8.0, 3.0, 0.25), spring(6.0, 3.0, 0.0)]);
    let freed = row.freed().unwrap();
    assert_eq!((freed.name.as_str(), freed.system.dofs().len()), ("row, freed", 6));
    let relaxed = row.relaxed().unwrap();
    assert!(relaxed.state.velocities.iter().all(|v| v.norm() == 0.0) && relaxed.system.gravity().norm() == 0.0);
    assert!(!relaxed.system.prescribed().moves() && relaxed.system.dofs().len() == 3);
    let space = row.in_space().unwrap();
    assert_eq!((space.system.dimension(), space.system.dofs().len()), (3, 3));
    assert_eq!(space.state, row.state);
}

/// A scene's own step, or without one a step that resolves its vibrations.
#[cfg(feature = "scene")]
#[test]
fn a_scene_says_its_step_or_leaves_it() {
    let text = include_str!("../scenes/two_springs.toml");
    let mut scene = crate::scene::Scene::from_toml(text).unwrap();
    scene.time.dt = Some(0.0625);
    assert_eq!(TestCase::of_scene(&scene).unwrap().dt, 0.0625);
    scene.time.dt = None;
    let subject = TestCase::of_scene(&scene).unwrap();
    assert!(subject.dt > 0.0 && subject.dt == subject.resolving_step());
    assert!(crate::verify::built_in().unwrap().iter().all(|subject| subject.dt > 0.0));
}
