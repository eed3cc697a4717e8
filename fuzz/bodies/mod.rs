//! The bodies of the fuzz targets. They panic where a claim does not hold; `cargo fuzz` runs them with coverage, and
//! `cargo xtask stress fuzz` without.
#![allow(dead_code, reason = "every target uses its own part")]

mod system;

use sprung::Scene;
use sprung::force::SpringGeometry;
use sprung::inspect::Inspection;
use sprung::integrate::{
    AdaptiveOptions, ImplicitOptions, Monitor, MonitorOptions, OutputTimes, Schedule, StepMatrices, TimeStepper,
    run_adaptive_monitored, run_monitored,
};
use sprung::operator::{Combination, LinearOperator, SystemOperator};
use sprung::output::{Checkpoint, write_symmetric};
use sprung::scene::MeshGeometry;
use sprung::{State, Stiffness, System};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::OnceLock;
use system::Bytes;

/// The body of a target.
type Body = fn(&[u8]);

/// A body by its name.
pub fn body(name: &str) -> Option<Body> {
    let bodies: [(&str, Body); 9] = [
        ("scene_toml", scene_toml),
        ("scene_json", scene_json),
        ("steps", steps),
        ("runs", runs),
        ("inspect", inspect),
        ("mesh", mesh),
        ("matrix_market", matrix_market),
        ("checkpoint", checkpoint),
        ("checkpoint_summed", checkpoint_summed),
    ];
    bodies.into_iter().find(|(other, _)| *other == name).map(|(_, body)| body)
}

/// Any text is a scene or an error; a scene that builds is written and read back to itself.
pub fn scene_toml(data: &[u8]) {
    let Ok(text) = str::from_utf8(data) else { return };
    if let Ok(scene) = Scene::from_toml(text) {
        same_after(&scene, Scene::from_toml(&scene.to_toml()));
        built(&scene);
    }
}

/// The same in JSON.
pub fn scene_json(data: &[u8]) {
    let Ok(text) = str::from_utf8(data) else { return };
    if let Ok(scene) = Scene::from_json(text) {
        same_after(&scene, Scene::from_json(&scene.to_json()));
        built(&scene);
    }
}

fn same_after(scene: &Scene, again: sprung::Result<Scene>) {
    // Texts have NaN and infinities that are refused only when a scene is built, and that JSON cannot say.
    if scene.build().is_ok() {
        let again = again.unwrap_or_else(|error| panic!("what was written is refused: {error}"));
        assert_eq!(format!("{scene:?}"), format!("{again:?}"));
    }
}

/// A scene from outside: built, or an error that can be shown. Meshes are left out: their files are not the fuzzer's.
fn built(scene: &Scene) {
    if scene.mesh.is_some() {
        return;
    }
    match scene.build() {
        Ok((system, state)) => {
            assert!(state.positions.iter().chain(&state.velocities).flatten().all(|x| x.is_finite()));
            if system.particles() <= 12 && system.springs().len() <= 40 {
                one_step(&system, &state, 0.01);
            }
        }
        Err(error) => assert!(error.to_string().len() < 5000),
    }
}

/// One step of the default method: a finite state, or a failure that leaves the old one.
fn one_step(system: &System, state: &State, dt: f64) {
    let options = ImplicitOptions::default();
    let Ok(mut stepper) = sprung::integrate::LinearBackwardEuler::new(system, state, &options) else { return };
    let mut moved = state.clone();
    match stepper.step(&mut moved, dt) {
        Ok(()) => assert!(moved.is_finite()),
        Err(_) => assert_eq!(&moved, state),
    }
}

/// Pools of one thread and of three.
fn pools() -> &'static [rayon::ThreadPool; 2] {
    static POOLS: OnceLock<[rayon::ThreadPool; 2]> = OnceLock::new();
    POOLS.get_or_init(|| {
        [1, 3].map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads"))
    })
}

/// A system, a method, an option, a solver, a step, all from the bytes: every step ends in a finite state with the same bits for one
/// thread and three, or in a failure with a status, which leaves the state as it was.
pub fn steps(data: &[u8]) {
    let mut bytes = Bytes::new(data);
    let Some((system, state)) = bytes.system() else { return };
    let (method, options, dt) = (bytes.method(), bytes.options(), bytes.number(1e-6, 1e6));
    let run = |pool: &rayon::ThreadPool| {
        pool.install(|| {
            let mut state = state.clone();
            let mut stepper = method.stepper(&system, &state, &options).ok()?;
            for _ in 0..4 {
                let before = state.clone();
                match stepper.step(&mut state, dt) {
                    Ok(()) => assert!(state.is_finite(), "{} {options:?} {dt:e}", method.name()),
                    Err(failure) => {
                        assert_eq!(before, state, "a step that failed has moved");
                        assert!(!failure.to_string().is_empty() && !failure.status().name().is_empty());
                        break;
                    }
                }
            }
            assert!(stepper.statistics().max_relative_residual.is_finite());
            Some((bits(&state), stepper.statistics().work))
        })
    };
    let [one, three] = pools();
    assert_eq!(run(one), run(three), "the bits depend on the number of threads: {} {options:?} {dt:e}", method.name());
    symmetric(&system, &state, dt);
}

/// A few steps of a run that a monitor accompanies, adaptive ones where the method has an error estimate and the bytes say so: every
/// state that is shown is finite, so is the last, its indicators are numbers, and all of it is the same for one thread and three.
pub fn runs(data: &[u8]) {
    let mut bytes = Bytes::new(data);
    let Some((system, start)) = bytes.system() else { return };
    let (method, options, dt) = (bytes.method(), bytes.options(), bytes.number(1e-6, 1e6));
    let rtol = bytes.pick(&[None, Some(1e-1), Some(1e-3), Some(1e-6)]);
    let run = |pool: &rayon::ThreadPool| {
        pool.install(|| {
            let mut state = start.clone();
            let mut monitor = Monitor::new(&system, &state, MonitorOptions::default()).ok()?;
            let mut seen = 0;
            let watch = |_: u64, state: &State, _: &Monitor| {
                assert!(state.is_finite(), "{} {options:?} {dt:e}", method.name());
                seen += 1;
                if seen < 6 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            };
            let outcome = match rtol.zip(method.adaptive_stepper(&system, &state, &options).ok()?) {
                Some((rtol, mut stepper)) => {
                    let how = AdaptiveOptions {
                        duration: 6.0 * dt,
                        rtol,
                        first_step: None,
                        sampling: OutputTimes::Steps,
                        part_of: None,
                    };
                    run_adaptive_monitored(&mut *stepper, &system, &mut state, &how, &mut monitor, watch)
                }
                None => {
                    let mut stepper = method.stepper(&system, &state, &options).ok()?;
                    let schedule = Schedule::duration(dt, 4.5 * dt);
                    run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, watch)
                }
            };
            assert!(state.is_finite(), "{} {options:?} {dt:e} {rtol:?}: {outcome:?} {state:?}", method.name());
            let indicators = monitor.indicators(&state);
            let estimate = indicators.estimate;
            assert!(estimate.is_none_or(|estimate| estimate >= 0.0), "{indicators:?}");
            let warnings = indicators.warnings(rtol).len();
            Some((bits(&state), outcome.steps, estimate.map(f64::to_bits), warnings))
        })
    };
    let [one, three] = pools();
    let name = method.name();
    assert_eq!(run(one), run(three), "the run depends on the number of threads: {name} {options:?} {dt:e} {rtol:?}");
}

fn bits(state: &State) -> Vec<u64> {
    state.positions.iter().chain(&state.velocities).flatten().map(|x| x.to_bits()).collect()
}

/// The assembled A and its products are those of the operator, whose `uᵀAw` is `wᵀAu`.
fn symmetric(system: &System, state: &State, dt: f64) {
    let Ok(matrices) = StepMatrices::assemble(system, state, Stiffness::Full, dt) else { return };
    let n = system.dofs().len();
    let Ok(extensions) = SpringGeometry::at(system, &state.positions) else { return };
    let operator = SystemOperator::new(system, &extensions, Stiffness::Full, Combination::step(dt));
    let [u, w] = [0.7, 1.9].map(|seed: f64| (0..n).map(|i| ((i + 1) as f64 * seed).sin()).collect::<Vec<f64>>());
    let [mut au, mut aw, mut assembled] = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
    operator.apply(&u, &mut au);
    operator.apply(&w, &mut aw);
    matrices.a.apply(&w, &mut assembled);
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let scale = matrices.a.values().iter().map(|value| value.abs()).sum::<f64>();
    if scale.is_finite() && scale < 1e290 {
        let bound = 1e-12 * scale * (n as f64 + 1.0) + f64::MIN_POSITIVE;
        assert!((dot(&w, &au) - dot(&u, &aw)).abs() <= bound, "not symmetric");
        assert!(aw.iter().zip(&assembled).all(|(a, b)| (a - b).abs() <= bound), "two products differ");
    }
}

/// Everything about definiteness at a state: numbers, or an error.
pub fn inspect(data: &[u8]) {
    let mut bytes = Bytes::new(data);
    let Some((system, state)) = bytes.system() else { return };
    let (dt, option) = (bytes.number(1e-6, 1e6), bytes.pick(&Stiffness::ALL));
    let Ok(inspection) = Inspection::at(&system, &state, dt, option, faer::Par::Seq) else { return };
    for examined in &inspection.options {
        let signs = &examined.inertia;
        assert_eq!(signs.negative + signs.zero + signs.positive, system.dofs().len());
        if signs.is_definite() && !system.dofs().is_empty() {
            assert!(examined.smallest > 0.0, "definite, and λ_min = {:e}", examined.smallest);
        }
    }
}

/// Any bytes are a mesh or an error; edges and triangles name vertices that are there.
pub fn mesh(data: &[u8]) {
    match MeshGeometry::from_bytes(data, Path::new("m")) {
        Ok(mesh) => {
            let there = |&p: &u32| (p as usize) < mesh.vertices.len();
            assert!(mesh.edges.iter().flatten().all(there) && mesh.triangles.iter().flatten().all(there));
            assert!(mesh.vertices.iter().flatten().all(|x| x.is_finite()));
        }
        Err(error) => assert!(error.to_string().len() < 5000),
    }
}

/// A matrix that is written is read back to the bit, by the few lines that the format takes.
pub fn matrix_market(data: &[u8]) {
    let mut bytes = Bytes::new(data);
    let Some((system, state)) = bytes.system() else { return };
    let dt = bytes.number(1e-6, 1e6);
    let Ok(StepMatrices { a, .. }) = StepMatrices::assemble(&system, &state, Stiffness::Full, dt) else { return };
    if !a.values().iter().all(|value| value.is_finite()) {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("A.mtx");
    let entries = || a.iter().filter(|(_, _, value)| *value != 0.0);
    write_symmetric(&file, "a\ncomment", a.order(), entries().count(), entries()).expect("written");
    let text = std::fs::read_to_string(file).expect("read");
    let mut lines = text.lines().filter(|line| !line.starts_with('%'));
    let size = format!("{n} {n} {}", entries().count(), n = a.order());
    assert_eq!(lines.next(), Some(size.as_str()));
    for (row, column, value) in entries() {
        let line = lines.next().expect("an entry");
        let parts: Vec<&str> = line.split(' ').collect();
        let numbers = (parts[0].parse::<usize>(), parts[1].parse::<usize>(), parts[2].parse::<f64>().map(f64::to_bits));
        assert_eq!(numbers, (Ok(row + 1), Ok(column + 1), Ok(value.to_bits())));
    }
    assert_eq!(lines.next(), None);
}

/// Any bytes are a checkpoint or are refused; one that is read is written to the same bytes, but for how numbers are spelled.
pub fn checkpoint(data: &[u8]) {
    let Ok(checkpoint) = Checkpoint::parse(data) else { return };
    let mut bytes = Vec::new();
    checkpoint.write_to(&mut bytes).expect("written");
    assert_eq!(Checkpoint::parse(&bytes), Ok(checkpoint));
}

/// As [`checkpoint`], for any bytes between the first line and a checksum that is right: past it nothing else guards what is read.
pub fn checkpoint_summed(data: &[u8]) {
    let mut bytes = b"sprung checkpoint 3\n".to_vec();
    bytes.extend(data.iter().map(|&byte| if byte == b'\n' { b' ' } else { byte }));
    bytes.push(b'\n');
    let sum = bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325_u64, |sum, &byte| (sum ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3));
    bytes.extend(format!("{sum:016x}\n").bytes());
    checkpoint(&bytes);
}
