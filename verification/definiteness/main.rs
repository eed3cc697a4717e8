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
use sprung::report::plot;
use std::error::Error;
use std::path::Path;

/// Answers to indefinite matrices, compared on random scenes.
#[derive(Parser)]
struct Arguments {
    /// The first seed
    #[arg(long, default_value_t = 72_000)]
    first: u64,

    /// Scenes of the table; those of the runs at any step follow
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
    let Arguments { first, count, runs, write } = Arguments::parse();
    let problems = table::problems(first..first + count)?;
    let runs = robustness::runs(first + count..first + count + runs)?;
    let page = format!(
        "# Answers to indefinite matrices, measured\n\nMade by `cargo xtask definiteness --first {first} --count {count} --write`. All figures are counts, the same on every machine.\n\n{}\n{}",
        table::section(&problems),
        robustness::section(&runs),
    );
    print!("{page}");
    if write {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
        std::fs::write(folder.join("definiteness.md"), page)?;
        std::fs::write(folder.join("definiteness.svg"), plot::svg(&table::picture(&problems)))?;
    }
    Ok(())
}
