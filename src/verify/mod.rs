//! Verification of forces, Jacobians, solvers, integrators and conservation laws against derived error bounds.
//!
//! A [`Check`] holds a measured value, its bound, and the reason for the bound. A [`Family`] makes related checks on a [`TestCase`], a
//! system with its state and time step. [`verify`] evaluates every family that applies; the command `sprung verify` does so for the
//! built-in scenes or for any scene file, and [reports](crate::report) present the results.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `checks`.

mod check;
mod coloring;
mod comparison;
mod consistency;
mod convergence;
mod definiteness;
mod dual;
mod energy_balance;
mod error_estimates;
#[cfg(test)]
mod fixtures;
mod force_error;
mod free_coordinates;
mod gradients;
mod jacobian;
mod limits;
mod loads;
mod momentum;
mod prescribed_motion;
mod products;
mod reference;
mod refusals;
mod runs;
mod scenes;
mod solution;
mod solvers;
mod step_equations;
mod stiffness;
mod suite;
mod test_case;
mod v_curve;

// What most families use.
use check::{Measured, Unfinished};
use comparison::{WorstEntries, ratio};
use force_error::{ForceError, SECOND};
use free_coordinates::{VECTORS, expand, random_vector};
use limits::{AFFORDABLE, LARGE, UNITS};
use reference::Link;
use runs::{MethodVariant, direct};

pub use check::{Check, Claim, Results};
pub use coloring::ColumnGroups;
pub use comparison::{Entry, worst};
pub use consistency::{damping_dissipates, damping_entries, energy_slope};
pub use convergence::{ErrorCurve, order_checks};
pub use dual::force_against_energy;
pub use free_coordinates::{damping_force, elastic_energy, elastic_force, reduce};
pub use jacobian::{JacobianOptions, JacobianReport, check_jacobian};
pub use limits::U;
pub use products::{products_agree, refill_is_fresh};
#[cfg(feature = "scene")]
pub use scenes::built_in;
pub use scenes::hard_states;
pub use solution::{
    Promise, Solved, backward_errors, condition_estimate, condition_is_right, indefinite_backward_error,
    solutions_agree,
};
pub use stiffness::{spring_blocks, stiffness_against_duals, stiffness_entries};
pub use suite::{FAMILIES, Family, verify};
pub use test_case::TestCase;
pub use v_curve::{dropped_terms, v_curve};
