//! How accurate a run is, what it costs, and an answer of a required accuracy for little more than the cheapest run that has it.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `accuracy`.

mod alone;
mod answer;
mod attempt;
mod audience;
mod believed;
mod course;
mod dop853;
mod equal;
mod explicit;
mod filter;
mod floppiness;
mod horizon;
mod metered;
mod norm;
mod own;
mod preset;
mod price;
mod rates;
mod reduction;
mod requirement;
mod resolution;
mod samples;
mod search;
mod settled;
mod stability;
mod stiff;
#[cfg(test)]
mod tests;
mod trial;
mod verlet;
mod words;

pub use answer::answer;
pub use attempt::SolverReport;
pub use audience::{Audience, SearchProgress};
pub use horizon::Horizon;
pub use norm::{extent, relative_position_error};
pub use preset::preset;
pub use reduction::{Reduced, Reduction, reduce};
pub use requirement::Requirement;
pub use search::{Answer, Verdict};
pub use trial::{Configuration, Pace, Trial, trial};
