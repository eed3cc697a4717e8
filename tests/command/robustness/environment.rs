//! What the system may do to a run: little memory, a full disk, folders that cannot be written or go away, closed pipes, few
//! threads, other runs, odd terminals. Always an exit status of 0, 1 or 2, an `error:` line where it is not 0, and no half file.
#![cfg(target_os = "linux")]

use crate::sandbox::{Answer, Sandbox};
use std::process::Stdio;
use std::time::{Duration, Instant};

/// Runs the program from a shell, after a command that limits what it may do.
fn limited(sandbox: &Sandbox, limit: &str, arguments: &str) -> Answer {
    let script = format!("{limit}; exec {} {arguments}", env!("CARGO_BIN_EXE_sprung"));
    let output = sandbox.shell(&script).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Answer { status: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

/// KiB that workspaces of products take at most, for the thread of the program and the one that it may use: twice the caches of the last level each, of which
/// every processor has one at most.
fn workspaces() -> u64 {
    let size = std::fs::read_to_string("/sys/devices/system/cpu/cpu0/cache/index3/size").unwrap_or_default();
    let cache: u64 = size.trim().trim_end_matches('K').parse().unwrap_or(0);
    let processors = std::thread::available_parallelism().map_or(1, |count| count.get() as u64);
    2 * 2 * cache * processors
}

/// A block whose factor takes 60 MB, and more with the workspace of products, which a large cache makes large: the solver that is asked for says so, the
/// program's own choice does without.
#[test]
fn a_factor_that_does_not_fit_is_an_error_or_not_needed() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("lattice", "16");
    let run = |limit: u64, more: &str| {
        let arguments = format!("run lattice.toml --threads 1 --dt 0.01 --steps 1 --json {more}");
        limited(&sandbox, &format!("ulimit -v {limit}"), &arguments)
    };
    for solver in ["llt", "ldlt"] {
        let answer = run(145_000, &format!("--solver {solver}")).ends_with(2);
        answer.complains(&["error: the factor of the matrix takes "]);
        let units = ["MB", "GB"].map(|unit| format!(" {unit}, and there is room for "));
        assert!(units.iter().any(|unit| answer.stderr.contains(unit)), "{}", answer.stderr);
    }
    let summary = run(145_000, "").ends_with(0).json();
    assert_eq!((&summary["solver"], &summary["status"]), (&"cg".into(), &"completed".into()));
    assert_eq!(run((2_000_000 + workspaces()).min(8_000_000), "--solver llt").ends_with(0).json()["solver"], "llt");
}

/// From hardly enough to start up to plenty: done, or an error of its own kind. An allocation that fails would abort.
#[test]
fn little_memory_is_an_error_not_an_abort() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("lattice", "14");
    sandbox.put_ready("cloth", "60");
    let json = sandbox.sprung(&["new", "cloth", "--size", "60", "--json"]).ends_with(0).stdout;
    sandbox.put("cloth.json", &json);
    let mut refused = 0;
    for arguments in [
        "run lattice.toml --dt 0.01",
        "run cloth.toml --dt 0.01 --solver cg --preconditioner multigrid --frames 1",
        "run cloth.json --dt 0.01 --solver cg-assembled",
        "run cloth.json --dt 0.01 --method backward-euler --solver ldlt",
        "matrix cloth.json --dt 0.01",
        "inspect cloth.json --dt 0.01",
        "run cloth.json --dt 0.01 --threads 3",
    ] {
        let steps = if arguments.starts_with("run") { "--steps 1" } else { "" };
        let threads = if arguments.contains("--threads") { "" } else { "--threads 1" };
        for limit in (30_000..330_000).step_by(12_500) {
            let answer =
                limited(&sandbox, &format!("ulimit -v {limit}"), &format!("{arguments} {steps} {threads} --out o"));
            match answer.status {
                Some(0) => {}
                Some(1 | 2) => {
                    refused += 1;
                    answer.complains(&["error: "]);
                }
                status => panic!("{arguments} with {limit} kB: {status:?} {}", answer.stderr),
            }
        }
    }
    assert!(refused > 20, "{refused} refused");
}

/// A disk that is full, as a limit on the size of files: no result that is half there, and nothing left behind.
#[test]
fn a_full_disk_ends_a_run_without_half_files() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "20");
    sandbox.put("o/summary.json", "old");
    for (limit, arguments) in [(8, "--frames 1"), (1, ""), (0, "")] {
        let limit = format!("trap '' XFSZ; ulimit -f {limit}");
        let arguments = format!("run cloth.toml --dt 0.001 --steps 200 --out o {arguments}");
        let answer = limited(&sandbox, &limit, &arguments);
        assert!(matches!(answer.status, Some(1 | 2)), "{:?}", answer.status);
        answer.complains(&["error: o/", "File too large"]);
        assert_eq!(sandbox.read("o/summary.json"), "old");
        assert!(!sandbox.path("o/final.json").exists());
        assert!(sandbox.names("o").iter().all(|name| !name.ends_with(".part")));
    }
    let full = format!("{} new cloth > /dev/full", env!("CARGO_BIN_EXE_sprung"));
    let output = sandbox.shell(&full).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("error: standard output: No space left on device"));
}

#[test]
fn folders_that_cannot_be_written_are_refused_before_anything_is_computed() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "5");
    sandbox.put("file", "");
    for folder in ["/proc/none", "/dev/null/o", "file", "file/o", "/sys/o"] {
        for command in
            ["run cloth.toml --dt 0.01 --steps 1", "matrix cloth.toml --dt 0.01", "inspect cloth.toml --dt 0.01"]
        {
            let arguments: Vec<&str> = command.split(' ').chain(["--out", folder]).collect();
            sandbox.sprung(&arguments).ends_with(2).complains(&["error: ", folder.split("/o").next().unwrap()]);
        }
    }
}

/// What has the name of a result and is none of its kind is found at once, whether the file is to be written, removed, or needed only after
/// a failure.
#[test]
fn what_is_in_the_way_is_found_before_anything_is_computed() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "5");
    let run = "run cloth.toml --dt 0.01 --steps 1 --frames 1";
    let search = "run cloth.toml --duration 0.01 --accuracy 0.1 --frames 1";
    let chart = "chart cloth.toml --dt 0.01 --budget 1";
    let compare = "chart cloth.toml --dt 0.01 --budget 1 --definiteness";
    let cases = [
        ("trajectory.npz/", &[run, search][..]),
        ("view.html/", &[run, search]),
        ("frames.pvd/", &[run, search]),
        ("frames", &[run, search]),
        ("failure", &[run, search]),
        ("chart", &[chart, compare]),
    ];
    for (k, (name, commands)) in cases.into_iter().enumerate() {
        let folder = format!("o{k}");
        let (inside, what) = if name.ends_with('/') { ("inside", "is a directory") } else { ("", "not a directory") };
        let kept = name.trim_end_matches('/');
        sandbox.put(&format!("{folder}/{name}{inside}"), "");
        for command in commands {
            let arguments: Vec<&str> = command.split(' ').chain(["--out", &folder]).collect();
            let answer = sandbox.sprung(&arguments).ends_with(2);
            assert_eq!(answer.stderr, format!("error: {folder}/{kept}: {what}\n"));
            assert_eq!(sandbox.names(&folder), [kept], "{command}");
        }
    }
}

/// A scene whose name is too long for a folder leaves none.
#[test]
fn a_folder_that_cannot_be_made_leaves_none() {
    let sandbox = Sandbox::new();
    let name = "x".repeat(300);
    sandbox.put("long.toml", &format!("name = '{name}'\nparticles = {{ positions = [[0]], masses = 1 }}"));
    sandbox.sprung(&["run", "long.toml", "--dt", "1", "--steps", "1"]).ends_with(2).complains(&[&name]);
    assert_eq!(sandbox.names("."), ["long.toml"]);
}

/// The child of a run that goes on until it is asked to stop.
fn endless(sandbox: &Sandbox) -> std::process::Child {
    let arguments = ["run", "cloth.toml", "--dt", "1e-6", "--steps", "1000000000", "--frames", "100", "--out", "o"];
    let mut command = sandbox.command(&arguments);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let patience = Instant::now() + Duration::from_secs(60);
    while !sandbox.path("o/frames/frame_000100.vtp").exists() {
        assert!(Instant::now() < patience, "the run does not start");
        std::thread::sleep(Duration::from_millis(5));
    }
    child
}

fn interrupt(child: std::process::Child) -> Answer {
    let id = child.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Answer { status: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

#[test]
fn a_folder_that_goes_away_is_an_error() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "4");
    let child = endless(&sandbox);
    std::fs::rename(sandbox.path("o"), sandbox.path("elsewhere")).unwrap();
    interrupt(child).ends_with(1).complains(&["error: o/", "No such file or directory"]);
}

/// The second run is refused and the first one does not notice; when it has ended, or was killed, the folder is free.
#[test]
fn two_runs_do_not_share_a_folder() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "4");
    let second = ["run", "cloth.toml", "--dt", "0.01", "--steps", "3", "--out", "o"];
    let mut first = endless(&sandbox);
    sandbox.sprung(&second).ends_with(2).complains(&["error: o: another run is using this folder"]);
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(sandbox.names("o").iter().any(|name| name.ends_with(".part")), "a killed run leaves its unfinished files");
    sandbox.sprung(&second).ends_with(0);
    assert_eq!(sandbox.names("o"), ["energy.csv", "final.json", "summary.json"], "and the next one removes them");
    let first = endless(&sandbox);
    sandbox.sprung(&second).ends_with(2);
    interrupt(first).ends_with(1).complains(&["error: interrupted in step "]);
    assert_eq!(sandbox.json("o/summary.json")["status"], "interrupted");
    sandbox.sprung(&second).ends_with(0);
}

/// Frames, their list and what a failed run left are a run's own: they go when another takes its place, and stay when it fails early.
#[test]
fn results_of_two_runs_never_stand_side_by_side() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("column", "9");
    sandbox.put("o/notes.txt", "mine");
    sandbox.put("o/frames/mine.txt", "mine");
    let run = |more: &str| {
        let fixed = "run column.toml --out o --dt 0.1 --steps 8";
        sandbox.sprung(&fixed.split(' ').chain(more.split(' ').filter(|more| !more.is_empty())).collect::<Vec<_>>())
    };
    run("--frames 2 --stiffness tension").ends_with(0);
    assert_eq!(sandbox.names("o/frames").len(), 6);
    // A run that cannot start leaves everything.
    run("--frames 1 --solver llt --threads 0").ends_with(2);
    assert_eq!(sandbox.names("o/frames").len(), 6);
    run("--frames 4 --stiffness tension").ends_with(0);
    assert_eq!(sandbox.names("o/frames"), ["frame_000000.vtp", "frame_000004.vtp", "frame_000008.vtp", "mine.txt"]);
    let failed = run("--stiffness full --solver llt").ends_with(1);
    failed.complains(&["indefinite"]);
    assert_eq!(sandbox.names("o/frames"), ["mine.txt"]);
    assert!(sandbox.names("o").contains(&"failure".to_owned()) && !sandbox.path("o/frames.pvd").exists());
    run("--stiffness tension").ends_with(0);
    assert_eq!(sandbox.names("o"), ["energy.csv", "final.json", "frames", "notes.txt", "summary.json"]);
}

#[test]
fn closed_pipes_are_no_errors_and_missing_streams_no_panics() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "5");
    let program = env!("CARGO_BIN_EXE_sprung");
    for (script, status) in [
        (format!("{program} new cloth --size 100 | head -c 10"), 0),
        (format!("{program} run cloth.toml --dt 0.01 --steps 2 >&- 2>&-"), 0),
        (format!("{program} run cloth.toml --dt 0.01 --steps 2 --json <&- 2>&- | head -c 1"), 0),
        (format!("{program} run none.toml 2>&-"), 2),
        (format!("{program} run none.toml >&-"), 2),
    ] {
        let output = sandbox.shell(&script).output().unwrap();
        assert_eq!(output.status.code(), Some(status), "{script}: {}", String::from_utf8_lossy(&output.stderr));
        assert!(!String::from_utf8_lossy(&output.stderr).contains("panicked"), "{script}");
    }
}

/// A thousand threads need two gigabytes of address space.
#[test]
fn threads_that_cannot_be_had_are_an_error() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "5");
    let arguments = "run cloth.toml --dt 0.01 --steps 1 --threads 1024 --out o";
    limited(&sandbox, "ulimit -v 500000", arguments)
        .ends_with(2)
        .complains(&["error: --threads: ", "there is room for "]);
    assert!(!sandbox.path("o").exists());
}

#[test]
fn terminals_may_be_narrow_dumb_or_absent() {
    let sandbox = Sandbox::new();
    sandbox.put_ready("cloth", "5");
    for (terminal, columns) in [("dumb", "1"), ("", "0"), ("xterm", "3"), ("none", "-1"), ("vt100", "99999999999")] {
        for arguments in
            [&["--help"][..], &["run", "--help"], &["run", "cloth.toml", "--dt", "0.01", "--steps", "2"], &["rum"]]
        {
            let mut command = sandbox.command(arguments);
            let output = command.env("TERM", terminal).env("COLUMNS", columns).env_remove("HOME").output().unwrap();
            let expected = if arguments == ["rum"] { 2 } else { 0 };
            assert_eq!(output.status.code(), Some(expected), "{terminal} {columns} {arguments:?}");
            assert!(!String::from_utf8_lossy(&output.stderr).contains("panicked"));
        }
    }
}

/// A megabyte of wrong text is quoted by its ends; scenes with nothing in them are zero, not minus zero.
#[test]
fn messages_are_short_and_nothing_is_nothing() {
    let sandbox = Sandbox::new();
    let long = "x".repeat(1 << 20);
    for text in [
        format!("name = 3\n[{long}]"),
        format!("{long} = 1"),
        format!("masses = \"{long}\""),
        format!("name = \"{long}/\""),
        long.clone(),
    ] {
        sandbox.put("long.toml", &text);
        let answer = sandbox.sprung(&["run", "long.toml"]).ends_with(2);
        assert!(answer.stderr.len() < 3000 && answer.stderr.contains("long.toml"), "{} bytes", answer.stderr.len());
    }
    sandbox.put("empty.toml", "[time]\ndt = 0.1\nduration = 1\n");
    let answer = sandbox.sprung(&["run", "empty.toml", "--verbose"]).ends_with(0);
    assert!(answer.stdout.contains(" 0 J at the start") && !answer.stdout.contains("-0"), "{}", answer.stdout);
    let energies = sandbox.csv("out/empty/energy.csv");
    assert!(energies.iter().flatten().all(|value| !(*value == 0.0 && value.is_sign_negative())));
}
