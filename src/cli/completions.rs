//! `sprung completions`: what a shell needs to complete commands and options.

use super::console::print;
use super::{Arguments, Exit, Stop};
use clap::CommandFactory;
use clap_complete::{Shell, generate};

/// Print a script that completes commands and options in a shell
///
/// For example `sprung completions bash > ~/.local/share/bash-completion/completions/sprung`, or
/// `sprung completions zsh > "${fpath[1]}/_sprung"`.
#[derive(Debug, clap::Args)]
pub struct Completions {
    /// The shell
    #[arg(value_name = "SHELL")]
    shell: Shell,
}

impl Completions {
    pub fn execute(&self) -> Result<Exit, Stop> {
        let mut script = Vec::new();
        generate(self.shell, &mut Arguments::command(), "sprung", &mut script);
        print(String::from_utf8_lossy(&script).trim_end())?;
        Ok(Exit::Done)
    }
}
