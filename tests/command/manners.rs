//! How the command behaves towards people and shells.

use crate::sandbox::Sandbox;
use sprung::scene::builtin;
use std::io::Write;
use std::process::Stdio;

#[test]
fn shells_get_completions_and_readers_manual_pages() {
    let sandbox = Sandbox::new();
    for shell in ["bash", "zsh", "fish", "powershell"] {
        let script = sandbox.sprung(&["completions", shell]).ends_with(0).stdout;
        assert!(script.contains("sprung") && script.contains("--stiffness") || script.contains("stiffness"), "{shell}");
        assert!(script.contains("on-demand"), "{shell}: values too");
    }
    let page = sandbox.sprung(&["man"]).ends_with(0).stdout;
    assert!(page.contains(".TH sprung 1") && page.contains("inspect"), "{page}");
    let page = sandbox.sprung(&["man", "run"]).ends_with(0).stdout;
    assert!(page.contains(".TH sprung-run 1") && page.contains("frames"), "{page}");
    sandbox.sprung(&["man", "walk"]).ends_with(2).complains(&["no command walk"]);
}

#[test]
fn scenes_come_from_standard_input_too() {
    let sandbox = Sandbox::new();
    let scene = builtin::chain(3).unwrap();
    let run = |text: &str| {
        let mut command = sandbox.command(&["run", "-", "--dt", "0.01", "--steps", "2", "--out", "out", "-q"]);
        let mut child = command.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
        let output = child.wait_with_output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    for text in [scene.to_toml(), format!("\n  {}", scene.to_json())] {
        assert_eq!(run(&text).0, Some(0));
        assert_eq!(sandbox.json("out/summary.json")["particles"], 4);
    }
    let (status, said) = run("gravty = [0, 0, 0]");
    assert_eq!(status, Some(2));
    assert!(said.contains("standard input: ") && said.contains("gravty"), "{said}");
    let (status, said) = run("[particles]\npositions = [[0, 0, 0]]\nmasses = -1.0\n");
    assert_eq!(status, Some(2));
    assert!(said.contains("standard input: particles.masses = -1: must be positive"), "{said}");
}

#[test]
fn what_was_meant_is_suggested() {
    let sandbox = Sandbox::new();
    let scenes = [
        ("gravty = [0.0, -9.81, 0.0]", "did you mean gravity?"),
        ("[springs]\nstifness = 1.0", "did you mean stiffness?"),
        ("[time]\nduratoin = 1.0", "did you mean duration?"),
    ];
    for (text, suggestion) in scenes {
        sandbox.put("scene.toml", text);
        sandbox.sprung(&["run", "scene.toml"]).ends_with(2).complains(&[suggestion]);
    }
    sandbox.put("scene.toml", "zzz = 1");
    let said = sandbox.sprung(&["run", "scene.toml"]).ends_with(2).stderr;
    assert!(!said.contains("did you mean"), "{said}");
    sandbox.sprung(&["new", "clot"]).ends_with(2).complains(&["cloth"]);
    sandbox.sprung(&["inspct"]).ends_with(2).complains(&["inspect"]);
    sandbox.sprung(&["rnu"]).ends_with(2).complains(&["a similar subcommand exists: 'run'"]);
    sandbox.sprung(&["run", "scene.toml", "--method", "w3"]).ends_with(2).complains(&["a similar value exists: 'w2'"]);
    sandbox.sprung(&["new", "cloth", "--size", "-3"]).ends_with(2).complains(&["must be a whole number above zero"]);
}

#[test]
fn options_without_an_effect_are_refused() {
    let sandbox = Sandbox::new();
    let answer = sandbox.sprung(&["new", "cloth", "--json", "-o", "cloth.toml"]).ends_with(2);
    answer.complains(&["error: --json: it is for a scene that is printed"]);
    sandbox.put("cloth.toml", &sandbox.sprung(&["new", "cloth"]).ends_with(0).stdout);
    let answer = sandbox.sprung(&["run", "cloth.toml", "--accuracy", "0.1", "--no-error-estimate"]).ends_with(2);
    answer.complains(&["--accuracy", "cannot be used with '--no-error-estimate'"]);
    assert_eq!(sandbox.names("."), ["cloth.toml"]);
}

#[test]
fn numbers_that_are_too_large_are_told_from_others() {
    let sandbox = Sandbox::new();
    let (large, zero) = ("99999999999999999999999", "000");
    for (option, number, rule) in [
        ("--steps", large, "is too large"),
        ("--steps", "1.5", "must be a whole number, not negative"),
        ("--frames", large, "is too large"),
        ("--frames", zero, "must be a whole number above zero"),
        ("--frames", "", "must be a whole number above zero"),
    ] {
        sandbox.sprung(&["run", "none.toml", option, number]).ends_with(2).complains(&[&format!(": {rule}\n")]);
    }
}

#[test]
fn colour_is_a_choice() {
    let sandbox = Sandbox::new();
    let colours = |arguments: &[&str], no_color: bool| {
        let mut command = sandbox.command(arguments);
        if no_color {
            command.env("NO_COLOR", "1");
        }
        String::from_utf8(command.output().unwrap().stderr).unwrap().contains('\u{1b}')
    };
    assert!(!colours(&["run", "none.toml"], false), "not a terminal");
    assert!(colours(&["run", "none.toml", "--color", "always"], false));
    assert!(colours(&["--color=always", "wrong"], false), "arguments that are wrong, too");
    assert!(!colours(&["run", "none.toml", "--color", "never"], false));
    assert!(!colours(&["run", "none.toml"], true));
}

/// Hints are not errors: they say what can be done.
#[test]
fn hints_are_called_help() {
    let sandbox = Sandbox::with("column.toml", &builtin::column(9).unwrap().to_toml());
    let run = [
        "run",
        "column.toml",
        "--method",
        "linear-backward-euler",
        "--dt",
        "0.02",
        "--stiffness",
        "full",
        "--solver",
        "llt",
    ];
    let said = sandbox.sprung(&run).ends_with(1).stderr;
    assert!(said.contains("help: --stiffness on-demand carries on"), "{said}");
    assert!(said.contains("help: this repeats the step: sprung run"), "{said}");
}
