//! Makes `verification/definiteness.md`: answers to indefinite matrices compared, and Newton's method at any step.
//!
//! ```sh
//! cargo xtask definiteness --write          # everything, the page and its picture
//! cargo xtask definiteness --first 7000     # other seeds
//! ```

#[path = "mod.rs"]
mod definiteness;

use clap::Parser;
use definiteness::{robustness, table};
use sprung::integrate::StiffnessPolicy;
use std::error::Error;

/// Answers to indefinite matrices, compared on random scenes.
#[derive(Parser)]
struct Arguments {
    /// The first seed
    #[arg(long, default_value_t = 72_000)]
    first: u64,

    /// Scenes of the table
    #[arg(long, default_value_t = 40)]
    count: u64,

    /// Scenes of the runs at any step
    #[arg(long, default_value_t = 500)]
    runs: u64,

    /// Writes the page and its picture
    #[arg(long)]
    write: bool,
}

fn main() -> Result<(), Box<dyn Error>> {
    let Arguments { first, count, runs, .. } = Arguments::parse();
    let begin = std::time::Instant::now();
    let problems = table::problems(first..first + count)?;
    println!("{}", table::table(&problems));
    println!("{:?}", begin.elapsed());
    for policy in [StiffnessPolicy::OnDemand, StiffnessPolicy::Progressive] {
        for run in robustness::runs(first + count..first + count + runs, policy)? {
            let solve = &run.solves[0];
            if !solve.is_solved() {
                println!("{} {} {} dt {:?}: {:?}", policy.name(), run.seed, run.name, run.factor, solve.message);
            }
        }
    }
    println!("{:?}", begin.elapsed());
    Ok(())
}
