//! Runs with checkpoints that are killed at random moments and resumed, until they end: every file must have the bytes of the run
//! that nobody disturbed, but for the times that were measured.

use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The options of runs; every one with frames.
const WAYS: [&str; 21] = [
    "--method linear-backward-euler",
    "--method linear-backward-euler --solver cg --preconditioner multigrid",
    "--method linear-backward-euler --solver cg-assembled",
    "--method backward-euler --solver ldlt",
    "--method backward-euler --solver cg",
    "--method w2 --stiffness axial",
    "--method w2 --solver cg",
    "--method implicit-midpoint",
    "--method symplectic-euler --allow-unstable",
    "--method forward-euler --allow-unstable",
    "--method auto",
    "--method w2 --rtol 1e-3",
    "--method w2 --rtol 1e-2 --solver cg",
    "--stiffness tension --solver llt --threads 3",
    "--method bdf2",
    "--method bdf2 --rtol 1e-3 --solver cg",
    "--method rodas4 --solver llt",
    "--method rodas4 --rtol 1e-4",
    "--method verlet --allow-unstable",
    "--method dop853",
    "--method dop853 --rtol 1e-6",
];

/// The program, in the folder of this one.
fn program() -> Option<PathBuf> {
    Some(std::env::current_exe().ok()?.with_file_name("sprung"))
}

/// Kills until there have been so many; returns whether all files agree.
pub fn search(count: u64, seed: u64) -> bool {
    let Some(program) = program().filter(|program| program.exists()) else {
        eprintln!("the program is not built: cargo build with the same profile");
        return false;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let scene = Command::new(&program).args(["new", "cloth", "--size", "6"]).output().expect("a scene");
    std::fs::write(folder.join("cloth.toml"), scene.stdout).expect("a scene");
    let mut random = Random(seed);
    let (mut kills, mut runs, mut early, mut wrong) = (0, 0, 0, 0);
    let mut lengths = Vec::new();
    for (number, way) in WAYS.iter().cycle().enumerate() {
        if kills >= count {
            break;
        }
        let undisturbed = format!("whole{}", number % WAYS.len());
        if number < WAYS.len() {
            let started = Instant::now();
            let status = run(&program, folder, way, &undisturbed, false).wait().expect("a run");
            lengths.push(started.elapsed().max(Duration::from_millis(30)));
            assert!(status.code() == Some(0) || way.contains("--allow-unstable"), "{way} alone ended with {status}");
        }
        let length = lengths[number % WAYS.len()];
        let out = format!("killed{number}");
        let mut resume = false;
        for attempt in 0.. {
            let mut child = run(&program, folder, way, &out, resume);
            if attempt < 6 && kills < count {
                std::thread::sleep(length.mul_f64(random.next()));
                if child.try_wait().expect("a run").is_none() {
                    child.kill().expect("a kill");
                    kills += 1;
                    early += u64::from(!folder.join(&out).join("checkpoint").exists());
                }
            }
            let status = child.wait().expect("a run");
            resume = true;
            if status.code().is_some() {
                break;
            }
        }
        runs += 1;
        let (expected, found) = (files(&folder.join(&undisturbed)), files(&folder.join(&out)));
        if expected != found {
            wrong += 1;
            let names = |files: &BTreeMap<String, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
            let differ = expected.iter().filter(|(name, bytes)| found.get(*name) != Some(*bytes)).map(|(name, _)| name);
            println!("{way}: differ in {:?}; {:?} {:?}", differ.collect::<Vec<_>>(), names(&expected), names(&found));
        }
        let _ = std::fs::remove_dir_all(folder.join(&out));
    }
    println!("{kills} kills in {runs} runs, {early} before the first checkpoint: {wrong} runs with other bytes");
    wrong == 0
}

fn run(program: &Path, folder: &Path, way: &str, out: &str, resume: bool) -> std::process::Child {
    let fixed = "run cloth.toml --dt 0.0002 --steps 200 --frames 23 --checkpoint 15 --quiet --out";
    let mut command = Command::new(program);
    command.args(fixed.split(' ')).arg(out).args(way.split(' ')).current_dir(folder);
    if resume {
        command.arg("--resume");
    }
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("a run")
}

/// Every file by its name; of the summary and the checkpoint all but the times.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    for inside in ["", "frames"] {
        for entry in std::fs::read_dir(folder.join(inside)).into_iter().flatten().flatten() {
            let path = entry.path();
            let name = format!("{inside}/{}", entry.file_name().to_string_lossy());
            if path.is_file() && !name.ends_with("checkpoint") {
                let bytes = std::fs::read(&path).expect("a file");
                all.insert(name.clone(), if name.ends_with("summary.json") { untimed(&bytes) } else { bytes });
            }
        }
    }
    all
}

/// A summary without what was measured by a clock.
fn untimed(bytes: &[u8]) -> Vec<u8> {
    let Ok(Value::Object(mut summary)) = serde_json::from_slice(bytes) else { return Vec::new() };
    summary.remove("wall_seconds");
    summary.remove("factor");
    Value::Object(summary).to_string().into_bytes()
}

/// Numbers between 0 and 1, the same for the same seed.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}
