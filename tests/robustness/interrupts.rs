//! Ctrl-C: whatever a run is at, it ends after at most one factorization, with everything written and a line that says so.
#![cfg(unix)]

use crate::command::{Answer, Sandbox};
use std::process::Stdio;
use std::time::{Duration, Instant};

/// Starts a command, interrupts it when it has been at work for a moment, and waits for its end. What goes on for minutes
/// regardless is a failure; the limit is far from what any machine needs.
fn interrupted(sandbox: &Sandbox, arguments: &str, signal: &str) -> Answer {
    let arguments: Vec<&str> = arguments.split(' ').collect();
    let mut child = sandbox.command(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // The folder is there when the signals are caught and the computation has begun.
    let started = Instant::now();
    while !sandbox.path("o").exists() && started.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(5));
    }
    std::thread::sleep(Duration::from_millis(200));
    let id = child.id().to_string();
    assert!(std::process::Command::new("kill").args([signal, &id]).status().unwrap().success());
    let asked = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if asked.elapsed() > Duration::from_secs(60) {
            child.kill().unwrap();
            panic!("goes on: {arguments:?}");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let output = child.wait_with_output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Answer { status: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

#[test]
fn every_method_ends_when_asked_to_inside_a_step_too() {
    let sandbox = Sandbox::new();
    for (kind, size) in [("cloth", "60"), ("chain", "100000")] {
        let scene = sandbox.sprung(&["new", kind, "--size", size]).ends_with(0).stdout;
        sandbox.put(&format!("{kind}.toml"), &scene);
    }
    for (what, signal) in [
        // One record in ten seconds, and thousands of steps to it.
        ("cloth.toml --rtol 1e-8 --dt 10 --duration 100", "-INT"),
        // One step that needs more iterations than anyone waits for.
        ("chain.toml --dt 10 --steps 1000 --solver cg --preconditioner none --stiffness axial", "-INT"),
        ("cloth.toml --dt 0.05 --steps 1000000 --method backward-euler", "-TERM"),
        ("cloth.toml --dt 0.05 --steps 1000000 --method implicit-midpoint --solver cg", "-INT"),
        ("cloth.toml --dt 1e-6 --steps 1000000000 --method symplectic-euler", "-HUP"),
    ] {
        let answer = interrupted(&sandbox, &format!("run {what} --out o --quiet"), signal);
        // A step that happens to break down first says so; nothing else is an answer.
        answer.ends_with(1).complains(&["error: interrupted in step "]);
        let summary = sandbox.json("o/summary.json");
        assert_eq!(summary["status"], "interrupted", "{what}");
        assert_eq!(sandbox.json("o/final.json")["steps"], summary["steps"]);
        assert!(sandbox.names("o").iter().all(|name| !name.ends_with(".part")));
        std::fs::remove_dir_all(sandbox.path("o")).unwrap();
    }
}

/// Under `nohup` a hangup is ignored, and stays so.
#[test]
fn a_hangup_that_is_ignored_is_none() {
    let sandbox = Sandbox::new();
    let scene = sandbox.sprung(&["new", "cloth", "--size", "4"]).ends_with(0).stdout;
    sandbox.put("cloth.toml", &scene);
    let program = env!("CARGO_BIN_EXE_sprung");
    let run = format!("{program} run cloth.toml --dt 1e-5 --steps 20000 --frames 1000 --out o");
    let script = format!(
        "trap '' HUP; {run} & while [ ! -e o/frames/frame_001000.vtp ]; do sleep 0.01; done; kill -HUP $!; wait $!"
    );
    let output = sandbox.shell(&script).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(sandbox.json("o/summary.json")["status"], "completed");
}
