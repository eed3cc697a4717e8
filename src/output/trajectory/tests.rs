//! Motions that are written, gone on with, and read back.

use super::{TRAJECTORY, Trajectory, WAITING};
use crate::figure::Binding;
use crate::output::playback;
use crate::scene::NpzWriter;
use crate::spring::Spring;
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
use nalgebra::Vector3;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Three particles in a plane: a free one, one that is held, one that is moved.
fn scene() -> (System, State) {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    builder.gravity(0.5, -9.81, 0.0);
    for x in [1.0, 2.0, 4.0] {
        builder.particle([x, -x, 0.0], 1.0);
    }
    builder.spring(0, 1, Spring { stiffness: 7.0, rest_length: 1.5, damping: 0.0 });
    builder.spring(2, 1, Spring { stiffness: 8.0, rest_length: 2.5, damping: 0.0 });
    builder.hold(1);
    let motion = Motion::Velocity(Vector3::new(1.0, 0.0, 0.0));
    builder.constrain(Constraint { particles: vec![2], axes: Axes::of(&[0]), motion });
    builder.build().unwrap()
}

/// The state of a frame: all coordinates and velocities differ.
fn frame(start: &State, number: u64) -> State {
    let mut state = start.clone();
    state.time = 0.5 * number as f64;
    for (p, (x, v)) in state.positions.iter_mut().zip(&mut state.velocities).enumerate() {
        *x += Vector3::new(10.0 * number as f64, p as f64, 0.0);
        *v = Vector3::new(-(number as f64), 100.0 + p as f64, 0.0);
    }
    state
}

/// An array of the file, as numbers.
fn array(folder: &Path, name: &str) -> Vec<f64> {
    let mut archive = zip::ZipArchive::new(File::open(folder.join(TRAJECTORY)).unwrap()).unwrap();
    let mut bytes = Vec::new();
    archive.by_name(&format!("{name}.npy")).unwrap().read_to_end(&mut bytes).unwrap();
    npyz::NpyFile::new(&bytes[..]).unwrap().into_vec().unwrap()
}

fn planar<'s>(vectors: impl IntoIterator<Item = &'s Vector3<f64>>) -> Vec<f64> {
    vectors.into_iter().flat_map(|v| [v.x, v.y]).collect()
}

#[test]
fn every_frame_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let (system, start) = scene();
    let mut trajectory = Trajectory::create(folder.path()).unwrap();
    let states = [0, 1, 2].map(|number| frame(&start, number));
    for (state, step) in states.iter().zip([0, 3, 6]) {
        trajectory.push(&system, state, step).unwrap();
    }
    trajectory.finish(&system, &[[2, 1, 0]]).unwrap();
    assert!(!folder.path().join(WAITING).exists());
    assert_eq!(array(folder.path(), "velocities"), planar(states.iter().flat_map(|state| &state.velocities)));
    assert_eq!(array(folder.path(), "positions"), planar(states.iter().flat_map(|state| &state.positions)));

    let animation = playback(folder.path()).unwrap();
    assert_eq!(animation.times, [0.0, 0.5, 1.0]);
    let expected: Vec<Vector3<f64>> = states.iter().flat_map(|state| state.positions.clone()).collect();
    assert_eq!(animation.positions, expected);
    let cast = animation.cast();
    assert_eq!((cast.dimension, cast.gravity), (2, Vector3::new(0.5, -9.81, 0.0)));
    assert_eq!(cast.bindings, [Binding::Free, Binding::Held, Binding::Moved]);
    assert_eq!((&cast.pairs[..], &cast.triangles[..]), (&[[0, 1], [2, 1]][..], &[[2, 1, 0]][..]));
    assert_eq!((&cast.rest_lengths[..], &cast.stiffnesses[..]), (&[1.5, 2.5][..], &[7.0, 8.0][..]));
    // Nothing is known but the motion.
    assert_eq!(animation.remarks, ["a frame every 0.5 s"]);
    assert!(animation.tracks.is_empty());
}

#[test]
fn frames_go_on_behind_those_of_a_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let (system, start) = scene();
    let states = [0, 1, 2].map(|number| frame(&start, number));
    let mut trajectory = Trajectory::create(folder.path()).unwrap();
    for (step, state) in (0..).zip(&states) {
        trajectory.push(&system, state, step).unwrap();
    }
    trajectory.keep();
    trajectory.flush().unwrap();
    let waiting = folder.path().join(WAITING);
    let bytes = std::fs::metadata(&waiting).unwrap().len();
    // Two vectors of two doubles for each of three particles.
    assert_eq!(bytes, 3 * (3 * 2 * 2 * 8));
    drop(trajectory);
    assert!(waiting.exists());
    // The frame behind the checkpoint is written again.
    let known = [(0.0, 0), (0.5, 1)];
    let mut trajectory = Trajectory::resume(folder.path(), &known, &system).unwrap();
    let other = frame(&start, 5);
    trajectory.push(&system, &other, 2).unwrap();
    trajectory.flush().unwrap();
    assert_eq!(std::fs::metadata(&waiting).unwrap().len(), bytes);
    let all = [known[0], known[1], (2.5, 2)];
    drop(trajectory);
    Trajectory::resume(folder.path(), &all, &system).unwrap().finish(&system, &[]).unwrap();
    let expected = [&states[0], &states[1], &other].map(|state| planar(&state.velocities)).concat();
    assert_eq!(array(folder.path(), "velocities"), expected);
    assert_eq!((array(folder.path(), "times"), playback(folder.path()).unwrap().times.len()), (vec![0.0, 0.5, 2.5], 3));
}

#[test]
fn frames_that_are_not_there_cannot_be_gone_on_with() {
    let folder = tempfile::tempdir().unwrap();
    let (system, start) = scene();
    let mut trajectory = Trajectory::create(folder.path()).unwrap();
    trajectory.push(&system, &start, 0).unwrap();
    trajectory.flush().unwrap();
    let frames = [(0.0, 0), (0.5, 1)];
    assert!(Trajectory::resume(folder.path(), &frames, &system).is_err());
    // A run that ends without a result leaves no frames behind.
    drop(trajectory);
    assert!(!folder.path().join(WAITING).exists());
}

/// A trajectory of one particle and the lists given beside it.
fn with_lists(folder: &Path, gravity: &[f64], pairs: &[u32], rest_lengths: &[f64], times: &[f64]) -> Option<String> {
    let mut npz = NpzWriter::new(File::create(folder.join(TRAJECTORY)).unwrap());
    npz.put("times", &[times.len()], times.iter().copied()).unwrap();
    npz.put("bindings", &[2], [0u8, 1].into_iter()).unwrap();
    npz.put("gravity", &[gravity.len()], gravity.iter().copied()).unwrap();
    npz.put("pairs", &[pairs.len() / 2, 2], pairs.iter().copied()).unwrap();
    npz.put("rest_lengths", &[rest_lengths.len()], rest_lengths.iter().copied()).unwrap();
    npz.put("stiffness", &[1], [1.0].into_iter()).unwrap();
    npz.put("triangles", &[0, 3], std::iter::empty::<u32>()).unwrap();
    npz.put("positions", &[1, 2, 1], [0.0, 1.0].into_iter()).unwrap();
    npz.finish().unwrap();
    playback(folder).err().map(|error| error.to_string())
}

#[test]
fn lists_that_do_not_fit_together_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let wrong = |gravity: &[f64], pairs: &[u32], rest_lengths: &[f64], times: &[f64]| {
        with_lists(folder.path(), gravity, pairs, rest_lengths, times)
    };
    assert_eq!(wrong(&[0.0], &[0, 1], &[1.0], &[0.0]), None);
    for (message, end) in [
        (wrong(&[0.0], &[0, 2], &[1.0], &[0.0]), "its arrays do not fit together"),
        (wrong(&[], &[0, 1], &[1.0], &[0.0]), "its arrays do not fit together"),
        (wrong(&[0.0; 4], &[0, 1], &[1.0], &[0.0]), "its arrays do not fit together"),
        (wrong(&[0.0], &[0, 1], &[1.0, 1.0], &[0.0]), "not every spring has a rest length and a stiffness"),
        (wrong(&[0.0], &[0, 1, 1, 0], &[1.0, 1.0], &[0.0]), "not every spring has a rest length and a stiffness"),
        (wrong(&[0.0], &[0, 1], &[1.0], &[0.0, 1.0]), "its positions do not fit to its times and masses"),
        (wrong(&[0.0; 2], &[0, 1], &[1.0], &[0.0]), "its positions do not fit to its times and masses"),
    ] {
        assert!(message.as_deref().is_some_and(|message| message.ends_with(end)), "{message:?}");
    }
}

#[test]
fn what_is_known_of_a_run_is_said() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(with_lists(folder.path(), &[0.0], &[0, 1], &[1.0], &[0.0]), None);
    let remarks = |summary: &str| {
        std::fs::write(folder.path().join("summary.json"), summary).unwrap();
        let animation = playback(folder.path()).unwrap();
        (animation.title, animation.remarks)
    };
    let all = r#"{"scene": "bridge", "method": "bdf2", "stiffness": "full", "dt": 0.0123456, "status": "completed"}"#;
    let expected = ["bdf2, stiffness full", "dt = 0.012346 s"].map(String::from);
    assert_eq!(remarks(all), ("bridge".into(), expected.to_vec()));
    let failed = r#"{"method": "verlet", "stiffness": "none", "rtol": 1e-3, "dt": 1.0, "status": "unstable",
        "failure": {"message": "energy from nowhere"}}"#;
    let expected = ["verlet", "steps by rtol 0.001", "the run ended unstable: energy from nowhere"].map(String::from);
    assert_eq!(remarks(failed).1, expected);
    assert_eq!(remarks("no summary").1, [""; 0]);

    let tracks = |text: &str| {
        std::fs::write(folder.path().join("energy.csv"), text).unwrap();
        playback(folder.path()).unwrap().tracks
    };
    let found = tracks("time,kinetic,elastic,work,rope_length\n0,1,2,3,4\n0.5,5,,7,8\n");
    let titles: Vec<_> = found.iter().map(|track| (track.title.as_str(), track.unit.as_str())).collect();
    assert_eq!(titles, [("energy", "J"), ("balance of energy", "J"), ("rope length", "")]);
    assert!(found.iter().all(|track| track.times == [0.0, 0.5]));
    assert_eq!((&found[0].curves[0], found[0].curves[1].1[0]), (&("kinetic".into(), vec![1.0, 5.0]), 2.0));
    assert!(found[0].curves[1].1[1].is_nan());
    assert_eq!(found[1].curves, [("work".into(), vec![3.0, 7.0])]);
    assert_eq!(tracks("time,kinetic\n0,1\n1,1\n").len(), 1);
    // One moment is no curve, and a table of something else none of energies.
    assert!(tracks("time,kinetic\n0,1\n").is_empty() && tracks("step,kinetic\n0,1\n1,2\n").is_empty());
}
