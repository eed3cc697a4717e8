//! Linear systems solved as exactly as the motion needs, against the same runs with systems solved to the last digit:
//! `verification/exactness.md`.
//!
//! ```sh
//! cargo xtask exactness                # a thousand random scenes, and the page
//! cargo xtask exactness --count 100    # the first hundred seeds
//! ```

#[allow(dead_code, reason = "a part of the study is used")]
#[path = "../study/mod.rs"]
mod study;

mod page;
mod pair;

use clap::Parser;
use rayon::prelude::*;
use std::path::PathBuf;
use study::store::Store;

/// Compares runs with each other and with the truth.
#[derive(Parser)]
struct Arguments {
    /// Number of seeds
    #[arg(long, default_value_t = 1000)]
    count: u64,

    /// The first seed
    #[arg(long, default_value_t = 0)]
    first: u64,

    /// Prints the page instead of writing it
    #[arg(long)]
    print: bool,

    /// Where references are kept
    #[arg(long, default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/../target/study"))]
    folder: PathBuf,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments = Arguments::parse();
    let store = Store::open(&arguments.folder.join("references"))?;
    let seeds = arguments.first..arguments.first + arguments.count;
    let found: Result<Vec<_>, _> = seeds.into_par_iter().map(|seed| pair::pairs(seed, &store)).collect();
    let pairs: Vec<_> = found?.into_iter().flatten().collect();
    let page = page::page(&pairs, arguments.count);
    if arguments.print {
        print!("{page}");
    } else {
        std::fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/exactness.md"), page)?;
    }
    Ok(())
}
