//! Verification: every number is held to a bound that an analysis gives.
//!
//! A [`Check`] is plain data: what was measured, what is allowed and why. Checks know nothing of
//! [reports](crate::report). A [`Family`] of checks runs on any [`Subject`], a scene with its step; [`verify`] runs all
//! that apply.

mod check;
mod claim;
mod convergence;
mod definiteness;
mod equilibrium;
mod family;
mod momentum;
mod prescribed_motion;
mod reference;
mod refusals;
mod rigid_motion;
mod runs;
mod sameness;
mod step_equations;
mod subject;
mod work_energy;

pub use check::{Check, Entry, Results, worst};
pub use claim::Claim;
pub use family::{FAMILIES, Family, verify};
pub use subject::Subject;

use family::Unfinished;
