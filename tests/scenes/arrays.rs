//! Scenes as NumPy writes them: arrays of any real type, byte order and layout, byte by byte as the format is documented, so that nothing here
//! was written by what reads it.

use sprung::Scene;
use sprung::scene::{Row, Values};
use std::io::{Cursor, Write};
use zip::CompressionMethod;
use zip::write::SimpleFileOptions;

/// An `.npy` file, version 1.0: magic, version, the length of the header, the header padded to 64 bytes, the numbers.
fn npy(descr: &str, is_fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let order = if is_fortran { "True" } else { "False" };
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}");
    header.push_str(&" ".repeat(64 - (header.len() + 11) % 64));
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

fn text(text: &str) -> Vec<u8> {
    let code_points: Vec<u8> = text.chars().flat_map(|letter| u32::from(letter).to_le_bytes()).collect();
    npy(&format!("<U{}", text.chars().count()), false, "()", &code_points)
}

fn doubles(shape: &str, values: &[f64]) -> Vec<u8> {
    npy("<f8", false, shape, &values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>())
}

fn long(shape: &str, values: &[i64]) -> Vec<u8> {
    npy("<i8", false, shape, &values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>())
}

fn npz(arrays: &[(&str, Vec<u8>)], method: CompressionMethod) -> Cursor<Vec<u8>> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, array) in arrays {
        zip.start_file(format!("{name}.npy"), SimpleFileOptions::default().compression_method(method)).unwrap();
        zip.write_all(array).unwrap();
    }
    zip.finish().unwrap()
}

fn stored(arrays: &[(&str, Vec<u8>)]) -> Cursor<Vec<u8>> {
    npz(arrays, CompressionMethod::Stored)
}

/// Three particles in the plane, of as many types as there are.
fn valid() -> Vec<(&'static str, Vec<u8>)> {
    let columns: Vec<u8> = [0.0_f64, 1.0, 1.5, 0.0, 0.25, 0.5].iter().flat_map(|x| x.to_be_bytes()).collect();
    let half: Vec<u8> = [1.0_f32, 2.0, 3.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    vec![
        (
            "scene",
            text(
                r#"{"name": "net é", "gravity": [0, -9.81], "constraints": [{"particles": [0]}], "time": {"duration": 0.5}}"#,
            ),
        ),
        ("particles.positions", npy(">f8", true, "(3, 2)", &columns)),
        ("particles.velocities", npy("|i1", false, "(3, 2)", &[0, 0, 255, 2, 0, 0])),
        ("particles.masses", npy("<f4", false, "(3,)", &half)),
        ("springs.pairs", long("(2, 2)", &[0, 1, 1, 2])),
        ("springs.stiffness", npy("|u1", false, "()", &[100])),
        ("springs.damping", doubles("(2,)", &[0.25, 0.0])),
    ]
}

/// What is said of the valid arrays with one put in place of another, or beside them.
fn message(name: &str, array: Vec<u8>) -> String {
    let mut arrays = valid();
    match arrays.iter_mut().find(|(known, _)| *known == name) {
        Some((_, known)) => *known = array,
        None => {
            return Scene::from_npz(stored(&[&arrays[..], &[(Box::leak(name.into()), array)]].concat()))
                .unwrap_err()
                .to_string();
        }
    }
    Scene::from_npz(stored(&arrays)).and_then(|scene| scene.build()).unwrap_err().to_string()
}

#[test]
fn types_orders_and_compression_do_not_matter() {
    for method in [CompressionMethod::Stored, CompressionMethod::Deflated] {
        let scene = Scene::from_npz(npz(&valid(), method)).unwrap();
        assert_eq!(scene.name, "net é");
        let rows: [Row; 3] = [[0.0, 0.0].into(), [1.0, 0.25].into(), [1.5, 0.5].into()];
        assert_eq!(scene.particles.positions, rows);
        let rows: Vec<Row> = vec![[0.0, 0.0].into(), [-1.0, 2.0].into(), [0.0, 0.0].into()];
        assert_eq!(scene.particles.velocities, Some(rows));
        assert_eq!(scene.particles.masses, Some(Values::Each(vec![1.0, 2.0, 3.0])));
        assert_eq!(scene.springs.pairs, [[0, 1], [1, 2]]);
        assert_eq!(scene.springs.stiffness, Some(Values::Uniform(100.0)));
        assert_eq!(scene.springs.damping, Some(Values::Each(vec![0.25, 0.0])));
        assert_eq!((scene.constraints.len(), scene.time.duration), (1, Some(0.5)));
        let (system, _) = scene.build().unwrap();
        assert_eq!(system.dofs().len(), 4);
    }
}

#[test]
fn everything_may_be_an_array_or_text() {
    let arrays_alone =
        [("particles.positions", doubles("(1, 3)", &[1.0, 2.0, 3.0])), ("particles.masses", doubles("()", &[2.0]))];
    Scene::from_npz(stored(&arrays_alone)).unwrap().build().unwrap();
    let text_alone = [("scene", text(r#"{"particles": {"positions": [[1, 2, 3]], "masses": 2}}"#))];
    assert_eq!(Scene::from_npz(stored(&text_alone)).unwrap().particles.positions.len(), 1);
}

#[test]
fn what_is_wrong_is_named() {
    let twice = "NPZ: particles.masses: is given twice, by an array and in the text of scene";
    assert_eq!(message("scene", text(r#"{"particles": {"masses": 1}}"#)), twice);
    let unknown = message("particles.mass", doubles("()", &[1.0]));
    assert!(
        unknown.starts_with("NPZ: particles.mass: is no array of a scene; those are particles.positions, "),
        "{unknown}"
    );
    let cases = [
        (
            "particles.positions",
            doubles("(6,)", &[0.0; 6]),
            "has the shape (6), not one row of 1 to 3 numbers for each",
        ),
        (
            "particles.positions",
            doubles("(1, 4)", &[0.0; 4]),
            "has the shape (1, 4), not one row of 1 to 3 numbers for each",
        ),
        ("particles.masses", doubles("(3, 1)", &[1.0; 3]), "has the shape (3, 1), neither one number nor a list"),
        ("particles.masses", npy("<c8", false, "(1,)", &[0; 8]), "has type '<c8', not one of real numbers"),
        ("springs.pairs", doubles("(1, 2)", &[0.0, 1.0]), "has type '<f8', not one of whole numbers"),
        ("springs.pairs", long("(1, 3)", &[0, 1, 2]), "has the shape (1, 3), not one row of 2 numbers for each"),
        ("springs.pairs", long("(2, 2)", &[0, 1, 1, -2]), "entry 1 is -2, not the number of a particle"),
        (
            "springs.damping",
            doubles("(1000000000000000,)", &[0.0]),
            "speaks of 8000000000000000 bytes where there are 136",
        ),
        ("springs.damping", doubles("(9223372036854775807, 9)", &[0.0]), "speaks of more numbers than there can be"),
        ("scene", doubles("()", &[0.0]), "must be text"),
        ("scene", text("[1]"), "is a list, must be a table at line 1 column 1"),
        (
            "scene",
            text(r#"{"gravty": 1}"#),
            "gravty: unknown key gravty, must be one of name, gravity, particles, springs, mesh, constraints, forces, drag, time at line 1 column 9; did you mean gravity?",
        ),
    ];
    for (name, array, expected) in cases {
        assert_eq!(message(name, array), format!("NPZ: {name}: {expected}"));
    }
    let mut long_header = b"\x93NUMPY\x02\x00\xff\xff\xff\x7f".to_vec();
    long_header.resize(200, b' ');
    let expected = "NPZ: springs.damping: has a header of 2147483647 bytes, more than the 1024 of a plain array";
    assert_eq!(message("springs.damping", long_header), expected);
    // Values are checked as those of any scene.
    let negative = message("particles.masses", doubles("(3,)", &[1.0, -1.0, 1.0]));
    assert_eq!(negative, "particles.masses[1] = -1: must be finite and positive");
    assert!(Scene::from_npz(Cursor::new(b"not a zip".to_vec())).is_err());
}

/// Headers as long, and lengths with as many digits, as there may be are read; one more is not.
#[test]
fn headers_have_limits() {
    let padded = |length: usize| {
        let array = doubles("(3,)", &[1.0, -1.0, 1.0]);
        let (start, rest) = array.split_at(array.iter().position(|&byte| byte == b'\n').unwrap());
        let mut bytes = start.to_vec();
        bytes.resize(10 + length - 1, b' ');
        bytes.extend(rest);
        bytes[8..10].copy_from_slice(&(length as u16).to_le_bytes());
        message("particles.masses", bytes)
    };
    assert_eq!(padded(1024), "particles.masses[1] = -1: must be finite and positive");
    let expected = "NPZ: particles.masses: has a header of 1025 bytes, more than the 1024 of a plain array";
    assert_eq!(padded(1025), expected);
    // With the digit of the type they are 18, and 19.
    let of_length = |length: &str| message("particles.masses", doubles(&format!("({length},)"), &[1.0]));
    let expected = "NPZ: particles.masses: speaks of 80000000000000000 bytes where there are ";
    assert!(of_length("10000000000000000").starts_with(expected));
    assert_eq!(of_length("100000000000000000"), "NPZ: particles.masses: speaks of more numbers than there can be");
}

#[test]
fn a_file_is_named_in_errors_and_names_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("net.npz");
    let arrays = [("particles.positions", doubles("(1, 1)", &[f64::NAN])), ("particles.masses", doubles("()", &[1.0]))];
    std::fs::write(&path, stored(&arrays).into_inner()).unwrap();
    let scene = Scene::load(&path).unwrap();
    assert_eq!(scene.name, "net");
    let error = scene.build().unwrap_err().to_string();
    assert!(error.starts_with(&format!("{}: particles.positions[0]", path.display())), "{error}");
}
