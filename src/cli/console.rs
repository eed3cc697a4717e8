//! What goes to stdout and stderr. Results go to stdout, everything else to stderr.

use super::Stop;
use anstyle::{AnsiColor, Effects};
use clap::{ColorChoice, ValueEnum};
use serde::Serialize;
use sprung::Error;
use std::fmt::Display;
use std::io::{self, Write};

/// How much a command says, and in what form.
#[derive(Debug, clap::Args)]
pub struct Console {
    /// Say nothing but errors
    #[arg(short, long, global = true, display_order = 100)]
    pub quiet: bool,

    /// Say everything that is known of a run: solvers, work, where the energy went
    #[arg(short, long, global = true, display_order = 100, conflicts_with_all = ["quiet", "json"])]
    pub verbose: bool,

    /// Print the result as one JSON object on stdout, and nothing else there
    #[arg(long, global = true, display_order = 101)]
    pub json: bool,

    /// When to colour what goes to the terminal; auto also follows NO_COLOR
    #[arg(long, global = true, value_name = "WHEN", default_value = "auto", display_order = 102)]
    pub color: ColorChoice,
}

impl Console {
    /// Prints a command's result on stdout: as JSON, as text for people, or, when quiet, not at all. Text that has a longer form has it as
    /// its alternate one (`{:#}`).
    pub fn result(&self, result: &impl Serialize, text: impl Display) -> Result<(), Stop> {
        if self.json {
            let json = serde_json::to_string_pretty(result).map_err(|error| broken_stdout(error.into()))?;
            print(&json)
        } else if !self.quiet {
            print(&if self.verbose { format!("{text:#}") } else { text.to_string() })
        } else {
            Ok(())
        }
    }

    /// Says something that the user should know; not when quiet.
    pub fn note(&self, line: impl Display) {
        if !self.quiet {
            complain("note", AnsiColor::Cyan, line);
        }
    }
}

/// The colours that arguments ask for, before they are understood: what is wrong with them is said in colour too.
pub fn asked_colour(arguments: impl Iterator<Item = String>) -> ColorChoice {
    let arguments: Vec<String> = arguments.collect();
    let value = |(k, argument): (usize, &String)| match argument.strip_prefix("--color") {
        Some("") => arguments.get(k + 1).cloned(),
        Some(rest) => rest.strip_prefix('=').map(str::to_owned),
        None => None,
    };
    let asked = arguments.iter().enumerate().find_map(value);
    asked.and_then(|value| ColorChoice::from_str(&value, true).ok()).unwrap_or(ColorChoice::Auto)
}

/// Colours what is said from here on, or not.
pub fn colour(choice: ColorChoice) {
    let choice = match choice {
        ColorChoice::Auto => anstream::ColorChoice::Auto,
        ColorChoice::Always => anstream::ColorChoice::Always,
        ColorChoice::Never => anstream::ColorChoice::Never,
    };
    choice.write_global();
}

/// Says what makes a result doubtful, quiet or not.
pub fn warning(line: impl Display) {
    complain("warning", AnsiColor::Yellow, line);
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
    complain("error", AnsiColor::Red, message);
}

/// Says what can be done about it.
pub fn help(line: impl Display) {
    complain("help", AnsiColor::Green, line);
}

/// Prints a line on stderr, whether or not anyone reads it.
fn complain(label: &str, colour: AnsiColor, line: impl Display) {
    let style = colour.on_default().effects(Effects::BOLD);
    let _ = writeln!(anstream::stderr(), "{style}{label}:{style:#} {line}");
}

fn broken_stdout(source: io::Error) -> Stop {
    Stop::Broken(Error::io("standard output", source))
}
