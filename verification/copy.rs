//! A copy of the program below the target folder, to be changed and built there.

use std::path::{Path, PathBuf};
use std::{fs, io};

/// What is no part of the program.
const LEFT_OUT: [&str; 3] = ["target", ".git", "out"];

/// The folder that Cargo builds into.
pub fn target(root: &Path) -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or(root.join("target"), PathBuf::from)
}

/// Copies the program, or brings an older copy up to date.
pub fn program(root: &Path, copy: &Path) -> io::Result<()> {
    fs::create_dir_all(copy)?;
    for part in fs::read_dir(root)? {
        let part = part?.file_name();
        if !LEFT_OUT.iter().any(|left_out| part == *left_out) {
            synchronise(&root.join(&part), &copy.join(&part))?;
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
