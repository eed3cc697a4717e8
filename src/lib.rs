//! Implicit mass–spring systems with an explicitly assembled sparse matrix.

#![forbid(unsafe_code)]
#![deny(missing_docs)]

pub mod error;
pub mod output;
pub mod spring;
pub mod system;

pub use error::{Error, Result};
pub use spring::{Spring, Stiffness};
pub use system::{Constraint, DofMap, Motion, State, System, SystemBuilder};
