//! How accurate a run is, what it costs, and which run is the cheapest that is accurate enough.

mod candidates;
mod choose;
mod ladder;
mod norm;
mod preset;
mod race;
mod reduction;
mod settle;
mod trial;

pub use choose::{Choice, Requirement, choose};
pub use norm::{extent, relative_position_error};
pub use preset::preset;
pub use reduction::{Reduced, Reduction, reduce};
pub use trial::{Configuration, Pace, Trial, trial};
