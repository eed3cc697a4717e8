//! The study of random scenes: that its scenes, forces and references are what it says, and a small sample of it.

use crate::study::cases::{Case, WRONG, cases};
use crate::study::force::Model;
use crate::study::random::{direction, scene};
use crate::study::record::{Record, Wanted, of_seed};
use crate::study::reference::Reference;
use crate::study::runs::Ask;
use crate::study::store::{Store, fingerprint};
use nalgebra::Vector3;
use rayon::prelude::*;
use sprung::accuracy::relative_position_error;
use sprung::force::{SpringGeometry, add_damping_force, add_elastic_force, add_weight};
use sprung::{Spring, SystemBuilder};
use std::collections::BTreeMap;

/// The same scenes for the same seeds, on every machine: a study would otherwise be compared with another one.
#[test]
fn seeds_decide_scenes() {
    let of = |seed: u64| fingerprint(&scene(seed).scene.to_json());
    for seed in 0..60 {
        assert_eq!(of(seed), of(seed));
    }
    let all: std::collections::BTreeSet<u64> = (0..200).map(of).collect();
    assert_eq!(all.len(), 200);
    // Counts do not depend on the last digit of a logarithm, which differs between mathematical libraries.
    let counts = |seed: u64| {
        let drawn = scene(seed).scene;
        (drawn.particles.positions.len(), drawn.springs.pairs.len(), drawn.constraints.len())
    };
    assert_eq!([0, 1, 2, 3, 4, 5].map(counts), COUNTS);
}

/// Particles, springs and constraints of the first scenes.
const COUNTS: [(usize, usize, usize); 6] = [(22, 69, 0), (20, 55, 2), (24, 23, 1), (4, 3, 1), (24, 104, 0), (8, 16, 1)];

/// Everything that is promised of the thousand occurs often enough to be studied.
#[test]
fn a_thousand_scenes_are_of_every_kind() {
    let mut counts = BTreeMap::<String, u32>::new();
    for seed in 0..1000 {
        let drawn = scene(seed);
        let (system, start) = drawn.scene.build().expect("a valid scene");
        assert!(!system.dofs().is_empty(), "seed {seed} has nothing that moves");
        let traits = drawn.traits;
        let compressed = system.pairs().iter().zip(system.springs()).any(|(&[i, j], spring)| {
            (start.positions[i as usize] - start.positions[j as usize]).norm() < 0.999 * spring.rest_length
        });
        let kinks = drawn.scene.constraints.iter().any(|c| c.path.as_ref().is_some_and(|path| path.times.len() > 1));
        let held = !system.prescribed().is_empty();
        let properties = [
            (drawn.shape.name().to_owned(), true),
            (format!("{} dimensions", system.dimension()), true),
            (format!("Ω of {} digits", traits.pace.log10().floor()), true),
            ("damped".into(), traits.damped),
            ("undamped".into(), !traits.damped),
            ("moved".into(), traits.moved),
            ("kinks".into(), kinks),
            ("held".into(), held),
            ("free".into(), !held),
            ("gravity".into(), traits.gravity),
            ("weightless".into(), !traits.gravity),
            ("compressed".into(), compressed),
            ("large".into(), system.particles() > 60),
        ];
        for (property, has) in properties {
            *counts.entry(property).or_default() += u32::from(has);
        }
    }
    assert_eq!(counts.len(), 6 + 3 + 5 + 10, "{counts:?}");
    // Stiffness of the last digit has only small scenes.
    assert!(counts.values().all(|&count| count >= 10), "{counts:?}");
}

/// Both writings of the forces sum the same few terms for each particle; 100 roundings of the largest of them is generous.
#[test]
fn both_writings_of_the_forces_agree() {
    for seed in 0..300 {
        let drawn = scene(seed);
        let (system, mut state) = drawn.scene.build().expect("a valid scene");
        let n = 3 * system.particles();
        let (dx, dv) = (direction(n, seed), direction(n, seed + 1));
        let speed = system.springs()[0].rest_length / drawn.scene.time.duration.unwrap_or(1.0);
        for (c, (dx, dv)) in dx.iter().zip(&dv).enumerate().filter(|(c, _)| c % 3 < system.dimension()) {
            state.positions[c / 3][c % 3] += 0.3 * dx * system.springs()[0].rest_length;
            state.velocities[c / 3][c % 3] += 10.0 * dv * speed;
        }
        let extensions = SpringGeometry::at(&system, &state.positions).expect("no spring collapses");
        let mut force = vec![Vector3::zeros(); system.particles()];
        add_elastic_force(&system, &extensions, &mut force);
        add_damping_force(&system, &extensions, &state.velocities, &mut force);
        add_weight(&system, &mut force);

        let mut scale = vec![0.0; system.particles()];
        for (&[i, j], spring) in system.pairs().iter().zip(system.springs()) {
            let [i, j] = [i, j].map(|p| p as usize);
            let relative = (state.velocities[i] - state.velocities[j]).norm();
            let size = (state.positions[i].norm() + state.positions[j].norm()) / spring.rest_length + 1.0;
            for end in [i, j] {
                scale[end] += spring.stiffness * size + spring.damping * relative;
            }
        }
        let flat = |vectors: &[Vector3<f64>]| vectors.iter().flat_map(|v| [v.x, v.y, v.z]).collect::<Vec<f64>>();
        let mut acceleration = vec![0.0; n];
        let model = Model::new(&system, &state);
        model.accelerate(&flat(&state.positions), &flat(&state.velocities), &mut acceleration);
        for &c in &model.free {
            let (p, axis) = (c / 3, c % 3);
            let other = acceleration[c] * system.masses()[p];
            let bound = 100.0 * f64::EPSILON * (scale[p] + force[p].norm());
            assert!((force[p][axis] - other).abs() <= bound, "seed {seed}: {} and {other}", force[p][axis]);
        }
    }
}

/// Prescribed particles are where the library has them, with its velocities, on both sides of every kink.
#[test]
fn both_writings_of_prescribed_motions_agree() {
    let mut moving = 0;
    for seed in 0..200 {
        let drawn = scene(seed);
        let (system, start) = drawn.scene.build().expect("a valid scene");
        let duration = drawn.scene.time.duration.unwrap_or(1.0);
        let model = Model::new(&system, &start);
        moving += u32::from(system.prescribed().moves());
        let mut ends = model.kinks(0.0, duration);
        ends.insert(0, 0.0);
        ends.push(duration);
        for piece in ends.windows(2) {
            let inside = 0.5 * (piece[0] + piece[1]);
            for t in [piece[0], inside, piece[1]] {
                let mut state = start.clone();
                system.prescribed().set_positions(t, &mut state.positions);
                system.prescribed().set_velocities(inside, &mut state.velocities);
                let (mut x, mut v) = (model.positions.clone(), model.velocities.clone());
                model.drive(t, inside, &mut x, &mut v);
                for (c, (x, v)) in x.iter().zip(&v).enumerate() {
                    let (there, speed) = (state.positions[c / 3][c % 3], state.velocities[c / 3][c % 3]);
                    // Offsets and velocities are differences of places, which have a few metres.
                    assert!((x - there).abs() <= 1e-14 * (1.0 + there.abs()), "seed {seed} at {t}: {x} and {there}");
                    assert!(
                        (v - speed).abs() <= 1e-13 * (1.0 + speed.abs()) / (piece[1] - piece[0]),
                        "seed {seed}: {v} and {speed}"
                    );
                }
            }
        }
    }
    assert!(moving > 30, "{moving}");
}

/// A reference of known motion: a damped oscillator whose anchor moves at constant velocity, right to what its own error says.
#[test]
fn references_are_true() {
    let (k, l0, m, b, v, t) = (50.0, 0.8, 0.7, 1.3, 0.4, 2.0f64);
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    builder.particle([0.0; 3], 1.0);
    builder.particle([1.0, 0.0, 0.0], m);
    builder.spring(0, 1, Spring { stiffness: k, rest_length: l0, damping: b });
    builder.constrain(sprung::Constraint {
        particles: vec![0],
        axes: sprung::system::Axes::ALL,
        motion: sprung::Motion::Velocity(Vector3::new(v, 0.0, 0.0)),
    });
    let (system, start) = builder.build().expect("a valid system");
    let reference = Reference::compute(&Model::new(&system, &start), 1, t).expect("a reference");
    // The length less its rest length u: m ü + b u̇ + (k/l0) u = 0, u(0) = 0.2, u̇(0) = −v.
    let (rate, square) = (b / (2.0 * m), k / (l0 * m));
    let omega = (square - rate * rate).sqrt();
    let u = (-rate * t).exp() * (0.2 * (omega * t).cos() + (0.2 * rate - v) / omega * (omega * t).sin());
    let exact = [Vector3::new(v * t, 0.0, 0.0), Vector3::new(v * t + l0 + u, 0.0, 0.0)];
    let error = relative_position_error(&reference.points(), &exact, &start.positions);
    assert!(error <= 3e-13 && reference.error < 1e-9, "{error:e}, {:e}", reference.error);
    // A linear system amplifies by its propagator: less than one where it is damped.
    assert!(reference.amplification < 1.0, "{}", reference.amplification);
}

/// The promises of the study, on some of its scenes: the page `verification/study.md` has the whole.
#[test]
fn a_sample_keeps_the_promises() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("study");
    let store = Store::open(&folder).expect("a folder for references");
    let wanted = Wanted { fixed: true, adaptive: true, accuracy: false };
    let seeds: Vec<u64> = (0..1000).step_by(20).collect();
    let records: Vec<Record> =
        seeds.par_iter().map(|&seed| of_seed(seed, &store, wanted).expect("a valid scene")).collect();
    let all = cases(&records);
    let fixed: Vec<&Case> = all.iter().filter(|case| matches!(case.run.ask, Ask::Dt(_))).collect();
    let describe = |case: &&&Case| format!("{} {} {:?}", case.record.scene, case.run.method, case.run.ask);
    let silent: Vec<String> = fixed.iter().filter(|case| case.is_silent()).map(|case| describe(&case)).collect();
    assert!(silent.is_empty(), "wrong by more than {WRONG} without a word: {silent:?}");
    let share = |part: &dyn Fn(&Case) -> bool, of: &dyn Fn(&Case) -> bool| {
        let of: Vec<_> = fixed.iter().filter(|case| of(case)).collect();
        of.iter().filter(|case| part(case)).count() as f64 / of.len() as f64
    };
    let alarms = share(&|case| case.is_false_alarm(), &|case| case.is_right());
    assert!(alarms <= 0.05, "{alarms}");
    let near = share(&|case| case.ratio().is_some_and(|r| (0.1..=10.0).contains(&r)), &|case| case.ratio().is_some());
    assert!(near >= 0.8, "{near}");
    assert!(fixed.len() > 500, "{}", fixed.len());
}
