//! `sprung-mpi`: the scenes of `sprung` on many processes and machines, with PETSc and MPI.
//!
//! | module | contents |
//! |---|---|
//! | `petsc` | bindings to PETSc, with all `unsafe` code but one function |
//! | `waiting` | that function: sleeping while waiting |
//! | `ranks` | communication between ranks |
//! | `slab` | the distribution of a scene before partitioning |
//! | `files` | split scenes, of which every rank reads its own part |
//! | `agreed` | collective decisions |
//! | `ready` | ready scenes, of which every rank generates its own part |
//! | `part` | the subdomain of a rank: particles, springs and ghosts |
//! | `rows` | the matrix rows of a subdomain |
//! | `solver` | global linear systems |
//! | `results`, `checkpoint` | files |
//! | `load` | sources of scenes |
//! | `method` | names of methods and solvers |
//! | `run`, `matrix`, `split`, `count` | the commands |
//!
//! Steps, forces, energies and indicators are those of the library, on subdomains (see `sprung::system::Communicator`).

mod agreed;
mod checkpoint;
mod count;
mod files;
mod load;
mod matrix;
mod method;
mod part;
mod petsc;
mod ranks;
mod ready;
mod results;
mod rows;
mod run;
mod slab;
mod solver;
mod split;
mod waiting;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Scenes of sprung on many processes and machines, by PETSc over MPI.
///
/// Start it with mpirun or srun: `mpirun -n 8 sprung-mpi run scene.toml`. As long as a scene fits one machine, `sprung` is several
/// times faster there.
///
/// Exit status, of every rank: 0 done; 1 the computation ran and failed; 2 unusable input or arguments.
#[derive(Debug, Parser)]
#[command(name = "sprung-mpi", version, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Run(run::Run),
    Matrix(matrix::Matrix),
    Split(split::Split),
    Count(count::Count),
}

/// Why a command ends early, known to all ranks alike.
#[derive(Debug)]
pub enum Stop {
    /// The input or an argument cannot be used.
    Unusable(String),
    /// The computation failed; what there is to say has been said.
    Failed,
}

/// Ends all ranks because of what happened on this one.
pub fn end_all(message: &str) -> ! {
    eprintln!("error: rank {}: {message}", ranks::rank());
    ranks::abort(1)
}

/// What a fallible step of this rank alone gives, or the end of all ranks.
pub fn or_end<T, E: std::fmt::Display>(result: Result<T, E>) -> T {
    result.unwrap_or_else(|error| end_all(&error.to_string()))
}

/// Says something once.
pub fn say(message: impl std::fmt::Display) {
    if ranks::rank() == 0 {
        eprintln!("{message}");
    }
}

fn main() -> ExitCode {
    petsc::partition_without_threads();
    // Ends last of all that is made here.
    let Some(_universe) = mpi::initialize() else {
        eprintln!("error: MPI cannot be started");
        return ExitCode::from(1);
    };
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            let status = if error.use_stderr() { 2 } else { 0 };
            if ranks::rank() == 0 {
                let _ = error.print();
            }
            return ExitCode::from(status);
        }
    };
    // A panic of one rank would leave the others waiting.
    std::panic::set_hook(Box::new(|panic| end_all(&panic.to_string())));
    let outcome = match arguments.command {
        Command::Run(run) => run.execute(),
        Command::Matrix(matrix) => matrix.execute(),
        Command::Split(split) => split.execute(),
        Command::Count(count) => count.execute(),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(Stop::Failed) => ExitCode::from(1),
        Err(Stop::Unusable(message)) => {
            say(format_args!("error: {message}"));
            ExitCode::from(2)
        }
    }
}
