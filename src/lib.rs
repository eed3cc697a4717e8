//! Implicit mass–spring systems with an explicitly assembled sparse matrix.

#![forbid(unsafe_code)]
#![deny(missing_docs)]

pub mod accuracy;
pub mod assembly;
pub mod chart;
pub mod error;
pub mod figure;
pub mod force;
pub mod integrate;
pub mod linear;
pub mod operator;
pub mod output;
pub mod report;
pub mod scene;
pub mod spring;
pub mod system;
pub mod verify;
pub mod work;

pub use error::{Error, Result};
pub use scene::Scene;
pub use spring::{Spring, Stiffness};
pub use system::{Constraint, DofMap, Motion, State, System, SystemBuilder};
