//! Ctrl-C: whatever a run is at, it ends after at most one factorization, with everything written and a line that says so.
#![cfg(target_os = "linux")]

use crate::sandbox::{Answer, Sandbox};
use serde_json::Value;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Starts a command, interrupts it when it has been at work for a moment, and waits for its end.
fn interrupted(sandbox: &Sandbox, arguments: &str, signal: &str) -> Answer {
    interrupted_after(30, sandbox, arguments, signal)
}

/// The same, after so many hundredths of a second of work.
fn interrupted_after(work: u64, sandbox: &Sandbox, arguments: &str, signal: &str) -> Answer {
    let arguments: Vec<&str> = arguments.split(' ').collect();
    let mut child = started(sandbox, &arguments);
    // Where signals are caught there is something to keep.
    let started = Instant::now();
    while !has_interrupts(&child, "SigCgt:") && child.try_wait().unwrap().is_none() && started.elapsed() < PATIENCE {
        std::thread::sleep(Duration::from_millis(5));
    }
    let begun = computed(&child);
    while child.try_wait().unwrap().is_none() && computed(&child) < begun + work && started.elapsed() < PATIENCE {
        std::thread::sleep(Duration::from_millis(5));
    }
    ended(child, signal)
}

/// Starts a command that hears signals, though whoever runs the tests may be told to ignore them: what is ignored is inherited, and the
/// program leaves it so.
fn started(sandbox: &Sandbox, arguments: &[&str]) -> Child {
    let command = sandbox.command(arguments);
    let mut hearing = Command::new("env");
    hearing.arg("--default-signal=INT,HUP,TERM").arg(command.get_program()).args(arguments);
    hearing.current_dir(sandbox.path(".")).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = hearing.spawn().unwrap();
    while has_interrupts(&child, "SigIgn:") && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    child
}

/// Signals a command and waits for its end. What goes on for minutes regardless is a failure; the limit is far from what any
/// machine needs.
fn ended(mut child: Child, signal: &str) -> Answer {
    let id = child.id().to_string();
    assert!(Command::new("kill").args([signal, &id]).status().unwrap().success());
    let asked = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if asked.elapsed() > PATIENCE {
            child.kill().unwrap();
            panic!("goes on");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let output = child.wait_with_output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Answer { status: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

const PATIENCE: Duration = Duration::from_secs(120);

/// Whether Ctrl-C is among the signals of a process that this key lists.
fn has_interrupts(child: &Child, key: &str) -> bool {
    let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
    let signals = status.lines().find_map(|line| line.strip_prefix(key)).unwrap_or_default();
    u64::from_str_radix(signals.trim(), 16).is_ok_and(|signals| signals >> 1 & 1 == 1)
}

/// Hundredths of a second that a process has computed: unlike the time they do not pass while others have the processor.
fn computed(child: &Child) -> u64 {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", child.id())).unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    after_name.split_whitespace().skip(11).take(2).filter_map(|ticks| ticks.parse::<u64>().ok()).sum()
}

fn scenes(sandbox: &Sandbox, scenes: &[(&str, &str)]) {
    for (kind, size) in scenes {
        sandbox.put_ready(kind, size);
    }
}

#[test]
fn every_method_ends_when_asked_to_inside_a_step_too() {
    let sandbox = Sandbox::new();
    scenes(&sandbox, &[("cloth", "60"), ("chain", "100000")]);
    for (what, signal) in [
        // One record in ten seconds, and thousands of steps to it.
        ("cloth.toml --rtol 1e-8 --dt 10 --duration 100", "-INT"),
        // One step that needs more iterations than anyone waits for.
        (
            "chain.toml --dt 10 --steps 1000 --solver cg --preconditioner none --stiffness axial --allow-unstable",
            "-INT",
        ),
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

/// An inspection says what it has found, and what it has not looked at.
#[test]
fn an_inspection_keeps_what_is_known() {
    let sandbox = Sandbox::new();
    scenes(&sandbox, &[("lattice", "12")]);
    // The analyses come first, and the picture of λ_min over the time step takes many times as long as all the rest.
    let arguments = "inspect lattice.toml --dt 0.01 --all --json --out o";
    let answer = interrupted_after(150, &sandbox, arguments, "-INT").ends_with(1);
    answer.complains(&["error: interrupted"]);
    let found: Value = serde_json::from_str(&answer.stdout).unwrap();
    let signs = ["negative", "zero", "positive"].map(|sign| found["inertia"][sign].as_u64().unwrap());
    assert_eq!(signs.iter().sum::<u64>(), found["dofs"].as_u64().unwrap());
    let left_out = found["left_out"].as_array().unwrap();
    assert!(!left_out.is_empty() && left_out.iter().all(|part| part["why"] == "interrupted"), "{left_out:?}");
    let page = sandbox.read("o/inspect.html");
    assert!(page.contains("Left out: ") && page.contains("as the inspection was interrupted"));
    assert!(sandbox.names("o").iter().all(|name| !name.ends_with(".part")));
    // On the way to a state: what was lost until then.
    std::fs::remove_dir_all(sandbox.path("o")).unwrap();
    sandbox.put("o/inspect.html", "old");
    let answer = interrupted(&sandbox, "inspect lattice.toml --dt 1e-6 --steps 1000000 --out o", "-INT").ends_with(1);
    answer.complains(&["error: interrupted"]);
}

/// A report has the checks that were made, a chart the runs.
#[test]
fn checks_and_runs_that_were_made_are_kept() {
    let sandbox = Sandbox::new();
    scenes(&sandbox, &[("cloth", "12")]);
    let answer = interrupted(&sandbox, "verify cloth.toml --out o", "-INT").ends_with(1);
    answer.complains(&["error: interrupted: the report has the checks that were made until then"]);
    let checks = sandbox.json("o/report.json");
    assert!(checks["checks"].as_array().is_some_and(|checks| !checks.is_empty()), "{checks}");
    assert!(sandbox.read("o/report.html").contains("</html>"));
    std::fs::remove_dir_all(sandbox.path("o")).unwrap();

    let answer = interrupted(&sandbox, "chart cloth.toml --dt 0.01 --duration 0.02 --budget 600 --out o", "-TERM");
    let answer = answer.ends_with(1);
    answer.complains(&["error: interrupted"]);
    assert!(sandbox.names("o").iter().all(|name| !name.ends_with(".part")));
    if answer.stderr.contains("the chart has the runs") {
        assert!(sandbox.json("o/chart.json")["runs"].is_array());
    }
}

/// Runs for an accuracy that come to no answer say so; one that has an answer keeps it.
#[test]
fn a_search_for_an_accuracy_ends_too() {
    let sandbox = Sandbox::new();
    scenes(&sandbox, &[("cloth", "30")]);
    let answer = interrupted(&sandbox, "run cloth.toml --duration 50 --accuracy 1e-6 --out o", "-INT").ends_with(1);
    answer.complains(&["error: interrupted"]);
    assert!(sandbox.names("o").iter().all(|name| !name.ends_with(".part")));
}

/// Before there is anything to keep, while a scene is read and the solver set up, the process ends as any other does.
#[test]
fn nothing_is_lost_before_anything_is_begun() {
    let sandbox = Sandbox::new();
    scenes(&sandbox, &[("lattice", "40")]);
    for command in [
        "run lattice.toml --steps 1000 --solver cg --preconditioner multigrid --out o",
        "run lattice.toml --steps 1000 --solver cg --preconditioner jacobi --out o",
        "verify lattice.toml --out o",
        "inspect lattice.toml --out o",
        "chart lattice.toml --out o",
        "matrix lattice.toml --dt 0.01 --out o",
    ] {
        for ticks in [0, 2, 10] {
            let arguments: Vec<&str> = command.split(' ').collect();
            let child = started(&sandbox, &arguments);
            while computed(&child) < ticks {
                std::thread::sleep(Duration::from_millis(1));
            }
            let status = ended(child, "-INT").status;
            assert!(matches!(status, None | Some(1 | 130)), "{command}: {status:?}");
            let left = if sandbox.path("o").exists() { sandbox.names("o") } else { Vec::new() };
            assert!(left.iter().all(|name| !name.ends_with(".part")), "{command}: {left:?}");
            let _ = std::fs::remove_dir_all(sandbox.path("o"));
        }
    }
}

/// Under `nohup` a hangup is ignored, and stays so.
#[test]
fn a_hangup_that_is_ignored_is_none() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "4");
    let program = env!("CARGO_BIN_EXE_sprung");
    let run = format!("{program} run cloth.toml --dt 1e-5 --steps 20000 --frames 1000 --out o");
    let script = format!(
        "trap '' HUP; {run} & while [ ! -e o/frames/frame_001000.vtp ]; do sleep 0.01; done; kill -HUP $!; wait $!"
    );
    let output = sandbox.shell(&script).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(sandbox.json("o/summary.json")["status"], "completed");
}
