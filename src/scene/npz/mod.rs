//! Scenes as NumPy arrays: large lists as the bytes they are, read at the speed of the disk.
//!
//! An `.npz` file is a zip of `.npy` arrays, as `numpy.savez` writes them. An array has the name of the key that it stands for, with a dot between
//! table and key; what is small is JSON text with the same keys as a [scene file](super::Scene), in an array `scene`:
//!
//! ```python
//! numpy.savez(
//!     "net.npz",
//!     scene=json.dumps({"gravity": [0, -9.81], "constraints": [{"particles": [0]}], "time": {"duration": 1.0}}),
//!     **{"particles.positions": x, "particles.masses": m, "springs.pairs": pairs, "springs.stiffness": 100.0},
//! )
//! ```
//!
//! | array | shape | type |
//! |---|---|---|
//! | `particles.positions`, `particles.velocities` | (N, d) | any real one |
//! | `particles.masses` | (N) or () | any real one |
//! | `springs.pairs` | (S, 2) | any of whole numbers |
//! | `springs.stiffness`, `springs.rest_lengths`, `springs.damping` | (S) or () | any real one |
//! | `scene` | () | text, JSON |
//!
//! A key that is in the text too, or an array of another name, is refused. Rows may lie one after the other or, as in Fortran, columns.

mod read;
mod write;

pub(super) use read::read;
#[cfg(feature = "report")]
pub(crate) use write::NpzWriter;

/// The array that holds everything small.
const TEXT: &str = "scene";

#[cfg(test)]
mod tests;
