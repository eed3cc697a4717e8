//! How accurate a run is, what it costs, and an answer of a required accuracy for little more than the cheapest run that has it.

mod alone;
mod answer;
mod attempt;
mod course;
mod explicit;
mod horizon;
mod norm;
mod preset;
mod rates;
mod reduction;
mod resolution;
mod search;
mod stiff;
mod trial;
mod words;

pub use answer::{Requirement, answer};
pub use attempt::{Audience, Progress, SolverReport};
pub use horizon::Horizon;
pub use norm::{extent, relative_position_error};
pub use preset::preset;
pub use reduction::{Reduced, Reduction, reduce};
pub use search::{Answer, Verdict};
pub use trial::{Configuration, Pace, Trial, trial};
