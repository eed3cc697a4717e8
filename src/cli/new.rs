//! `sprung new`: print a ready scene.

use super::console::{Console, print};
use super::values::size;
use super::{Exit, Stop};
use sprung::output::AtomicFile;
use sprung::scene::{Kind, builtin, refined};
use sprung::{Error, Scene};
use std::ffi::OsStr;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Print a ready scene as TOML (with --json: as JSON), or write it to a file
///
/// Save it to a file, change what you like, and run it: `sprung new cloth --size 30 > cloth.toml`. A larger size makes a larger scene of
/// the same springs; --refine keeps the extent and makes the mesh finer. A large scene is written and read
/// fastest as NumPy arrays: `sprung new cloth --size 1000 -o cloth.npz`.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct New {
    /// What to make
    #[arg(value_name = "KIND")]
    kind: Kind,

    /// How large: the number of particles or links along the scene, as far apart as ever (but for a string, which is 1 m long), so
    /// that a cloth of twice the size has twice the width [default: one that shows what the kind is about]
    #[arg(long, value_name = "N", value_parser = size)]
    size: Option<usize>,

    /// With --size: a mesh of so many particles of the scene of the default size, of the same extent, mass and elasticity
    #[arg(long, requires = "size")]
    refine: bool,

    /// Write the scene to this file instead, in the format of its ending: .toml, .json or .npz
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

impl New {
    pub fn execute(&self, console: &Console) -> Result<Exit, Stop> {
        let size = self.size.unwrap_or(self.kind.default_size());
        let scene = if self.refine { refined(self.kind, size)? } else { builtin(self.kind, size)? };
        match &self.output {
            Some(file) => write(&scene, file)?,
            None if console.json => print(&scene.to_json())?,
            None => print(scene.to_toml().trim_end())?,
        }
        Ok(Exit::Done)
    }
}

/// Writes a scene, whole or not at all.
fn write(scene: &Scene, file: &Path) -> Result<(), Error> {
    let ending = file.extension().and_then(OsStr::to_str).map(str::to_ascii_lowercase);
    match ending.as_deref() {
        Some("toml") => AtomicFile::write(file, |out| out.write_all(scene.to_toml().as_bytes())),
        Some("json") => AtomicFile::write(file, |out| out.write_all(scene.to_json().as_bytes())),
        Some("npz") => AtomicFile::write(file, |out| scene.write_npz(out)),
        _ => Err(Error::Usage(format!("{}: a scene file must end in .toml, .json or .npz", file.display()))),
    }
}
