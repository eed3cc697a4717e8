//! What is written is read back, and nothing else is.

use super::{CHECKPOINT, Checkpoint, fingerprint, rows};
use crate::integrate::{Monitor, MonitorOptions, Statistics};
use crate::output::LogPosition;
use crate::spring::Spring;
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
use nalgebra::Vector3;

fn builder() -> SystemBuilder {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -9.81, 0.0);
    builder.particle([0.0, 0.1, 0.2], 1.0);
    builder.particle([1.0 / 3.0, 2.0, 3.0], 2.0);
    builder.spring(0, 1, Spring { stiffness: 5.0, rest_length: 1.0, damping: 0.5 });
    builder.hold(0);
    builder
}

fn checkpoint(system: &System, state: &State) -> Checkpoint {
    Checkpoint {
        run: "0123".into(),
        length: "None".into(),
        every: 5,
        reached: 10,
        steps: 10,
        time: 0.1 + 0.2,
        positions: rows(&state.positions),
        velocities: rows(&state.velocities),
        statistics: Statistics::default(),
        wall_seconds: 1.5,
        account: Monitor::new(system, state, MonitorOptions::default()).unwrap().account(),
        energies: LogPosition { bytes: 7, checksum: "89ab".into() },
        frames: vec![(0.0, 0), (0.3, 10)],
    }
}

#[test]
fn checkpoints_are_read_back_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(Checkpoint::read(folder.path()).unwrap(), None);
    let (system, state) = builder().build().unwrap();
    let written = checkpoint(&system, &state);
    assert_eq!(written.positions, [[0.0, 0.1, 0.2], [1.0 / 3.0, 2.0, 3.0]]);
    written.write(folder.path()).unwrap();
    let read = Checkpoint::read(folder.path()).unwrap().unwrap();
    assert_eq!((&read, read.state()), (&written, State { time: 0.1 + 0.2, ..state }));
    // A folder in its place is no checkpoint that is absent.
    let other = tempfile::tempdir().unwrap();
    std::fs::create_dir(other.path().join(CHECKPOINT)).unwrap();
    assert!(Checkpoint::read(other.path()).is_err());
    assert!(Checkpoint::read(&folder.path().join(CHECKPOINT)).is_err());
}

#[test]
fn any_byte_that_is_changed_is_noticed() {
    let (system, state) = builder().build().unwrap();
    let mut bytes = Vec::new();
    checkpoint(&system, &state).write_to(&mut bytes).unwrap();
    assert!(Checkpoint::parse(&bytes).is_ok());
    for at in 0..bytes.len() - 1 {
        let mut changed = bytes.clone();
        changed[at] ^= 1;
        assert!(Checkpoint::parse(&changed).is_err(), "{at}");
    }
    let of_later = [b"sprung checkpoint 99", &bytes[19..]].concat();
    let message = Checkpoint::parse(&of_later).unwrap_err();
    assert!(message.contains("begins with \"sprung checkpoint 99"), "{message}");
}

#[test]
fn what_no_run_can_go_on_with_is_damaged() {
    let (system, state) = builder().build().unwrap();
    let right = checkpoint(&system, &state);
    let parse = |change: &dyn Fn(&mut Checkpoint)| {
        let (mut checkpoint, mut bytes) = (right.clone(), Vec::new());
        change(&mut checkpoint);
        checkpoint.write_to(&mut bytes).unwrap();
        Checkpoint::parse(&bytes).map(drop)
    };
    assert_eq!(parse(&|_| {}), Ok(()));
    assert_eq!(parse(&|checkpoint| checkpoint.every = 1), Ok(()));
    let damaged = Err("the checkpoint is damaged".to_owned());
    assert_eq!(parse(&|checkpoint| checkpoint.every = 0), damaged);
    assert_eq!(parse(&|checkpoint| _ = checkpoint.velocities.pop()), damaged);
    assert_eq!(parse(&|checkpoint| checkpoint.positions[1][2] = 1e151), damaged);
}

/// Whatever changes what a run computes changes its fingerprint.
#[test]
fn fingerprints_tell_runs_apart() {
    let of = |change: &dyn Fn(&mut SystemBuilder), how: &str| {
        let mut builder = builder();
        change(&mut builder);
        let (system, state) = builder.build().unwrap();
        fingerprint(&system, &state, how)
    };
    let moved = |by: f64| {
        let motion = Motion::Velocity(Vector3::new(0.0, by, 0.0));
        Constraint { particles: vec![1], axes: Axes::of(&[1]), motion }
    };
    let same = of(&|_| {}, "bdf2");
    assert_eq!(same, of(&|_| {}, "bdf2"));
    let others = [
        of(&|_| {}, "bdf3"),
        of(&|builder| builder.gravity.y = -9.82, "bdf2"),
        of(&|builder| builder.positions[1].x += 1e-15, "bdf2"),
        of(&|builder| builder.velocities[1].z = 1.0, "bdf2"),
        of(&|builder| builder.masses[1] = 2.5, "bdf2"),
        of(&|builder| builder.springs[0].stiffness = 6.0, "bdf2"),
        of(&|builder| builder.springs[0].rest_length = 1.5, "bdf2"),
        of(&|builder| builder.springs[0].damping = 0.25, "bdf2"),
        of(&|builder| builder.pairs[0] = [1, 0], "bdf2"),
        of(&|builder| _ = builder.hold(1), "bdf2"),
        of(&|builder| _ = builder.constrain(moved(1.0)), "bdf2"),
        of(&|builder| _ = builder.constrain(moved(2.0)), "bdf2"),
    ];
    let all: std::collections::BTreeSet<&String> = others.iter().chain([&same]).collect();
    assert_eq!(all.len(), 13, "{others:?}");
}
