//! A scene means the same in TOML, in JSON, as arrays and in code, and is written so that it reads back to the bit.

use proptest::prelude::*;
use sprung::scene::{
    AxisName, ConstraintEntry, Gravity, Kind, Mesh, Particles, Path, Row, Scene, Springs, TimeSettings, Values, builtin,
};
use std::io::Cursor;

const VALID_TOML: &str = include_str!("../common/valid.toml");
const VALID_JSON: &str = include_str!("../common/valid.json");

fn valid_in_code() -> Scene {
    Scene {
        name: "valid".into(),
        file: None,
        gravity: Some([0.0, -9.81, 0.0].into()),
        particles: Particles {
            positions: vec![[0.0; 3].into(), [1.1, 0.0, 0.0].into(), [1.5, 0.9, 0.2].into()],
            velocities: Some(vec![[0.0; 3].into(), [0.0, 0.5, 0.0].into(), [0.0; 3].into()]),
            masses: Some(vec![1.0, 2.0, 3.0].into()),
        },
        springs: Springs {
            pairs: vec![[0, 1], [1, 2]],
            stiffness: Some(vec![100.0, 200.0].into()),
            rest_lengths: Some(vec![1.0, 1.2].into()),
            damping: Some(vec![0.3, 0.0].into()),
            ..Springs::default()
        },
        mesh: None,
        constraints: vec![
            ConstraintEntry {
                particles: vec![0],
                axes: Some(vec![AxisName::X, AxisName::Y]),
                velocity: Some([0.0, 0.0, 0.5].into()),
                path: None,
            },
            ConstraintEntry {
                particles: vec![1, 2],
                path: Some(Path { times: vec![0.0, 1.0], offsets: vec![[0.0; 3].into(), [0.0, 0.2, 0.0].into()] }),
                ..ConstraintEntry::default()
            },
        ],
        time: TimeSettings { dt: Some(0.01), duration: Some(1.0) },
        ..Scene::default()
    }
}

fn npz(scene: &Scene) -> Vec<u8> {
    let mut bytes = Vec::new();
    scene.write_npz(&mut bytes).unwrap();
    bytes
}

/// Equal to the bit: `==` takes 0 and −0 for equal, the shortest text that reads back does not.
fn assert_same(left: &Scene, right: &Scene) {
    assert_eq!(format!("{left:?}"), format!("{right:?}"));
}

fn assert_reads_back(scene: &Scene) {
    assert_same(&Scene::from_toml(&scene.to_toml()).unwrap(), scene);
    assert_same(&Scene::from_json(&scene.to_json()).unwrap(), scene);
    assert_same(&Scene::from_npz(Cursor::new(npz(scene))).unwrap(), scene);
}

#[test]
fn toml_json_and_code_say_the_same() {
    assert_same(&Scene::from_toml(VALID_TOML).unwrap(), &valid_in_code());
    assert_same(&Scene::from_json(VALID_JSON).unwrap(), &valid_in_code());
}

#[test]
fn every_builtin_scene_reads_back_to_the_bit() {
    for kind in Kind::ALL {
        for size in [1, 2, 3, kind.default_size()] {
            let scene = builtin(kind, size).unwrap();
            scene.build().unwrap();
            assert_reads_back(&scene);
        }
    }
}

#[test]
fn written_toml_is_commented_and_has_no_long_lines() {
    let toml = builtin(Kind::Cloth, 20).unwrap().to_toml();
    for unit in ["  # m/s²", "  # m, ", "  # kg", "  # k in N", "rest_lengths, l0 in m", "  # b in N·s/m", "  # s"] {
        assert!(toml.contains(unit), "{unit}");
    }
    assert!(toml.lines().all(|line| line.chars().count() <= 100));
}

#[test]
fn a_byte_order_mark_and_carriage_returns_do_not_matter() {
    let windows = format!("\u{feff}{}", VALID_TOML.replace('\n', "\r\n"));
    assert_same(&Scene::from_toml(&windows).unwrap(), &valid_in_code());
    let windows = format!("\u{feff}{}", VALID_JSON.replace('\n', "\r\n"));
    assert_same(&Scene::from_json(&windows).unwrap(), &valid_in_code());
}

#[test]
fn a_file_gives_its_stem_as_name_where_it_has_none() {
    let folder = tempfile::tempdir().unwrap();
    for (file, text) in [("two springs.toml", ""), ("two springs.JSON", "{}")] {
        let path = folder.path().join(file);
        std::fs::write(&path, text).unwrap();
        let scene = Scene::load(&path).unwrap();
        assert_eq!((scene.name.as_str(), scene.file), ("two springs", Some(path)));
    }
    assert_eq!(Scene::from_toml("").unwrap().name, "scene");
}

#[test]
fn a_large_json_scene_reads_back_to_the_bit() {
    let scene = builtin(Kind::Network, 100_000).unwrap();
    let read = Scene::from_json(&scene.to_json()).unwrap();
    assert_eq!(read, scene);
    let (system, _) = read.build().unwrap();
    assert_eq!(system.particles(), 100_000);
}

/// Any finite number, zeros of both signs and subnormal ones among them.
fn number() -> impl Strategy<Value = f64> {
    use proptest::num::f64::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
    prop_oneof![-1e3..1e3, NORMAL | SUBNORMAL | ZERO | POSITIVE | NEGATIVE]
}

fn row(dimension: usize) -> impl Strategy<Value = Row> {
    [number(), number(), number()].prop_map(move |entries| Row::of(&entries.into(), dimension))
}

fn rows(dimension: usize) -> impl Strategy<Value = Vec<Row>> {
    prop::collection::vec(row(dimension), 0..40)
}

fn values() -> impl Strategy<Value = Option<Values>> {
    let each = prop::collection::vec(number(), 0..40).prop_map(Values::Each);
    prop::option::of(prop_oneof![number().prop_map(Values::Uniform), each])
}

fn entry(dimension: usize) -> impl Strategy<Value = ConstraintEntry> {
    let path = (prop::collection::vec(number(), 0..20), rows(dimension));
    (
        prop::collection::vec(any::<u32>(), 0..40),
        prop::option::of(prop::collection::vec(prop::sample::select(&AxisName::ALL[..]), 0..4)),
        prop::option::of(row(dimension)),
        prop::option::of(path.prop_map(|(times, offsets)| Path { times, offsets })),
    )
        .prop_map(|(particles, axes, velocity, path)| ConstraintEntry { particles, axes, velocity, path })
}

/// Whatever the types can hold and a file can say, valid as a system or not.
fn scene() -> impl Strategy<Value = Scene> {
    let name = "[^/\\\\\\p{Cc}]{0,8}[a-z\"'\\[#éß😀]";
    let positive = || prop::option::of(1e-300..1e300);
    let mesh = ("\\PC{1,8}", positive(), positive()).prop_map(|(file, scale, weld)| Mesh { file, scale, weld });
    (1usize..=3).prop_flat_map(move |dimension| {
        (
            (name, prop::option::of(row(dimension)), prop::option::of(mesh.clone()), positive(), positive()),
            (rows(dimension), prop::option::of(rows(dimension)), values()),
            (prop::collection::vec(any::<[u32; 2]>(), 0..40), values(), values(), values()),
            prop::collection::vec(entry(dimension), 0..4),
        )
            .prop_map(|((name, gravity, mesh, dt, duration), particles, springs, constraints)| {
                let (positions, velocities, masses) = particles;
                let (pairs, stiffness, rest_lengths, damping) = springs;
                Scene {
                    name,
                    file: None,
                    gravity: gravity.map(Gravity::Constant),
                    particles: Particles { positions, velocities, masses },
                    springs: Springs { pairs, stiffness, rest_lengths, damping, ..Springs::default() },
                    mesh,
                    constraints,
                    time: TimeSettings { dt, duration },
                    ..Scene::default()
                }
            })
    })
}

/// A valid text with a few bytes changed, moved or lost.
fn damaged(text: &'static str) -> impl Strategy<Value = String> {
    let edit = (any::<prop::sample::Index>(), 0usize..30, "[-\\[\\]{}\",.:=0-9a-z\\n]{0,3}");
    prop::collection::vec(edit, 1..4).prop_map(move |edits| {
        let mut text = text.as_bytes().to_vec();
        for (at, length, insert) in edits {
            let at = at.index(text.len() + 1);
            let end = (at + length).min(text.len());
            text.splice(at..end, insert.into_bytes());
        }
        String::from_utf8_lossy(&text).into_owned()
    })
}

proptest! {
    #[test]
    fn any_scene_reads_back_to_the_bit(scene in scene()) {
        assert_reads_back(&scene);
    }

    #[test]
    fn any_scene_builds_or_is_rejected(mut scene in scene()) {
        scene.mesh = None;
        let _ = scene.build();
    }

    #[test]
    fn any_text_is_read_or_rejected(text in "\\PC*") {
        let _ = Scene::from_toml(&text);
        let _ = Scene::from_json(&text);
    }

    #[test]
    fn damaged_toml_is_read_or_rejected(text in damaged(VALID_TOML)) {
        let _ = Scene::from_toml(&text).and_then(|scene| scene.build());
    }

    #[test]
    fn damaged_arrays_are_read_or_rejected(at in any::<prop::sample::Index>(), byte: u8) {
        let mut bytes = npz(&valid_in_code());
        let at = at.index(bytes.len());
        bytes[at] = byte;
        let _ = Scene::from_npz(Cursor::new(bytes)).and_then(|scene| scene.build());
    }

    #[test]
    fn damaged_json_is_read_or_rejected(text in damaged(VALID_JSON)) {
        let _ = Scene::from_json(&text).and_then(|scene| scene.build());
    }
}

/// Every copy of a value in which one part, at any depth, is replaced.
fn with_one_part_replaced(value: &serde_json::Value, by: &serde_json::Value) -> Vec<serde_json::Value> {
    let mut copies = vec![by.clone()];
    let mut within = |part: &serde_json::Value, put: &dyn Fn(serde_json::Value) -> serde_json::Value| {
        copies.extend(with_one_part_replaced(part, by).into_iter().map(put));
    };
    match value {
        serde_json::Value::Array(parts) => parts.iter().enumerate().for_each(|(index, part)| {
            within(part, &|replaced| {
                let mut parts = parts.clone();
                parts[index] = replaced;
                parts.into()
            });
        }),
        serde_json::Value::Object(parts) => parts.iter().for_each(|(key, part)| {
            within(part, &|replaced| {
                let mut parts = parts.clone();
                parts[key] = replaced;
                parts.into()
            });
        }),
        _ => (),
    }
    copies
}

#[test]
fn a_wrong_type_anywhere_is_read_or_rejected_alike_in_both_formats() {
    let valid: serde_json::Value = serde_json::from_str(VALID_JSON).unwrap();
    let wrong = serde_json::json!([true, "x", "", -1, 0, 7, 1.5, 1e308, [], [[]], [[[[1]]]], [0, "x"], {}, {"x": {}}]);
    for by in wrong.as_array().unwrap() {
        for scene in with_one_part_replaced(&valid, by) {
            let json = Scene::from_json(&scene.to_string()).and_then(|scene| scene.build());
            match toml::to_string(&scene) {
                Ok(text) => {
                    let toml = Scene::from_toml(&text).and_then(|scene| scene.build());
                    assert_eq!(json.is_ok(), toml.is_ok(), "{scene}");
                }
                // A TOML text is always a table.
                Err(_) => assert!(json.is_err() && !scene.is_object(), "{scene}"),
            }
        }
    }
}
