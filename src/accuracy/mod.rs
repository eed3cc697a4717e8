//! How accurate a run is and what it costs.

mod cost;
mod norm;
mod trial;

pub use cost::CostModel;
pub use norm::{extent, relative_position_error};
pub use trial::{Configuration, Trial, trial};
