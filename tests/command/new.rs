//! `sprung new`: ready scenes that run.

use crate::sandbox::Sandbox;
use sprung::Scene;
use sprung::scene::{Kind, builtin};
use std::process::Stdio;

#[test]
fn every_kind_is_the_scene_that_the_library_makes_and_runs() {
    let sandbox = Sandbox::new();
    for kind in Kind::ALL {
        let name = kind.name();
        let expected = builtin(kind, kind.default_size()).unwrap();
        let toml = sandbox.sprung(&["new", name]).ends_with(0).stdout;
        let json = sandbox.sprung(&["new", name, "--json"]).ends_with(0).stdout;
        assert_eq!(Scene::from_toml(&toml).unwrap(), expected, "{name} as TOML");
        assert_eq!(Scene::from_json(&json).unwrap(), expected, "{name} as JSON");
        assert!(toml.contains('#'), "{name} has comments");
        assert_eq!(json.lines().count(), 1, "{name} is compact JSON");

        for (file, text) in [(format!("{name}.toml"), &toml), (format!("{name}.json"), &json)] {
            sandbox.put(&file, text);
            let answer = sandbox.sprung(&["run", &file, "--steps", "2", "--json"]).ends_with(0);
            assert_eq!(answer.json()["scene"], name);
        }
    }
}

#[test]
fn the_size_is_the_scene_s_size() {
    let sandbox = Sandbox::new();
    for size in [2, 5] {
        let toml = sandbox.sprung(&["new", "cloth", "--size", &size.to_string()]).ends_with(0).stdout;
        assert_eq!(Scene::from_toml(&toml).unwrap().particles.positions.len(), size * size);
    }
}

#[test]
fn unusable_kinds_and_sizes_are_refused() {
    let sandbox = Sandbox::new();
    let cases: [(&[&str], &[&str]); 5] = [
        (&["new"], &["KIND"]),
        (&["new", "house"], &["house", "cloth"]),
        (&["new", "cloth", "--size", "0"], &["0", "cloth", "1"]),
        (&["new", "cloth", "--size", "-3"], &["-3", "--size"]),
        (&["new", "cloth", "--size", "99999999999"], &["99999999999", "cloth"]),
    ];
    for (arguments, parts) in cases {
        let answer = sandbox.sprung(arguments).ends_with(2);
        answer.complains(parts);
        assert_eq!(answer.stdout, "");
    }
}

#[test]
fn a_reader_that_leaves_early_is_no_failure() {
    let sandbox = Sandbox::new();
    // Long enough not to fit into a pipe.
    let mut command = sandbox.command(&["new", "cloth", "--size", "150"]);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), output.stderr.len()), (Some(0), 0));
}

#[test]
fn help_and_version_are_there_for_every_command() {
    let sandbox = Sandbox::new();
    let version = sandbox.sprung(&["--version"]).ends_with(0).stdout;
    assert_eq!(version.trim(), concat!("sprung ", env!("CARGO_PKG_VERSION")));
    let help = sandbox.sprung(&["--help"]).ends_with(0).stdout;
    for name in ["run", "matrix", "new"] {
        assert!(help.contains(&format!("\n  {name} ")), "{name} is not in {help}");
        assert!(sandbox.sprung(&[name, "--help"]).ends_with(0).stdout.contains("--json"));
    }
    sandbox.sprung(&[]).ends_with(2);
    sandbox.sprung(&["dance"]).ends_with(2).complains(&["dance"]);
}

#[test]
fn a_file_holds_the_scene_in_the_format_of_its_ending() {
    let sandbox = Sandbox::new();
    let expected = builtin(Kind::Cloth, 4).unwrap();
    for file in ["cloth.toml", "cloth.json", "cloth.npz"] {
        assert_eq!(sandbox.sprung(&["new", "cloth", "--size", "4", "-o", file]).ends_with(0).stdout, "");
        assert_eq!(Scene { file: None, ..Scene::load(sandbox.path(file)).unwrap() }, expected, "{file}");
        sandbox.sprung(&["run", file, "--steps", "2", "--quiet"]).ends_with(0);
    }
    let refused = sandbox.sprung(&["new", "cloth", "-o", "cloth.yaml"]).ends_with(2);
    assert!(refused.stderr.contains("cloth.yaml: a scene file must end in .toml, .json or .npz"), "{}", refused.stderr);
}
