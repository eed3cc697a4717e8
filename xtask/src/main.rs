//! Tools for those who work on `sprung`: `cargo xtask --help`.

mod circles;
mod faults;
mod guide;
mod house;
mod links;
mod taken;
mod theory;
mod tools;

use anyhow::{Context, Result};
use clap::Parser;
use std::path::{Path, PathBuf};

/// Tools for those who work on sprung
#[derive(Debug, Parser)]
enum Command {
    /// Build the guide into target/guide/book: formulas as MathML, pages of the repository, mdBook
    Guide,
    /// Check that every relative link in every page leads to a file, and every anchor to a heading
    Links,
    /// Draw which module uses which, and fail where an arrow runs back or files use each other in a circle
    House,
    /// Plant faults in a copy and record which tests catch each: verification/faults.md, src/report/faults.json; a quarter of an hour
    Faults(faults::Chosen),
    #[command(flatten)]
    Tool(tools::Tool),
}

fn main() -> Result<()> {
    let root = root()?;
    match Command::parse() {
        Command::Guide => guide::build(&root),
        Command::Links => links::check(&root),
        Command::House => house::draw(&root),
        Command::Faults(chosen) => faults::run(&root, &chosen),
        Command::Tool(tool) => tools::run(&root, &tool),
    }
}

/// The folder of the repository.
fn root() -> Result<PathBuf> {
    let parent = Path::new(env!("CARGO_MANIFEST_DIR")).parent();
    Ok(parent.context("this package lies in no folder")?.to_path_buf())
}
