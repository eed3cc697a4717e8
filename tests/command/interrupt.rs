//! `sprung run` stopped from outside.
#![cfg(unix)]

use crate::sandbox::Sandbox;
use serde_json::json;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A run of a billion steps that has written at least one frame after the first, started over older results.
fn long_run(sandbox: &Sandbox) -> Child {
    sandbox.put_ready("cloth", "4");
    for name in ["summary.json", "final.json", "energy.csv"] {
        sandbox.put(&format!("o/{name}"), "old");
    }
    let arguments = ["run", "cloth.toml", "--dt", "1e-6", "--steps", "1000000000", "--frames", "20", "--out", "o"];
    let child =
        sandbox.command(&arguments).arg("--json").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let patience = Instant::now() + Duration::from_secs(60);
    while !sandbox.path("o/frames/frame_000020.vtp").exists() {
        assert!(Instant::now() < patience, "the run does not start");
        std::thread::sleep(Duration::from_millis(5));
    }
    child
}

fn send(signal: &str, child: &Child) {
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
}

#[test]
fn an_interrupted_run_ends_after_its_step_with_everything_written() {
    for signal in ["-INT", "-TERM"] {
        let sandbox = Sandbox::new();
        let child = long_run(&sandbox);
        send(signal, &child);
        let output = child.wait_with_output().unwrap();

        assert_eq!(output.status.code(), Some(1));
        let summary = sandbox.json("o/summary.json");
        assert_eq!(serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap(), summary);
        assert_eq!(summary["status"], "interrupted");
        let steps = summary["steps"].as_u64().unwrap();
        assert!((20..1_000_000_000).contains(&steps));
        assert_eq!(summary["time"], json!(steps as f64 * 1e-6));
        assert_eq!(sandbox.json("o/final.json")["steps"], steps);
        let rows = sandbox.csv("o/energy.csv");
        assert_eq!(rows.len() as u64, steps + 1);
        assert_eq!(summary["energy"]["final"], rows[steps as usize][4]);
        assert_eq!(
            sandbox.names("o"),
            ["energy.csv", "final.json", "frames", "frames.pvd", "summary.json", "trajectory.npz"]
        );
        let frames = sandbox.names("o/frames");
        assert_eq!(frames.len() as u64, steps / 20 + 1);
        let series = sandbox.read("o/frames.pvd");
        assert!(frames.iter().all(|name| series.contains(&format!("frames/{name}"))));
    }
}

#[test]
fn a_killed_run_leaves_older_results_whole() {
    let sandbox = Sandbox::new();
    let mut child = long_run(&sandbox);
    child.kill().unwrap();
    child.wait().unwrap();
    for name in ["summary.json", "final.json", "energy.csv"] {
        assert_eq!(sandbox.read(&format!("o/{name}")), "old");
    }
    let series = sandbox.read("o/frames.pvd");
    assert!(series.trim_end().ends_with("</VTKFile>"), "{series}");
}

/// What is in the making: files, and the folders of runs that may become the answer.
fn in_the_making(sandbox: &Sandbox) -> Vec<String> {
    let entries = std::fs::read_dir(sandbox.path("o")).into_iter().flatten().flatten();
    entries
        .filter_map(|entry| entry.file_name().into_string().ok())
        .filter(|name| name.starts_with(".sprung-"))
        .collect()
}

/// A cloth that folds for 5 s: the first run takes seconds and does not reach the accuracy, the second takes longer.
#[test]
fn an_interrupted_search_leaves_the_best_answer_with_its_estimate() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "8");
    let arguments =
        ["run", "cloth.toml", "--method", "dop853", "--accuracy", "1e-8", "--duration", "5", "--out", "o", "--json"];
    let child = sandbox.command(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let (mut seen, patience) = (std::collections::BTreeSet::new(), Instant::now() + Duration::from_secs(120));
    while seen.len() < 2 {
        assert!(Instant::now() < patience, "the search does not come to its second run");
        // Folders of runs; a file that the search tries the disk with may be seen too.
        seen.extend(in_the_making(&sandbox).into_iter().filter(|name| !name.ends_with(".part")));
        std::thread::sleep(Duration::from_millis(1));
    }
    send("-INT", &child);
    let output = child.wait_with_output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("interrupted: "), "{message}");
    let summary = sandbox.json("o/summary.json");
    assert_eq!(serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap(), summary);
    assert_eq!((&summary["status"], &summary["time"]), (&json!("interrupted"), &json!(5.0)));
    let error = &summary["error"];
    assert_eq!(error["kind"], "indicator");
    assert!(error["estimate"].as_f64().unwrap() > 1e-8, "{error}");
    assert_eq!(sandbox.json("o/final.json")["time"], 5.0);
    assert!(sandbox.csv("o/energy.csv").len() > 100);
    assert_eq!(in_the_making(&sandbox), [""; 0]);
    let (run, total) = (summary["effort"]["run"].as_f64().unwrap(), summary["effort"]["total"].as_f64().unwrap());
    assert!(run > 0.0 && total > run, "{run} {total}");
}
