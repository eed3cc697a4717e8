//! Building the guide: its own pages, pages of the repository, formulas as MathML, and mdBook.

use crate::{copied_pages, links, theory};
use anyhow::{Context, Result, bail};
use std::fs;
use std::path::Path;
use std::process::Command;

/// Pages of the repository that the guide shows too: the page of the guide, and its source.
const PAGES: [(&str, &str); 13] = [
    ("reference/verification.md", "verification/README.md"),
    ("reference/study.md", "verification/study.md"),
    ("reference/definiteness.md", "verification/definiteness.md"),
    ("reference/derivative-checks.md", "verification/derivative-checks.md"),
    ("reference/identification.md", "verification/identification.md"),
    ("reference/accuracy.md", "verification/accuracy.md"),
    ("reference/motion.md", "verification/motion.md"),
    ("reference/robustness.md", "docs/robustness.md"),
    ("reference/performance.md", "docs/performance/README.md"),
    ("reference/performance-notes.md", "docs/performance/notes.md"),
    ("reference/explicit.md", "docs/performance/explicit.md"),
    ("reference/frames.md", "docs/performance/frames.md"),
    ("reference/others.md", "docs/others.md"),
];

/// Assembles the guide in `target/guide`, typesets its formulas, checks its links and runs mdBook.
pub fn build(root: &Path) -> Result<()> {
    let (source, target) = (root.join("docs/guide"), root.join("target/guide"));
    let _ = fs::remove_dir_all(&target);
    copy(&source, &target)?;
    copied_pages::copy(root, &target.join("src"), &PAGES)?;
    for page in theory::chapters(&target)? {
        let text = fs::read_to_string(&page).with_context(|| page.display().to_string())?;
        let typeset = theory::typeset(&text).with_context(|| page.display().to_string())?;
        fs::write(&page, typeset).with_context(|| page.display().to_string())?;
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
