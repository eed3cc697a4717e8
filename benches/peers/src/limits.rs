//! How long a run may take.

use std::time::Duration;

/// A run that takes longer is broken off.
pub const LONGEST: Duration = Duration::from_secs(8);

/// The cause of a run that was broken off.
pub const TOO_LONG: &str = "longer than 8 s";
