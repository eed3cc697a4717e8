//! Tools for those who work on `sprung`: `cargo xtask --help`.

mod guide;
mod links;
mod theory;

use anyhow::{Context, Result};
use clap::Parser;
use std::path::{Path, PathBuf};

/// Tools for those who work on sprung
#[derive(Debug, Parser)]
enum Command {
    /// Build the guide into target/guide/book: theory pages from the headers of modules, then mdBook
    Guide,
    /// Check that every relative link in every page leads to a file, and every anchor to a heading
    Links,
}

fn main() -> Result<()> {
    let root = root()?;
    match Command::parse() {
        Command::Guide => guide::build(&root),
        Command::Links => links::check(&root),
    }
}

/// The folder of the repository.
fn root() -> Result<PathBuf> {
    let parent = Path::new(env!("CARGO_MANIFEST_DIR")).parent();
    Ok(parent.context("this package lies in no folder")?.to_path_buf())
}
