//! The command line: arguments, progress and exit statuses. One file per command.

mod answer;
mod chart;
mod common;
mod completions;
mod console;
mod diagnostics;
mod failure;
mod files;
mod inspect;
mod interrupt;
mod man;
mod matrix;
mod method;
mod new;
mod number;
mod parts;
mod recorder;
mod resume;
mod run;
mod start;
mod suggest;
mod time;
mod values;
mod verify;
mod view;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use console::Console;
use sprung::Error;
use std::process::ExitCode;

/// Implicit mass–spring systems with an explicitly assembled sparse matrix.
///
/// A scene is a TOML, JSON or NumPy (.npz) file of particles, springs and constraints, in SI units. `sprung new cloth > cloth.toml`
/// prints one to start from, `sprung run cloth.toml` simulates it.
///
/// Exit status: 0 done; 1 the computation ran and failed; 2 unusable input or arguments.
#[derive(Debug, Parser)]
#[command(name = "sprung", version, max_term_width = 100)]
struct Arguments {
    #[command(flatten)]
    console: Console,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Run(run::Run),
    Matrix(matrix::Matrix),
    Inspect(inspect::Inspect),
    Chart(chart::Chart),
    Verify(verify::Verify),
    View(view::View),
    New(new::New),
    Completions(completions::Completions),
    Man(man::Man),
}

/// How a command ended that could start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// It did what was asked.
    Done,
    /// It computed, and the computation failed.
    Failed,
}

/// Why a command could not start or finish.
#[derive(Debug)]
pub enum Stop {
    /// The input or an argument cannot be used; nothing was written.
    Unusable(Error),
    /// A result could not be written.
    Broken(Error),
    /// The computation failed before there was a result to write.
    Computation(String),
}

impl From<Error> for Stop {
    fn from(error: Error) -> Self {
        Self::Unusable(error)
    }
}

/// The arguments, or the end of the program with what is wrong with them, in colour or not as they ask for it.
fn arguments() -> Arguments {
    let asked = console::asked_colour(std::env::args());
    console::colour(asked);
    let program = Arguments::command().color(asked);
    let matches = program.clone().try_get_matches();
    let matches = matches.unwrap_or_else(|error| suggest::suggesting(error, &program).exit());
    Arguments::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}

/// Runs the command that the arguments ask for; returns the exit status.
pub fn main() -> ExitCode {
    let Arguments { console, command } = arguments();
    console::colour(console.color);
    let outcome = match command {
        Command::Run(run) => run.execute(&console),
        Command::Matrix(matrix) => matrix.execute(&console),
        Command::Inspect(inspect) => inspect.execute(&console),
        Command::Chart(chart) => chart.execute(&console),
        Command::Verify(verify) => verify.execute(&console),
        Command::View(view) => view.execute(&console),
        Command::New(new) => new.execute(&console),
        Command::Completions(completions) => completions.execute(),
        Command::Man(man) => man.execute(),
    };
    match outcome {
        Ok(Exit::Done) => ExitCode::SUCCESS,
        Ok(Exit::Failed) => ExitCode::from(1),
        Err(Stop::Computation(message)) => {
            console::error(message);
            ExitCode::from(1)
        }
        Err(Stop::Broken(error)) => {
            console::error(error);
            ExitCode::from(1)
        }
        Err(Stop::Unusable(error)) => {
            console::error(error);
            ExitCode::from(2)
        }
    }
}
