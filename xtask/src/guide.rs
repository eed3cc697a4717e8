//! Building the guide: its own pages, the theory from the headers of modules, and mdBook.

use crate::{links, taken, theory};
use anyhow::{Context, Result, bail};
use std::fs;
use std::path::Path;
use std::process::Command;

/// Assembles the guide in `target/guide`, checks its links and runs mdBook.
pub fn build(root: &Path) -> Result<()> {
    let (source, target) = (root.join("docs/guide"), root.join("target/guide"));
    let _ = fs::remove_dir_all(&target);
    copy(&source, &target)?;
    let theory = target.join("src/theory");
    fs::create_dir_all(&theory).with_context(|| theory.display().to_string())?;
    let contents = theory::contents(root)?;
    taken::copy(root, &target.join("src"), &contents.taken)?;
    for page in contents.pages(root)? {
        let file = theory.join(&page.file);
        fs::write(&file, page.text).with_context(|| file.display().to_string())?;
    }
    links::check_folder(&target.join("src"))?;
    match Command::new("mdbook").arg("build").arg(&target).status() {
        Ok(status) if status.success() => {
            println!("{}", target.join("book/index.html").display());
            Ok(())
        }
        Ok(status) => bail!("mdbook ended with {status}"),
        Err(error) => bail!("mdbook could not be started ({error}); install it: cargo install mdbook --locked"),
    }
}

fn copy(from: &Path, to: &Path) -> Result<()> {
    fs::create_dir_all(to).with_context(|| to.display().to_string())?;
    for entry in fs::read_dir(from).with_context(|| from.display().to_string())? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy(&entry.path(), &target)?;
        } else {
            fs::copy(entry.path(), &target).with_context(|| target.display().to_string())?;
        }
    }
    Ok(())
}
