//! Implicit mass–spring systems with an explicitly assembled sparse matrix.
//!
//! A [`SystemBuilder`] checks a description and gives a [`System`], which does not change any more, and its [`State`]. Most programs need two things:
//! a [`Simulation`], and, where they want to look inside, [`integrate::Matrices`] and [`inspect`].
//!
//! ```
//! use sprung::integrate::Matrices;
//! use sprung::{Method, Simulation, Spring, Stiffness, SystemBuilder};
//! use std::ops::ControlFlow;
//!
//! let mut builder = SystemBuilder::new();
//! builder.gravity(0.0, -9.81, 0.0);
//! let anchor = builder.particle([0.0, 0.0, 0.0], 1.0);
//! let bob = builder.particle([1.0, 0.0, 0.0], 2.0);
//! builder.spring(anchor, bob, Spring { stiffness: 1000.0, rest_length: 1.0, damping: 0.3 });
//! builder.hold(anchor);
//! let (system, state) = builder.build()?;
//!
//! let mut lowest = 0.0_f64;
//! let simulation = Simulation::new(&system, state.clone()).method(Method::Bdf2).dt(0.01);
//! let result = simulation.run_observed(1.0, |state, _| {
//!     lowest = lowest.min(state.positions[bob].y);
//!     ControlFlow::Continue(())
//! })?;
//! assert_eq!((result.status.name(), result.steps), ("completed", 100));
//! assert!((-1.2..-1.0).contains(&lowest));
//!
//! let mut matrices = Matrices::new(&system)?;
//! matrices.update(&state, Stiffness::Full)?;
//! assert_eq!(matrices.k().values()[0], -1000.0);
//! # Ok::<(), sprung::Error>(())
//! ```
//!
//! A [linear solver](linear::LinearSolver), a [preconditioner](linear::CustomPreconditioner), a [spring law](spring::SpringLaw) and a
//! [force from outside](system::ExternalForce) may be your own.
//!
//! The modules, in the order of the data's way; each uses only those above it in this list:
//!
//! | module | what it holds |
//! |---|---|
//! | [`spring`] | the mathematics of one spring: 3-vectors and 3×3 blocks, no indices |
//! | [`system`] | particles, springs, constraints, and the one map of free degrees of freedom; the moving [`State`] |
//! | [`scene`] | scene files, meshes and ready scenes, checked with locations, to [`System`] and [`State`] |
//! | [`figure`] | pictures as plain data |
//! | [`force`] | sums over springs: forces, energies, momenta |
//! | [`operator`] | matrices known by their products: A·w spring by spring |
//! | [`assembly`] | explicit sparse matrices from 3×3 blocks: the pattern once, the values many times |
//! | [`multigrid`] | smoothed-aggregation multigrid on the assembled matrix, for `linear` to precondition with |
//! | [`linear`] | conjugate gradients, sparse Cholesky and LDLᵀ behind one trait |
//! | [`eigen`] | extreme eigenpairs of matrices and pencils, with error bounds and counts |
//! | [`integrate`] | time stepping methods, the run loop, and the matrices of one step |
//! | [`inspect`] | definiteness: inertia, spectrum, critical steps, and the springs behind negative curvature |
//! | [`modes`] | normal modes, counted |
//! | [`equilibrium`] | static equilibrium, its inertia and its gradient |
//! | [`mechanisms`] | motions that stretch no spring, and states of self-stress |
//! | [`accuracy`] | the cheapest way to a given accuracy, and what a scene does not need |
//! | [`plan`] | the method, steps and solver of a run where they are not given |
//! | [`simulation`] | one entry to all runs |
//! | [`gradient`] | gradients through motions |
//! | [`verify`] | checks as plain data: value, bound, and why the bound |
//! | [`chart`] | speed against accuracy, and maps of stability |
//! | [`report`] | checks and pictures as HTML, SVG, JSON, JUnit and text |
//! | [`output`] | results of runs as files, whole or not at all |
//!
//! [`error`], [`interrupt`] (requests to stop), [`memory`] (how much there is) and [`work`] (counters) serve all of them.
//!
//! `K = ∂f_el/∂x` and `G = ∂f_d/∂v` are negative (semidefinite) where the system is stable, `K^s` is the positive block
//! of one spring, and `A = M/dt² − G/dt − K`. SI units everywhere; particles and springs are numbered from 0.
//!
//! The crate keeps three rules. An element knows nothing of the matrix, and the assembler nothing of physics: `spring`
//! gives blocks, `assembly` puts blocks in slots. What depends on the pattern alone is computed once, and a step
//! allocates nothing. Constraints decide the degrees of freedom once, so what cannot move is not modelled.
//!
//! The derivations of all formulas stand in the headers of the files that compute them; the guide (`cargo xtask guide`) shows them, a page an
//! idea, and has a first hour, pages on how to do things, and a glossary.
//!
//! An [`Error`] is an input that cannot be used. A computation that breaks down is not an error but an outcome that says
//! how, see [`integrate::Outcome`] and [`linear::SolveFailure`]. Nothing here prints.

pub mod accuracy;
pub mod assembly;
#[cfg(feature = "report")]
pub mod chart;
pub mod eigen;
pub mod equilibrium;
pub mod error;
pub mod figure;
pub mod force;
pub mod gradient;
pub mod inspect;
pub mod integrate;
pub mod interrupt;
pub mod linear;
pub mod mechanisms;
pub mod memory;
pub mod modes;
pub mod multigrid;
pub mod operator;
#[cfg(feature = "report")]
pub mod output;
mod parallel;
pub mod plan;
mod registers;
#[cfg(feature = "report")]
pub mod report;
mod rigid;
#[cfg(feature = "scene")]
pub mod scene;
pub mod simulation;
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
pub use integrate::Method;
#[cfg(feature = "scene")]
pub use scene::Scene;
pub use simulation::{Simulation, SimulationResult};
pub use spring::{Spring, Stiffness};
pub use system::{Constraint, DofMap, Motion, State, System, SystemBuilder};

/// The README's example, compiled and run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;
