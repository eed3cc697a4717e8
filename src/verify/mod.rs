//! Verification: every number is held to a bound that an analysis gives.
//!
//! A [`Check`] is plain data: what was measured, what is allowed and why. Checks know nothing of
//! [reports](crate::report). A [`Family`] of checks runs on any [`Subject`], a scene with its step; [`verify`] runs all
//! that apply.

mod check;
mod claim;
mod family;
mod momentum;
mod reference;
mod rigid_motion;
mod runs;
mod subject;

pub use check::{Check, Entry, Results, worst};
pub use claim::Claim;
pub use family::{FAMILIES, Family, verify};
pub use subject::Subject;

use family::Unfinished;
