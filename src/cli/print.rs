//! Commands that print: `sprung new`, `sprung completions` and `sprung man`.

use super::common::positive_count;
use super::console::{Console, print};
use super::{Arguments, Stop};
use clap::CommandFactory;
use clap_complete::{Shell, generate};
use sprung::output::AtomicFile;
use sprung::scene::{Kind, builtin, refined};
use sprung::{Error, Scene};
use std::ffi::OsStr;
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
    #[arg(long, value_name = "N", value_parser = positive_count::<usize>)]
    size: Option<usize>,

    /// With --size: a mesh of so many particles of the scene of the default size, of the same extent, mass and elasticity
    #[arg(long, requires = "size")]
    refine: bool,

    /// Write the scene to this file instead, in the format of its ending: .toml, .json or .npz
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

impl New {
    pub fn execute(&self, console: &Console) -> Result<(), Stop> {
        if console.json && self.output.is_some() {
            let message = "--json: it is for a scene that is printed; the ending of a file determines its format";
            return Err(Error::Usage(message.into()).into());
        }
        let size = self.size.unwrap_or(self.kind.default_size());
        let scene = if self.refine { refined(self.kind, size)? } else { builtin(self.kind, size)? };
        match &self.output {
            Some(file) => Ok(write(&scene, file)?),
            None if console.json => print(&scene.to_json()),
            None => print(scene.to_toml().trim_end()),
        }
    }
}

fn write(scene: &Scene, file: &Path) -> Result<(), Error> {
    let extension = file.extension().and_then(OsStr::to_str).map(str::to_ascii_lowercase);
    match extension.as_deref() {
        Some("toml") => AtomicFile::write_text(file, &scene.to_toml()),
        Some("json") => AtomicFile::write_text(file, &scene.to_json()),
        Some("npz") => AtomicFile::write(file, |out| scene.write_npz(out)),
        _ => Err(Error::Usage(format!("{}: a scene file must end in .toml, .json or .npz", file.display()))),
    }
}

/// Print a script that completes commands and options in a shell
///
/// For example `sprung completions bash > ~/.local/share/bash-completion/completions/sprung`, or `sprung completions zsh > "${fpath[1]}/_sprung"`.
#[derive(Debug, clap::Args)]
pub struct Completions {
    /// The shell
    #[arg(value_name = "SHELL")]
    shell: Shell,
}

impl Completions {
    pub fn execute(&self) -> Result<(), Stop> {
        let mut script = Vec::new();
        generate(self.shell, &mut Arguments::command(), "sprung", &mut script);
        print(String::from_utf8_lossy(&script).trim_end())
    }
}

/// Print the manual page of the program, or of one of its commands
///
/// For example `sprung man run | man -l -`, or `sprung man > ~/.local/share/man/man1/sprung.1`.
#[derive(Debug, clap::Args)]
pub struct Man {
    /// The command [default: the program]
    #[arg(value_name = "COMMAND")]
    command: Option<String>,
}

impl Man {
    pub fn execute(&self) -> Result<(), Stop> {
        let mut command = Arguments::command();
        command.build();
        if let Some(name) = &self.command {
            let unknown = || Error::Usage(format!("there is no command {name}: see sprung help"));
            command = command.find_subcommand(name).cloned().ok_or_else(unknown)?;
        }
        let mut page = Vec::new();
        let written = clap_mangen::Man::new(command).render(&mut page);
        written.map_err(|source| Stop::Broken(Error::io("the manual page", source)))?;
        print(String::from_utf8_lossy(&page).trim_end())
    }
}
