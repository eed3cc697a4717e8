//! What goes to stdout and stderr. Results go to stdout, everything else to stderr.

use super::Stop;
use serde::Serialize;
use sprung::Error;
use std::fmt::Display;
use std::io::{self, Write};

/// How much a command says, and in what form.
#[derive(Debug, clap::Args)]
pub struct Console {
    /// Say nothing but errors
    #[arg(long, global = true, display_order = 100)]
    pub quiet: bool,

    /// Print the result as one JSON object on stdout, and nothing else there
    #[arg(long, global = true, display_order = 101)]
    pub json: bool,
}

impl Console {
    /// Prints a command's result on stdout: as JSON, as text for people, or, when quiet, not at all.
    pub fn result(&self, result: &impl Serialize, text: impl Display) -> Result<(), Stop> {
        if self.json {
            let json = serde_json::to_string_pretty(result).map_err(|error| broken_stdout(error.into()))?;
            print(&json)
        } else if !self.quiet {
            print(&text.to_string())
        } else {
            Ok(())
        }
    }

    /// Says something that the user should know; not when quiet.
    pub fn note(&self, line: impl Display) {
        if !self.quiet {
            complain(format_args!("note: {line}"));
        }
    }
}

/// Says what makes a result doubtful, quiet or not.
pub fn warning(line: impl Display) {
    complain(format_args!("warning: {line}"));
}

/// Prints text and a line break on stdout. A reader that has left (`sprung new cloth | head`) is not an error.
pub fn print(text: &str) -> Result<(), Stop> {
    let mut stdout = io::stdout().lock();
    let outcome =
        stdout.write_all(text.as_bytes()).and_then(|()| stdout.write_all(b"\n")).and_then(|()| stdout.flush());
    match outcome {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(broken_stdout(error)),
        _ => Ok(()),
    }
}

/// Says what went wrong.
pub fn error(message: impl Display) {
    complain(format_args!("error: {message}"));
}

/// Prints a line on stderr, whether or not anyone reads it.
fn complain(line: impl Display) {
    let _ = writeln!(io::stderr(), "{line}");
}

fn broken_stdout(source: io::Error) -> Stop {
    Stop::Broken(Error::io("standard output", source))
}
