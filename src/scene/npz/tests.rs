//! What is written is read again, and what is read may be of any type of NumPy's real numbers.

use super::NpzWriter;
use crate::scene::{Scene, Values};
use std::io::{Cursor, Write};
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

const NET: &str = r#"{
    "name": "net", "gravity": [0.5, -9.81],
    "particles": {"positions": [[0, 0], [1, 0]], "velocities": [[0, 0], [0, 2.5]], "masses": [1, 3]},
    "springs": {"pairs": [[0, 1]], "stiffness": 100, "rest_lengths": [0.9]},
    "constraints": [{"particles": [0]}],
    "time": {"dt": 0.01, "duration": 2}
}"#;

fn written(scene: &Scene) -> Vec<u8> {
    let mut bytes = Vec::new();
    scene.write_npz(&mut bytes).unwrap();
    bytes
}

fn has(bytes: &[u8], name: &str) -> bool {
    ZipArchive::new(Cursor::new(bytes)).unwrap().index_for_name(&format!("{name}.npy")).is_some()
}

/// Rows of one length are an array; those of two lengths stand in the text.
#[test]
fn scenes_are_read_as_they_were_written() {
    let scene = Scene::from_json(NET).unwrap();
    let bytes = written(&scene);
    let names =
        ["particles.positions", "particles.velocities", "particles.masses", "springs.pairs", "springs.stiffness"];
    for name in names {
        assert!(has(&bytes, name), "{name}");
    }
    let again = Scene::from_npz(Cursor::new(&bytes)).unwrap();
    assert_eq!(again.to_json(), scene.to_json());
    let text = scene.to_json();
    for part in ["-9.81", "\"dt\"", "\"duration\"", "net"] {
        assert!(text.contains(part), "{part} in {text}");
    }
    let mut uneven = scene;
    uneven.particles.positions[1] = [1.0, 0.0, 0.0].into();
    assert!(!has(&written(&uneven), "particles.positions"));
}

/// Whole numbers and others, of one byte to eight.
#[test]
fn masses_may_be_of_any_real_type() {
    let masses = |put: &dyn Fn(&mut NpzWriter<&mut Vec<u8>>)| {
        let mut bytes = Vec::new();
        let mut npz = NpzWriter::new(&mut bytes);
        npz.put("particles.positions", &[2, 1], [0.0, 1.0].into_iter()).unwrap();
        put(&mut npz);
        npz.finish().unwrap();
        match Scene::from_npz(Cursor::new(&bytes)).unwrap().particles.masses {
            Some(Values::Each(masses)) => masses,
            other => panic!("{other:?}"),
        }
    };
    macro_rules! of {
        ($($type:ty)*) => {
            $(assert_eq!(
                masses(&|npz| npz.put("particles.masses", &[2], [3 as $type, 7 as $type].into_iter()).unwrap()),
                [3.0, 7.0],
                stringify!($type)
            );)*
        };
    }
    of!(f64 f32 i64 i32 i16 i8 u64 u32 u16 u8);
}

/// What reading an array of masses with this header, filled up with blanks to a length, and no numbers complains of.
fn refusal(header: &str, length: usize) -> String {
    let mut bytes = Cursor::new(Vec::new());
    let mut zip = ZipWriter::new(&mut bytes);
    zip.start_file("particles.masses.npy", SimpleFileOptions::default()).unwrap();
    let mut header = header.to_owned().into_bytes();
    header.resize(length - 1, b' ');
    header.push(b'\n');
    zip.write_all(b"\x93NUMPY\x01\x00").unwrap();
    zip.write_all(&(length as u16).to_le_bytes()).unwrap();
    zip.write_all(&header).unwrap();
    zip.finish().unwrap();
    Scene::from_npz(Cursor::new(bytes.into_inner())).unwrap_err().to_string()
}

/// A header of 1024 bytes is looked into, and eighteen digits: seventeen of a length, and the 8 of the type.
#[test]
fn headers_are_read_up_to_their_limits() {
    let header = |count: &str| format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({count},), }}");
    let of = |digits: usize| header(&"1".repeat(digits));
    let missing = "speaks of 88888888888888888 bytes";
    assert!(refusal(&of(17), 128).contains(missing), "{}", refusal(&of(17), 128));
    assert!(refusal(&of(17), 1024).contains(missing), "{}", refusal(&of(17), 1024));
    assert!(refusal(&of(18), 128).contains("speaks of more numbers than there can be"));
    assert!(refusal(&of(17), 1025).contains("has a header of 1025 bytes"));
}

#[test]
fn meshes_are_named_as_they_were() {
    let text = r#"{"mesh": {"file": "net.obj", "scale": 0.5}, "springs": {"stiffness": 100}}"#;
    let scene = Scene::from_json(text).unwrap();
    let again = Scene::from_npz(Cursor::new(written(&scene))).unwrap();
    assert!(again.mesh.is_some());
    assert_eq!(again.to_json(), scene.to_json());
}

/// Takes so many bytes and no more.
struct Full(usize);

impl Write for Full {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0 = self.0.checked_sub(bytes.len()).ok_or(std::io::ErrorKind::StorageFull)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// What does not fit is an error, down to the last byte.
#[test]
fn files_are_whole_or_an_error() {
    let scene = Scene::from_json(NET).unwrap();
    let length = written(&scene).len();
    scene.write_npz(Full(length)).unwrap();
    assert!(scene.write_npz(Full(length - 1)).is_err());
    assert!(scene.write_npz(Full(10)).is_err());
}
