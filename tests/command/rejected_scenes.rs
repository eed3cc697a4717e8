//! The command says of an unusable scene what the library says: on stderr, with exit status 2, and nothing is written.

use crate::rejected::{VALID, edited};
use std::path::Path;
use std::process::{Command, Output};

macro_rules! table {
    ($($name:ident: $from:expr, $to:expr => $message:expr;)*) => {
        [$((stringify!($name), $from, $to, $message)),*]
    };
}

/// `sprung matrix FILE --out FOLDER/out` in the folder.
fn matrix(folder: &Path, file: &str) -> Output {
    let out = folder.join("out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_sprung"));
    command.args(["matrix", file, "--out"]).arg(out).current_dir(folder).output().unwrap()
}

/// What is in the folder.
fn listing(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn assert_refused(folder: &Path, file: &str, message: &str, context: &str) {
    let before = listing(folder);
    let output = matrix(folder, file);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(stderr.contains(message), "{context}: {stderr:?} does not say {message:?}");
    assert!(!stderr.contains("panicked"), "{context}: {stderr}");
    assert_eq!(output.status.code(), Some(2), "{context}");
    assert_eq!(String::from_utf8_lossy(&output.stdout), "", "{context}");
    assert_eq!(listing(folder), before, "{context}: something was written");
}

#[test]
fn the_valid_scene_is_accepted() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), VALID).unwrap();
    let output = matrix(folder.path(), "scene.toml");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(folder.path().join("out/A.mtx").exists());
}

#[test]
fn every_rejection_ends_with_status_2_and_its_message() {
    for (name, from, to, message) in rejections!(table) {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("scene.toml"), edited(from, to)).unwrap();
        assert_refused(folder.path(), "scene.toml", &format!("scene.toml: {message}"), name);
    }
}

#[test]
fn files_that_are_no_scenes_end_with_status_2() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("broken.json"), "{\"particles\": ").unwrap();
    std::fs::write(folder.path().join("latin.toml"), b"name = \"\xe9\"").unwrap();
    std::fs::write(folder.path().join("scene.yaml"), VALID).unwrap();
    std::fs::write(folder.path().join("mesh.toml"), "mesh.file = \"none.obj\"").unwrap();
    std::fs::create_dir(folder.path().join("folder.toml")).unwrap();
    for (file, message) in [
        ("broken.json", "broken.json: particles: the text ends in a value at line 1 column 14"),
        ("latin.toml", "latin.toml: is no text in UTF-8"),
        ("scene.yaml", "scene.yaml: a scene file must end in .toml, .json or .npz"),
        ("mesh.toml", "mesh.toml: mesh.file = \"none.obj\": "),
        ("folder.toml", "folder.toml: "),
        ("missing.toml", "missing.toml: "),
    ] {
        assert_refused(folder.path(), file, message, file);
    }
}
