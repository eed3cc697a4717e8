//! A copy of the program in the target folder, to be modified and built there.

use std::path::{Path, PathBuf};
use std::{fs, io};

/// Folders that are not copied.
const SKIPPED: [&str; 3] = ["target", ".git", "out"];

/// The folder that Cargo builds into.
pub fn target(root: &Path) -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or(root.join("target"), PathBuf::from)
}

/// Copies the program, or brings an older copy up to date.
pub fn program(root: &Path, copy: &Path) -> io::Result<()> {
    fs::create_dir_all(copy)?;
    for part in fs::read_dir(root)? {
        let part = part?.file_name();
        if !SKIPPED.iter().any(|skipped| part == *skipped) {
            synchronise(&root.join(&part), &copy.join(&part))?;
        }
    }
    Ok(())
}

/// Links compiled dependencies into the target folder of a copy. Artefacts of the program itself are not linked, as Cargo cannot distinguish a copy from
/// the original.
pub fn dependencies(root: &Path, folder: &Path) -> io::Result<()> {
    let built = target(root).join("faults");
    if !built.exists() || folder.exists() {
        return Ok(());
    }
    for part in ["deps", "build", ".fingerprint"] {
        link(&built.join(part), &folder.join("faults").join(part))?;
    }
    Ok(())
}

fn link(from: &Path, to: &Path) -> io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let name = entry.file_name();
        if name.to_string_lossy().trim_start_matches("lib").starts_with("sprung-") {
            continue;
        }
        if entry.file_type()?.is_dir() {
            link(&entry.path(), &to.join(name))?;
        } else {
            fs::hard_link(entry.path(), to.join(name))?;
        }
    }
    Ok(())
}

/// Makes a copy the same as the original, leaving alone what already is, so that a build sees no change.
fn synchronise(from: &Path, to: &Path) -> io::Result<()> {
    if from.is_dir() {
        fs::create_dir_all(to)?;
        for entry in fs::read_dir(from)? {
            let name = entry?.file_name();
            synchronise(&from.join(&name), &to.join(&name))?;
        }
        for entry in fs::read_dir(to)? {
            let name = entry?.file_name();
            if !from.join(&name).exists() {
                fs::remove_file(to.join(&name))?;
            }
        }
        return Ok(());
    }
    write(to, &fs::read(from)?)
}

/// Writes a file, unless that is what it holds.
pub fn write(to: &Path, content: &[u8]) -> io::Result<()> {
    if fs::read(to).is_ok_and(|existing| existing == content) { Ok(()) } else { fs::write(to, content) }
}
