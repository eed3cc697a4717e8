//! Verification: every number is held to a bound that an analysis gives.
//!
//! A [`Check`] is plain data: what was measured, what is allowed and why. Checks know nothing of reports.

mod check;
mod claim;

pub use check::{Check, Entry, Results, worst};
pub use claim::Claim;
