//! Tools for those who work on `sprung`: `cargo xtask --help`.

mod blind;
mod copied_pages;
mod cycles;
mod deps;
mod faults;
mod guide;
mod links;
mod switches;
mod theory;
mod tools;
#[cfg(test)]
mod words;

use anyhow::{Context, Result};
use clap::Parser;
use std::path::{Path, PathBuf};

/// Tools for those who work on sprung
#[derive(Debug, Parser)]
enum Command {
    /// Build the guide into target/guide/book: formulas as MathML, pages of the repository, mdBook
    Guide,
    /// Check all relative links and anchors of all pages
    Links,
    /// Print which module uses which; fail if one uses a module below it or files depend on each other cyclically
    Deps,
    /// Plant random faults in every module, one at a time, and print which tests detect them; an hour
    Blind(blind::Choice),
    /// Plant faults in a copy and record which tests catch each: verification/faults.md, src/report/faults.json; 15 minutes
    Faults(faults::Chosen),
    #[command(flatten)]
    Tool(tools::Tool),
}

fn main() -> Result<()> {
    let root = root()?;
    match Command::parse() {
        Command::Guide => guide::build(&root),
        Command::Links => links::check(&root),
        Command::Deps => deps::check(&root),
        Command::Blind(choice) => blind::run(&root, &choice),
        Command::Faults(chosen) => faults::run(&root, &chosen),
        Command::Tool(tool) => tools::run(&root, &tool),
    }
}

/// The folder of the repository.
fn root() -> Result<PathBuf> {
    let parent = Path::new(env!("CARGO_MANIFEST_DIR")).parent();
    Ok(parent.context("the package has no parent folder")?.to_path_buf())
}
