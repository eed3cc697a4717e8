//! A study of a thousand random scenes: how true the motions are, and whether runs that are not true say so.
//!
//! | file | what it holds |
//! |---|---|
//! | `shape` | where particles are and which are joined: networks, cloths, chains, rods, lattices, columns |
//! | `random` | the random scenes, one for each seed |
//! | `named` | scenes with names: hard cases and ready scenes |
//! | `force` | a second writing of the forces, which shares nothing with the library's |
//! | `reference` | the true motion: DOP853 of the crate `ode_solvers` on that force, at two tolerances |
//! | `store` | references on disk |
//! | `runs` | the runs under study, through the library's public interface |
//! | `record` | everything that is run on one scene |
//! | `cases` | what makes a run right or wrong, and a scene an ordinary one |
//! | `rows` | rows and numbers of tables |
//! | `tables` | what is counted, and the page that is made of it |

pub mod cases;
pub mod force;
pub mod named;
pub mod random;
pub mod record;
pub mod reference;
pub mod rows;
pub mod runs;
pub mod shape;
pub mod store;
pub mod tables;
