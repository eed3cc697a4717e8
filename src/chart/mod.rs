//! Speed against accuracy, and the limits of stability, as plain data.
//!
//! [`WorkPrecision`] sweeps methods, stiffness options, solvers and steps over one scene and measures what each run costs and
//! how far it ends from a [`Reference`] of independent origin. How this looks is decided elsewhere.

mod conclusion;
mod curve;
mod deadline;
mod decision;
mod digits;
mod dop853;
mod figures;
mod monotone_range;
mod quality;
mod reference;
mod sizes;
pub mod stability;
mod sweep;
mod tolerance;
mod work_precision;

pub use curve::{Curve, LARGEST_ERROR, curves};
pub use deadline::Deadline;
pub use decision::Decision;
pub use dop853::dop853;
pub use figures::{Figure, best_of_each};
pub use monotone_range::tail;
pub use quality::Quality;
pub use reference::Reference;
pub use sizes::SizeRun;
pub use stability::StabilityMap;
pub use sweep::{Run, configurations};
pub use work_precision::{SweepOptions, WorkPrecision};

use std::time::Duration;

/// Hears how far a study is.
pub trait Progress {
    /// So much time has passed, and this is being done.
    fn at(&mut self, elapsed: Duration, what: &str);
}

impl<F: FnMut(Duration, &str)> Progress for F {
    fn at(&mut self, elapsed: Duration, what: &str) {
        self(elapsed, what);
    }
}
