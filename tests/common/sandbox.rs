//! Runs the real program in a folder of its own.
#![allow(dead_code, reason = "every program of tests uses its own part")]

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::{fs, str};

/// A temporary working directory for the program.
pub struct Sandbox(tempfile::TempDir);

/// What the program said and how it ended.
pub struct Answer {
    pub status: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Sandbox {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// A folder with one file.
    pub fn with(name: &str, text: &str) -> Self {
        let sandbox = Self::new();
        sandbox.put(name, text);
        sandbox
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Puts a file into the folder.
    pub fn put(&self, name: &str, text: &str) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    /// Puts a ready scene into the folder: `cloth.toml` for a cloth.
    pub fn put_ready(&self, kind: &str, size: &str) {
        self.put(&format!("{kind}.toml"), &self.sprung(&["new", kind, "--size", size]).ends_with(0).stdout);
    }

    pub fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).unwrap()
    }

    /// The second line of a file as JSON.
    pub fn json_line(&self, name: &str) -> Value {
        serde_json::from_str(self.read(name).lines().nth(1).unwrap()).unwrap()
    }

    /// Rows of numbers; an empty field is not a number.
    pub fn csv(&self, name: &str) -> Vec<Vec<f64>> {
        let text = self.read(name);
        let rows = csv::Reader::from_reader(text.as_bytes()).into_deserialize::<Vec<Option<f64>>>();
        rows.map(|row| row.unwrap().into_iter().map(|value| value.unwrap_or(f64::NAN)).collect()).collect()
    }

    /// Names of everything in a folder, hidden files included.
    pub fn names(&self, folder: &str) -> Vec<String> {
        let entries = fs::read_dir(self.path(folder)).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_sprung"));
        command.args(arguments).current_dir(self.0.path()).stdin(Stdio::null());
        command
    }

    /// A shell in the folder.
    pub fn shell(&self, script: &str) -> Command {
        let mut command = Command::new("sh");
        command.args(["-c", script]).current_dir(self.0.path()).stdin(Stdio::null());
        command
    }

    /// Runs the program to its end.
    pub fn sprung(&self, arguments: &[&str]) -> Answer {
        let output = self.command(arguments).output().unwrap();
        let text = |bytes: &[u8]| str::from_utf8(bytes).unwrap().to_owned();
        Answer { status: output.status.code(), stdout: text(&output.stdout), stderr: text(&output.stderr) }
    }
}

impl Answer {
    /// Checks the exit status, and that no failure is a panic.
    #[track_caller]
    pub fn ends_with(self, status: i32) -> Self {
        assert_eq!(self.status, Some(status), "stdout: {}\nstderr: {}", self.stdout, self.stderr);
        assert!(!self.stderr.contains("panicked"), "{}", self.stderr);
        self
    }

    /// Checks that stderr has all these parts.
    #[track_caller]
    pub fn complains(&self, parts: &[&str]) {
        for part in parts {
            assert!(self.stderr.contains(part), "{part:?} is not in: {}", self.stderr);
        }
    }

    pub fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error}: {}", self.stdout))
    }
}

/// A scene that the program carries, as a file.
pub fn repository_scene(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/verify/scenes");
    folder.join(name).into_os_string().into_string().unwrap()
}
