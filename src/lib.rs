//! Implicit mass–spring systems with an explicitly assembled sparse matrix.
//!
//! The way of the data, and the rooms it passes; every room uses only those above it in this list:
//!
//! | room | what it holds |
//! |---|---|
//! | [`spring`] | the mathematics of one spring: 3-vectors and 3×3 blocks, no indices |
//! | [`system`] | particles, springs, constraints, and the one map of free degrees of freedom; the moving [`State`] |
//! | [`scene`] | scene files, meshes and ready scenes, checked with locations, to [`System`] and [`State`] |
//! | [`force`] | sums over springs: forces, energies, momenta |
//! | [`operator`] | matrices known by their products: A·w spring by spring |
//! | [`assembly`] | explicit sparse matrices from 3×3 blocks: the pattern once, the values many times |
//! | [`multigrid`] | smoothed-aggregation multigrid on the assembled matrix, for `linear` to precondition with |
//! | [`linear`] | conjugate gradients, sparse Cholesky and LDLᵀ behind one trait |
//! | [`integrate`] | time stepping methods, the run loop, and the matrices of one step |
//! | [`inspect`] | definiteness: inertia, spectrum, critical steps, and the springs behind negative curvature |
//! | [`accuracy`] | the cheapest way to a given accuracy, and what a scene does not need |
//! | [`plan`] | how a run is made where little is said of it |
//! | [`figure`] | pictures as plain data |
//! | [`verify`] | checks as plain data: value, bound, and why the bound |
//! | [`chart`] | speed against accuracy, and maps of stability |
//! | [`report`] | checks and pictures as HTML, SVG, JSON, JUnit and text |
//! | [`output`] | results of runs as files, whole or not at all |
//!
//! [`error`], [`interrupt`] (requests to stop), [`memory`] (how much there is) and [`work`] (counters) serve all rooms.
//!
//! `K = ∂f_el/∂x` and `G = ∂f_d/∂v` are negative (semidefinite) where the system is stable, `K^s` is the positive block
//! of one spring, and `A = M/dt² − G/dt − K`. SI units everywhere; particles and springs are numbered from 0.
//!
//! The crate keeps three rules. An element knows nothing of the matrix, and the assembler nothing of physics: `spring`
//! gives blocks, `assembly` puts blocks in slots. What depends on the pattern alone is computed once, and a step
//! allocates nothing. Constraints decide the degrees of freedom once, so what cannot move is not modelled.
//!
//! An [`Error`] is an input that cannot be used. A computation that breaks down is not an error but an outcome that says
//! how, see [`integrate::Outcome`] and [`linear::SolveFailure`]. Nothing here prints.

pub mod accuracy;
pub mod assembly;
#[cfg(feature = "report")]
pub mod chart;
pub mod error;
pub mod figure;
pub mod force;
pub mod inspect;
pub mod integrate;
pub mod interrupt;
pub mod linear;
pub mod memory;
pub mod multigrid;
pub mod operator;
#[cfg(feature = "report")]
pub mod output;
mod parallel;
pub mod plan;
#[cfg(feature = "report")]
pub mod report;
#[cfg(feature = "scene")]
pub mod scene;
pub mod spring;
pub mod system;
pub mod verify;
pub mod work;

/// The crate whose sparse types the matrices are given in.
pub use faer;
/// The crate whose vectors and small matrices stand in signatures.
pub use nalgebra;
/// The crate whose sparse types the matrices are given in, too.
pub use nalgebra_sparse;

pub use error::{Error, Result};
#[cfg(feature = "scene")]
pub use scene::Scene;
pub use spring::{Spring, Stiffness};
pub use system::{Constraint, DofMap, Motion, State, System, SystemBuilder};

/// The README's example, compiled and run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;
