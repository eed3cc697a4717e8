//! Every answer to an indefinite matrix on random scenes, and Newton's method at any step.

pub mod robustness;
pub mod scenes;
pub mod table;
