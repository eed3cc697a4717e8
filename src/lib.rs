//! Implicit mass–spring systems with an explicitly assembled sparse matrix.
//!
//! A [`SystemBuilder`] checks a description and returns an immutable [`System`] and its initial [`State`]. A [`Simulation`] runs it.
//! [`integrate::Matrices`] assembles A, K, G and M, and [`inspect`] analyses their definiteness.
//!
//! ```
//! use sprung::integrate::Matrices;
//! use sprung::{Simulation, Spring, Stiffness, SystemBuilder};
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
//! // Without a method and a step, the run chooses both.
//! let result = Simulation::new(&system, state.clone()).run_observed(1.0, |state, _| {
//!     lowest = lowest.min(state.positions[bob].y);
//!     ControlFlow::Continue(())
//! })?;
//! assert_eq!(result.status.name(), "completed");
//! assert!(result.error.is_some_and(|error| error < 0.01) && result.warnings.is_empty());
//! assert!((-1.1..-1.0).contains(&lowest));
//!
//! let mut matrices = Matrices::new(&system)?;
//! matrices.update(&state, Stiffness::Full)?;
//! assert_eq!(matrices.k().values()[0], -1000.0);
//! # Ok::<(), sprung::Error>(())
//! ```
//!
//! You can supply your own [linear solver](linear::LinearSolver), [preconditioner](linear::CustomPreconditioner),
//! [spring law](spring::SpringLaw) and [external force](system::ExternalForce).
//!
//! Each module uses only modules above it in this list:
//!
//! | module | contents |
//! |---|---|
//! | [`spring`] | force, energy and 3×3 blocks of one spring, without indices |
//! | [`system`] | particles, springs, constraints, free degrees of freedom, and the [`State`] |
//! | [`scene`] | scene files, meshes and ready scenes |
//! | [`figure`] | pictures as plain data |
//! | [`force`] | sums over springs: forces, energies, momenta |
//! | [`operator`] | matrix-free products A·w |
//! | [`assembly`] | sparse matrices from 3×3 blocks: one pattern, many values |
//! | [`multigrid`] | smoothed-aggregation multigrid on the assembled matrix |
//! | [`linear`] | conjugate gradients, sparse Cholesky and LDLᵀ |
//! | [`eigen`] | extreme eigenpairs of matrices and pencils, with error bounds and counts |
//! | [`integrate`] | time stepping methods, the run loop, and the matrices of one step |
//! | [`inspect`] | definiteness of A: inertia, spectrum, critical steps, and the springs that cause negative curvature |
//! | [`accuracy`] | runs to a required accuracy |
//! | [`plan`] | default method, steps and solver of a run |
//! | [`simulation`] | the entry point for runs |
//! | [`modes`] | normal modes, counted |
//! | [`mechanisms`] | motions that stretch no spring, and states of self-stress |
//! | [`gradient`] | gradients through motions |
//! | [`equilibrium`] | static equilibrium, load paths, and gradients there |
//! | [`verify`] | the verification suite: checks as data, each with value, bound and the reason for the bound |
//! | [`chart`] | work–precision diagrams and stability maps |
//! | [`report`] | checks and pictures as HTML, SVG, JSON, JUnit and text |
//! | [`output`] | result files, written atomically |
//!
//! [`error`], [`interrupt`] (requests to stop), [`memory`] (available memory) and [`work`] (counters) are used by all of them.
//!
//! `K = ∂f_el/∂x` and `G = ∂f_d/∂v` are negative (semidefinite) where the system is stable, `K^s` is the positive block
//! of one spring, and `A = M/dt² − G/dt − K`. SI units everywhere; particles and springs are numbered from 0.
//!
//! An [`Error`] is an input that cannot be used. A computation that breaks down returns an outcome with its cause, see
//! [`integrate::Outcome`] and [`linear::SolveFailure`]. The library never prints.
//!
//! Formulas are derived in the headers of the files that compute them. The guide (`cargo xtask guide`) collects these derivations and has a
//! tutorial, how-to pages and a glossary.

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

/// Sparse types of matrices and factorizations.
pub use faer;
/// Vectors and small matrices in signatures.
pub use nalgebra;
/// Sparse types that matrices convert to.
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
