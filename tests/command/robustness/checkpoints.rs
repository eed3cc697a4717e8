//! Runs that are killed and resumed: in the end every file has the bytes of the run that nobody disturbed, but for the times that
//! were measured.

use crate::sandbox::Sandbox;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

/// Every method and solver, fixed and adaptive steps, the program's own choices.
const WAYS: [&str; 16] = [
    "--method linear-backward-euler",
    "--method linear-backward-euler --solver cg --preconditioner multigrid",
    "--method linear-backward-euler --solver cg --preconditioner jacobi",
    "--method linear-backward-euler --solver cg-assembled --preconditioner none",
    "--method linear-backward-euler --solver ldlt --stiffness full",
    "--method linear-backward-euler --solver auto --stiffness tension",
    "--method backward-euler",
    "--method backward-euler --solver cg",
    "--method bdf2",
    "--method w2 --stiffness axial",
    "--method w2 --solver cg",
    "--method implicit-midpoint",
    "--method symplectic-euler",
    "--method auto",
    "--method w2 --rtol 1e-3",
    "--method w2 --rtol 1e-2 --solver cg --threads 2",
];

fn sandbox() -> Sandbox {
    let sandbox = Sandbox::new();
    let scene = sandbox.sprung(&["new", "cloth", "--size", "7"]).ends_with(0).stdout;
    // A corner that moves, so that there is work to account for.
    let scene = scene.replacen("[time]", "[[constraints]]\nparticles = [3]\nvelocity = [0, 0, 0.5]\n\n[time]", 1);
    sandbox.put("cloth.toml", &scene);
    sandbox
}

fn arguments<'a>(way: &'a str, out: &'a str) -> Vec<&'a str> {
    let fixed = "run cloth.toml --dt 0.00005 --duration 0.020025 --frames 30 --checkpoint 40 --quiet --out";
    fixed.split(' ').chain([out]).chain(way.split(' ')).collect()
}

/// Starts a run, waits until it has a checkpoint, or is over, and kills it.
fn killed_after_a_checkpoint(sandbox: &Sandbox, arguments: &[&str], signal: &str) {
    let mut child = sandbox.command(arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let patience = Instant::now() + Duration::from_secs(120);
    while !sandbox.path("o/checkpoint").exists() && child.try_wait().unwrap().is_none() {
        assert!(Instant::now() < patience, "the run does not start");
        std::thread::sleep(Duration::from_millis(1));
    }
    let _ = std::process::Command::new("kill").args([signal, &child.id().to_string()]).status();
    child.wait().unwrap();
}

/// Every file but checkpoints by its name; of the summary all but the times.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    for inside in ["", "frames"] {
        for entry in std::fs::read_dir(folder.join(inside)).into_iter().flatten().map(Result::unwrap) {
            let name = format!("{inside}/{}", entry.file_name().to_str().unwrap());
            if entry.path().is_file() && !name.starts_with("/checkpoint") {
                let bytes = std::fs::read(entry.path()).unwrap();
                all.insert(name.clone(), if name == "/summary.json" { untimed(&bytes) } else { bytes });
            }
        }
    }
    all
}

fn untimed(bytes: &[u8]) -> Vec<u8> {
    let Value::Object(mut summary) = serde_json::from_slice(bytes).unwrap() else { panic!("no summary") };
    summary.remove("wall_seconds");
    summary.remove("factor");
    Value::Object(summary).to_string().into_bytes()
}

#[track_caller]
fn same(way: &str, expected: &BTreeMap<String, Vec<u8>>, found: &BTreeMap<String, Vec<u8>>) {
    assert_eq!(expected.keys().collect::<Vec<_>>(), found.keys().collect::<Vec<_>>(), "{way}");
    for (name, bytes) in expected {
        assert!(found[name] == *bytes, "{way}: {name} differs");
    }
}

/// Killed after a checkpoint and resumed, a run ends with the same bytes; a run that has ended leaves nothing to go on with.
#[test]
fn resumed_runs_have_the_bits_of_undisturbed_ones() {
    let sandbox = sandbox();
    let mut resumed = 0;
    for way in WAYS {
        sandbox.sprung(&arguments(way, "whole")).ends_with(0);
        let whole = files(&sandbox.path("whole"));
        assert!(
            !sandbox.path("whole/checkpoint").exists() && !whole.keys().any(|name| name.ends_with(".part")),
            "{way}"
        );
        killed_after_a_checkpoint(&sandbox, &arguments(way, "o"), "-KILL");
        resumed += u32::from(sandbox.path("o/checkpoint").exists());
        sandbox.sprung(&[&arguments(way, "o")[..], &["--resume"]].concat()).ends_with(0);
        same(way, &whole, &files(&sandbox.path("o")));
        std::fs::remove_dir_all(sandbox.path("whole")).unwrap();
        std::fs::remove_dir_all(sandbox.path("o")).unwrap();
    }
    assert!(resumed > 8, "only {resumed} runs were killed in time");
}

/// Killed at many moments, again and again: before the first checkpoint, between two, while files are written.
#[test]
fn killed_runs_are_resumed_to_the_same_bits() {
    let sandbox = sandbox();
    for (number, way) in
        ["--method w2 --solver cg", "--method w2 --rtol 1e-3", "--method backward-euler"].into_iter().enumerate()
    {
        let started = Instant::now();
        sandbox.sprung(&arguments(way, "whole")).ends_with(0);
        let length = started.elapsed();
        let whole = files(&sandbox.path("whole"));
        for attempt in 0..8u32 {
            let mut more = Vec::new();
            for kill in 0..4 {
                let arguments = [&arguments(way, "killed")[..], &more].concat();
                let mut child = sandbox.command(&arguments).stderr(Stdio::null()).spawn().unwrap();
                let share = f64::from((attempt * 7 + kill * 5 + number as u32 * 3) % 23) / 23.0;
                std::thread::sleep(length.mul_f64(share));
                let _ = child.kill();
                child.wait().unwrap();
                more = vec!["--resume"];
            }
            sandbox.sprung(&[&arguments(way, "killed")[..], &more].concat()).ends_with(0);
            same(way, &whole, &files(&sandbox.path("killed")));
            std::fs::remove_dir_all(sandbox.path("killed")).unwrap();
        }
        std::fs::remove_dir_all(sandbox.path("whole")).unwrap();
    }
}

/// A run that was asked to stop writes what it has, and can be gone on with all the same.
#[test]
fn interrupted_runs_are_resumed() {
    let sandbox = sandbox();
    let fixed = "run cloth.toml --dt 1e-5 --steps 6000 --frames 1000 --quiet --out";
    let whole = fixed.split(' ').chain(["whole", "--checkpoint", "500"]).collect::<Vec<_>>();
    sandbox.sprung(&whole).ends_with(0);
    let part = fixed.split(' ').chain(["o", "--checkpoint", "500"]).collect::<Vec<_>>();
    killed_after_a_checkpoint(&sandbox, &part, "-INT");
    assert_eq!(sandbox.json("o/summary.json")["status"], "interrupted");
    // The number of steps between checkpoints need not be given again.
    let resume = fixed.split(' ').chain(["o", "--resume"]).collect::<Vec<_>>();
    sandbox.sprung(&resume).ends_with(0);
    same("interrupted", &files(&sandbox.path("whole")), &files(&sandbox.path("o")));
    // A shorter run has nothing to go on from: it begins again, and says so.
    let again = "run cloth.toml --dt 1e-5 --steps 20 --out o --frames 1000 --resume".split(' ').collect::<Vec<_>>();
    let answer = sandbox.sprung(&again).ends_with(0);
    answer.complains(&[
        "o: a run of cloth by linear-backward-euler ended here, completed at t = 0.06 s; its checkpoint is not before the end of this run",
        "starts again",
    ]);
    assert_eq!(sandbox.json("o/summary.json")["steps"], 20);
}

/// What does not fit is refused, and nothing is touched.
#[test]
fn checkpoints_of_other_runs_and_damaged_ones_are_refused() {
    let sandbox = sandbox();
    let fixed = "run cloth.toml --dt 1e-5 --steps 100000000 --checkpoint 500 --frames 1000 --out o";
    let resume = |more: &str| {
        let more = more.split(' ').filter(|more| !more.is_empty());
        sandbox.sprung(&fixed.split(' ').chain(["--resume"]).chain(more).collect::<Vec<_>>())
    };
    let nothing = "run cloth.toml --dt 1e-5 --steps 10 --resume --out none".split(' ').collect::<Vec<_>>();
    sandbox.sprung(&nothing).ends_with(2).complains(&["none: no checkpoint to resume from"]);
    killed_after_a_checkpoint(&sandbox, &fixed.split(' ').collect::<Vec<_>>(), "-INT");
    let good = sandbox.read("o/checkpoint");
    for (more, difference) in [
        ("--method w2", "--method was linear-backward-euler, and is w2"),
        ("--solver cg", "--solver was auto, and is cg; --tolerance was adaptive, and is 1e-10"),
        ("--stiffness axial", "--stiffness was on-demand, and is axial"),
        ("--tolerance 1e-8", "--tolerance was adaptive, and is 1e-8"),
        ("--allow-unstable", "--allow-unstable was not given, and is given"),
    ] {
        let expected = format!("o: its checkpoint is of another run ({difference}): give the scene and the arguments");
        resume(more).ends_with(2).complains(&[&expected]);
    }
    let scene = sandbox.read("cloth.toml");
    sandbox.put("cloth.toml", &scene.replacen("velocity = [0, 0, 0.5]", "velocity = [0, 0, 0.6]", 1));
    resume("").ends_with(2).complains(&["another run (the scene or its state at the start has changed): give"]);
    sandbox.put("cloth.toml", &scene);
    let middle = good.len() / 2;
    let digit = good[middle..].find(|c: char| c.is_ascii_digit()).unwrap() + middle;
    let other = if &good[digit..=digit] == "1" { "2" } else { "1" };
    for bad in [
        String::new(),
        good[..middle].to_owned(),
        good[..good.len() - 2].to_owned(),
        format!("{}{other}{}", &good[..digit], &good[digit + 1..]),
        good.replacen("checkpoint 3", "checkpoint 2", 1),
        format!("{good}\n"),
    ] {
        sandbox.put("o/checkpoint", &bad);
        resume("").ends_with(2).complains(&["o/checkpoint: "]);
    }
    sandbox.put("o/checkpoint", &good);
    std::fs::rename(sandbox.path("o/energy.csv"), sandbox.path("o/away.csv")).unwrap();
    resume("").ends_with(2).complains(&["o/energy.csv: what the checkpoint goes on from is not there any more"]);
    std::fs::rename(sandbox.path("o/away.csv"), sandbox.path("o/energy.csv")).unwrap();
    for name in ["o/.sprung-trajectory.part", "o/trajectory.npz"] {
        std::fs::remove_file(sandbox.path(name)).unwrap();
    }
    resume("").ends_with(2).complains(&["o/.sprung-trajectory.part: "]);
    // A run without checkpoints takes the folder over.
    sandbox.sprung(&["run", "cloth.toml", "--dt", "0.0002", "--steps", "10", "--out", "o"]).ends_with(0);
    assert!(!sandbox.path("o/checkpoint").exists());
    assert!(sandbox.names("o").iter().all(|name| !name.ends_with(".part")));
}

/// Arguments of a run of steps of 1e-4 s with a checkpoint every ten, of so long a run, in a folder.
fn lengthened<'a>(length: &'a str, more: &'a str, out: &'a str) -> Vec<&'a str> {
    let fixed = "run cloth.toml --dt 0.0001 --checkpoint 10 --out".split(' ');
    fixed.chain([out]).chain(length.split(' ')).chain(more.split(' ')).collect()
}

/// A finished run that is made longer ends with the bytes of one that was as long from the start, wherever the shorter one ended: on a checkpoint, between two, with a
/// step that was cut short, at a time that is not quite that of a step.
#[test]
fn finished_runs_are_made_longer() {
    let sandbox = sandbox();
    let longer = "--steps 47";
    for more in
        ["--frames 4", "--method bdf2 --solver cg --frames 3", "--method w2 --stiffness axial --no-error-estimate"]
    {
        sandbox.sprung(&lengthened(longer, more, "whole")).ends_with(0);
        let whole = files(&sandbox.path("whole"));
        // A duration of thirty steps but for its last bit ends at another time than they do: there the checkpoint is the one before.
        for (shorter, step) in [
            ("--steps 20", 20),
            ("--steps 25", 20),
            ("--duration 0.00234", 20),
            ("--duration 0.0030000000000000005", 20),
            ("--steps 46", 40),
        ] {
            sandbox.sprung(&lengthened(shorter, more, "o")).ends_with(0);
            assert!(sandbox.path("o/checkpoint.finished").exists() && !sandbox.path("o/checkpoint").exists());
            let resume = [&lengthened(longer, more, "o")[..], &["--resume"]].concat();
            let answer = sandbox.sprung(&resume).ends_with(0);
            answer
                .complains(&["completed at t =", &format!("this run goes on from its checkpoint at step {step}, t =")]);
            same(&format!("{more}, {shorter}"), &whole, &files(&sandbox.path("o")));
            std::fs::remove_dir_all(sandbox.path("o")).unwrap();
        }
        std::fs::remove_dir_all(sandbox.path("whole")).unwrap();
    }
    // Made longer twice, then shorter again, but not so short as its checkpoint: later frames go.
    for length in ["--steps 15", "--steps 33", "--steps 47", "--steps 44"] {
        sandbox.sprung(&[&lengthened(length, "--frames 1", "o")[..], &["--resume"]].concat()).ends_with(0);
    }
    sandbox.sprung(&lengthened("--steps 44", "--frames 1", "whole")).ends_with(0);
    same("again and again", &files(&sandbox.path("whole")), &files(&sandbox.path("o")));
}

/// What depends on the length of a run keeps a longer one from going on: it begins again, says why, and ends with the right bytes all the same.
#[test]
fn what_depends_on_the_length_begins_again() {
    let sandbox = sandbox();
    for (more, lengths, why) in [
        (
            "--rtol 1e-3 --method w2",
            ["--duration 0.0035", "--duration 0.0055"],
            "its adaptive steps depend on the length of the run",
        ),
        ("--view", ["--steps 310", "--steps 610"], "its frames are as far apart as the length of the run makes them"),
    ] {
        let run = |length: &str, out: &str, resume: &[&str]| {
            sandbox.sprung(&[&lengthened(length, more, out)[..], resume].concat()).ends_with(0)
        };
        run(lengths[0], "o", &[]);
        run(lengths[1], "o", &["--resume"]).complains(&[why, "this run starts again"]);
        run(lengths[1], "whole", &[]);
        same(more, &files(&sandbox.path("whole")), &files(&sandbox.path("o")));
        for out in ["o", "whole"] {
            std::fs::remove_dir_all(sandbox.path(out)).unwrap();
        }
    }
    // Another method is another run.
    sandbox.sprung(&lengthened("--steps 20", "--frames 4", "o")).ends_with(0);
    let other = [&lengthened("--steps 30", "--frames 4", "o")[..], &["--method", "bdf2", "--resume"]].concat();
    sandbox.sprung(&other).ends_with(0).complains(&[
        "its checkpoint is of another run (--method was linear-backward-euler, and is bdf2): this run starts again",
    ]);
    assert_eq!(sandbox.json("o/summary.json")["method"], "bdf2");
    // One that kept no checkpoint leaves nothing.
    sandbox.sprung(&["run", "cloth.toml", "--dt", "0.0001", "--steps", "5", "--out", "o"]).ends_with(0);
    assert!(!sandbox.path("o/checkpoint.finished").exists());
    let resume = [&lengthened("--steps 20", "--frames 4", "o")[..], &["--resume"]].concat();
    sandbox.sprung(&resume).ends_with(0).complains(&["left nothing to go on from, as it wrote no checkpoint"]);
}
