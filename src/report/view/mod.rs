//! `view.html`: a motion that plays in any browser, from one file that loads nothing.
//!
//! The page draws by itself, in some seven hundred lines: springs coloured by strain, the triangles of a mesh as a shaded surface, particles
//! that are held or moved marked. What it carries is made here, see `encode`: positions and strains as whole numbers, predicted along
//! time and deflated, which browsers undo by themselves. Drawing by WebGL and by a library were tried beside it; `docs/guide/src/how-to/watching.md` has
//! the numbers.

mod channel;
mod encode;
mod page;
mod panel;

use crate::figure::Animation;
use std::io;

/// Bytes that the data of a page may take: files beyond 40 MB are slow to load, and mail and phones refuse them.
const LIMIT: usize = 38_000_000;

/// The page of an animation. Frames are left out, evenly, where the page would be larger than 40 MB; it says so.
///
/// # Errors
/// Where the facts of an animation cannot be written as JSON.
pub fn html(animation: &Animation) -> io::Result<String> {
    within(animation, LIMIT)
}

/// As [`html`], with at most so many bytes of data.
///
/// # Errors
/// As [`html`].
pub fn within(animation: &Animation, limit: usize) -> io::Result<String> {
    page::page(animation, &encode::encode(animation, limit))
}
