//! Verification: every number is held to a bound that an analysis gives.
//!
//! A [`Check`] is plain data: what was measured, what is allowed and why. Checks know nothing of
//! [reports](crate::report). A [`Family`] of checks runs on any [`TestCase`], a scene with its step; [`verify`] runs all
//! that apply.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `checks`.

mod assembled;
mod check;
mod claim;
mod coloring;
mod condition;
mod consistency;
mod convergence;
mod damping_turn;
mod definiteness;
mod derivatives;
mod difference;
mod dropped;
mod dual;
mod entries;
mod equilibrium;
mod extrapolation;
mod family;
#[cfg(test)]
mod fixtures;
mod force_error;
mod formula_steps;
mod hard_states;
mod indicators;
mod jacobian;
mod ledger;
mod limits;
mod measured;
mod measurement;
mod momentum;
mod orders;
mod prescribed_motion;
mod products;
mod range;
mod reduced;
mod reference;
mod refusals;
mod reproducibility;
mod residual;
mod rigid_motion;
mod runs;
#[cfg(feature = "scene")]
mod scenes;
mod solution;
mod solvers;
mod step_equations;
mod test_case;
mod v_curve;
mod verdict;
mod work_energy;

pub use check::{Check, Entry, Results, worst};
pub use claim::Claim;
pub use coloring::ColumnGroups;
pub use condition::{Condition, forward_bound, one_norm_estimate};
pub use consistency::{damping_dissipates, damping_entries, energy_slope};
pub use damping_turn::damping_turns;
pub use difference::{spring_blocks, stiffness_entries};
pub use dropped::dropped_terms;
pub use dual::{
    blocks_against_duals, dual_force, dual_stiffness_block, force_against_energy, hyper_dual_stiffness_block,
    stiffness_against_duals,
};
pub use family::{FAMILIES, Family, verify};
pub use force_error::U;
pub use hard_states::hard_states;
pub use jacobian::{JacobianOptions, JacobianReport, check_jacobian};
pub use orders::{ErrorCurve, order_checks};
pub use products::{products_agree, refill_is_fresh};
pub use reduced::{damping_force, elastic_energy, elastic_force, reduce};
#[cfg(feature = "scene")]
pub use scenes::built_in;
pub use solution::{
    Promise, Solved, backward_errors, condition_is_right, indefinite_backward_error, solutions_agree, tolerance_is_met,
};
pub use test_case::TestCase;
pub use v_curve::v_curve;

use measured::Unfinished;
