//! `sprung man`: manual pages.

use super::console::print;
use super::{Arguments, Exit, Stop};
use clap::CommandFactory;
use sprung::Error;

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
    pub fn execute(&self) -> Result<Exit, Stop> {
        let mut program = Arguments::command();
        program.build();
        let command = match &self.command {
            None => program,
            Some(name) => {
                let unknown = || Error::Usage(format!("there is no command {name}: see sprung help"));
                program.find_subcommand(name).cloned().ok_or_else(unknown)?
            }
        };
        let mut page = Vec::new();
        let written = clap_mangen::Man::new(command).render(&mut page);
        written.map_err(|source| Stop::Broken(Error::io("the manual page", source)))?;
        print(String::from_utf8_lossy(&page).trim_end())?;
        Ok(Exit::Done)
    }
}
