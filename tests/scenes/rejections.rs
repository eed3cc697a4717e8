//! What a scene may not contain, one wrong thing per test, and what is said about it: file, key, index, value and rule.

use crate::rejected::{VALID, edited};
use sprung::scene::{Kind, Scene, builtin};
use sprung::{State, System};
use std::path::Path;

fn load_and_build(path: &Path) -> sprung::Result<(System, State)> {
    Scene::load(path)?.build()
}

/// The message about a scene file with this name and text, without the folder.
fn message(name: &str, text: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, text).unwrap();
    let error = load_and_build(&path).expect_err("must be rejected");
    let prefix = format!("{}/", folder.path().display());
    error.to_string().strip_prefix(&prefix).expect("must begin with the file").to_owned()
}

macro_rules! one_test_each {
    ($($name:ident: $from:expr, $to:expr => $message:expr;)*) => {
        $(
            #[test]
            fn $name() {
                assert_eq!(message("scene.toml", &edited($from, $to)), format!("scene.toml: {}", $message));
            }
        )*
    };
}

rejections!(one_test_each);

#[test]
fn the_scene_that_the_wrong_things_are_put_into_is_valid() {
    Scene::from_toml(VALID).unwrap().build().unwrap();
}

#[test]
fn json_is_rejected_with_the_same_words() {
    let scene = |masses: &str| format!(r#"{{"particles": {{"positions": [[0], [1]], "masses": {masses}}}}}"#);
    assert_eq!(message("s.json", &scene("[1, -1]")), "s.json: particles.masses[1] = -1: must be finite and positive");
    let not_json = "s.json: particles.masses[1]: expected value at line 1 column 55";
    assert_eq!(message("s.json", &scene("[1, NaN]")), not_json);
    let overflow = "s.json: particles.masses: number out of range at line 1 column 55";
    assert_eq!(message("s.json", &scene("1e999")), overflow);
    // JavaScript and others write NaN as null.
    let null = "s.json: particles.masses[1]: is null, must be a number at line 1 column 58";
    assert_eq!(message("s.json", &scene("[1, null]")), null);
    assert_eq!(message("s.json", "{} {}"), "s.json: trailing characters at line 1 column 4");
}

#[test]
fn a_table_is_not_a_list() {
    let expected = "s.json: time: is a list, must be a table at line 1 column 9";
    assert_eq!(message("s.json", r#"{"time": [0.1, 1.0]}"#), expected);
    assert_eq!(message("s.json", "[]"), "s.json: is a list, must be a table at line 1 column 1");
    let entry = "s.json: constraints[0]: is a list, must be a table at line 1 column 17";
    assert_eq!(message("s.json", r#"{"constraints": [[[0]]]}"#), entry);
}

#[test]
fn an_axis_that_a_planar_scene_does_not_have() {
    let text = "[particles]\npositions = [[0, 0]]\nmasses = 1\n[[constraints]]\nparticles = [0]\naxes = [\"y\", \"z\"]";
    let expected = "s.toml: constraints[0].axes[1] = \"z\": is not modelled: the scene's rows have length 2";
    assert_eq!(message("s.toml", text), expected);
}

#[test]
fn an_unsuitable_default_name() {
    let expected = "s\u{7}.toml: name = \"s\\u{7}\": must do as a folder's name: no path separators, no control characters, \
                    not \".\" or \"..\"";
    assert_eq!(message("s\u{7}.toml", ""), expected);
}

#[test]
fn a_byte_that_is_not_text() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.toml");
    std::fs::write(&path, b"name = \"\xff\"").unwrap();
    let error = load_and_build(&path).unwrap_err().to_string();
    assert_eq!(error, format!("{}: is no text in UTF-8", path.display()));
}

#[test]
fn a_file_that_is_not_there() {
    let error = load_and_build(Path::new("no-such-folder/s.toml")).unwrap_err();
    assert!(error.to_string().starts_with("no-such-folder/s.toml: "), "{error}");
}

#[test]
fn another_extension() {
    for name in ["scene.yaml", "scene", ".toml"] {
        let error = load_and_build(Path::new(name)).unwrap_err();
        assert_eq!(error.to_string(), format!("{name}: a scene file must end in .toml, .json or .npz"));
    }
}

#[test]
fn a_size_that_a_kind_does_not_have() {
    for kind in Kind::ALL {
        for size in [0, kind.sizes().end() + 1, usize::MAX] {
            let error = builtin(kind, size).unwrap_err();
            let expected = format!("size {size}: a {} can have a size from 1 to {}", kind.name(), kind.sizes().end());
            assert_eq!(error.to_string(), expected);
        }
    }
}
