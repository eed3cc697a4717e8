//! Verification: every number is held to a bound that an analysis gives.
//!
//! A [`Check`] is plain data: what was measured, what is allowed and why. Checks know nothing of
//! [reports](crate::report).

mod assembled;
mod check;
mod claim;
mod coloring;
mod consistency;
mod difference;
mod dropped;
mod dual;
mod extrapolation;
mod force_error;
mod hard_states;
mod jacobian;
mod reduced;
mod v_curve;
mod verdict;

pub use check::{Check, Entry, Results, worst};
pub use claim::Claim;
pub use coloring::ColumnGroups;
pub use consistency::{damping_dissipates, damping_entries, energy_slope};
pub use difference::{spring_blocks, stiffness_entries};
pub use dropped::dropped_terms;
pub use dual::{
    blocks_against_duals, dual_force, dual_stiffness_block, force_against_energy, hyper_dual_stiffness_block,
    stiffness_against_duals,
};
pub use force_error::U;
pub use hard_states::hard_states;
pub use jacobian::{JacobianOptions, JacobianReport, check_jacobian};
pub use reduced::{damping_force, elastic_energy, elastic_force, reduce};
pub use v_curve::v_curve;
