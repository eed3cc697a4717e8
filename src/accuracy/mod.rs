//! Runs to a required accuracy, and the method that suits a scene.
//!
//! In the guide (`cargo xtask guide`), under theory: `accuracy`.
//!
//! **Confirmed** means that two runs which do not share their errors agree, and that a measured sensitivity bears them out:
//!
//! 1. a run with the [propagated error](crate::integrate::PropagatedError) of its own steps, and
//! 2. a run of the same method with steps at least twice as fine, which ends as far from the first as that error says.
//!
//! The second run is the answer. With the method's order p and steps f times as fine, its error is the difference over `f^p − 1`, or the propagated
//! error over `f^p` where that is more. Where the motion magnifies errors the propagated error is large, whatever two runs agree on.

mod norm;
mod observer;
mod search;
mod spectral_radius;
mod trial;

pub use norm::{extent, relative_position_error};
pub use observer::{Observer, SearchProgress};
pub use search::{AccuracyOptions, Answer, SolverReport, Verdict, run_to_accuracy};
pub use spectral_radius::{SpectralRadius, default_method};
pub use trial::{Configuration, StepControl, Trial, trial};
