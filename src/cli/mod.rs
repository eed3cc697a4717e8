//! The command line: arguments, progress and exit statuses.

mod accuracy;
mod chart;
mod common;
mod console;
mod definiteness;
mod equilibrium;
mod files;
mod inspect;
mod matrix;
mod mechanisms;
mod method;
mod modes;
mod print;
mod resume;
mod run;
mod summary;
mod threads;
mod verify;
mod view;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use console::Console;
use sprung::Error;
use sprung::integrate::RunFailure;
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
    Equilibrium(equilibrium::EquilibriumCommand),
    Modes(modes::ModesCommand),
    Mechanisms(mechanisms::MechanismsCommand),
    Chart(chart::Chart),
    Verify(verify::Verify),
    View(view::View),
    New(print::New),
    Completions(print::Completions),
    Man(print::Man),
}

#[derive(Debug)]
pub enum Stop {
    /// The input or an argument cannot be used; nothing was written.
    Unusable(Error),
    /// A result could not be written.
    Broken(Error),
    /// The computation failed.
    Computation(String),
    /// The computation failed, and all is said.
    Reported,
}

/// A step that failed.
impl From<RunFailure> for Stop {
    fn from(RunFailure { step, time, failure }: RunFailure) -> Self {
        let (status, time) = (failure.status().name(), console::number(time));
        Self::Computation(format!("{status} in step {step}, at t = {time} s: {failure}"))
    }
}

impl From<Error> for Stop {
    fn from(error: Error) -> Self {
        Self::Unusable(error)
    }
}

/// The arguments; exits with a message where they are wrong, in colour if they ask for it.
fn arguments() -> Arguments {
    let color = console::requested_color(std::env::args());
    console::set_color(color);
    let program = Arguments::command().color(color);
    let matches = program.clone().try_get_matches();
    let matches = matches.unwrap_or_else(|error| console::with_suggestion(error, &program).exit());
    Arguments::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}

pub fn main() -> ExitCode {
    let Arguments { console, command } = arguments();
    console::set_color(console.color);
    let outcome = match command {
        Command::Run(run) => run.execute(&console),
        Command::Matrix(matrix) => matrix.execute(&console),
        Command::Inspect(inspect) => inspect.execute(&console),
        Command::Equilibrium(equilibrium) => equilibrium.execute(&console),
        Command::Modes(modes) => modes.execute(&console),
        Command::Mechanisms(mechanisms) => mechanisms.execute(&console),
        Command::Chart(chart) => chart.execute(&console),
        Command::Verify(verify) => verify.execute(&console),
        Command::View(view) => view.execute(&console),
        Command::New(new) => new.execute(&console),
        Command::Completions(completions) => completions.execute(),
        Command::Man(man) => man.execute(),
    };
    let (status, message) = match outcome {
        Ok(()) => return ExitCode::SUCCESS,
        Err(Stop::Reported) => return ExitCode::from(1),
        Err(Stop::Computation(message)) => (1, message),
        Err(Stop::Broken(error)) => (1, error.to_string()),
        Err(Stop::Unusable(error)) => (2, error.to_string()),
    };
    console::error(message);
    ExitCode::from(status)
}
