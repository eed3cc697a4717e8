//! Verification: every number is held to a bound that an analysis gives.
//!
//! A [`Check`] is plain data: what was measured, what is allowed and why. Checks know nothing of
//! [reports](crate::report).

mod assembled;
mod check;
mod claim;
mod coloring;
mod condition;
mod consistency;
mod derivatives;
mod difference;
mod dropped;
mod dual;
mod extrapolation;
mod force_error;
mod hard_states;
mod jacobian;
mod measurement;
mod products;
mod reduced;
mod residual;
mod solution;
mod solvers;
mod v_curve;
mod verdict;

pub use check::{Check, Entry, Results, worst};
pub use claim::Claim;
pub use coloring::ColumnGroups;
pub use condition::{Condition, forward_bound, one_norm_estimate};
pub use consistency::{damping_dissipates, damping_entries, energy_slope};
pub use derivatives::{consistency_checks, jacobian_checks};
pub use difference::{spring_blocks, stiffness_entries};
pub use dropped::dropped_terms;
pub use dual::{
    blocks_against_duals, dual_force, dual_stiffness_block, force_against_energy, hyper_dual_stiffness_block,
    stiffness_against_duals,
};
pub use force_error::U;
pub use hard_states::hard_states;
pub use jacobian::{JacobianOptions, JacobianReport, check_jacobian};
pub use products::{products_agree, refill_is_fresh};
pub use reduced::{damping_force, elastic_energy, elastic_force, reduce};
pub use solution::{
    Promise, Solved, backward_errors, condition_is_right, indefinite_backward_error, solutions_agree, tolerance_is_met,
};
pub use solvers::{assembly_checks, solver_checks};
pub use v_curve::v_curve;
