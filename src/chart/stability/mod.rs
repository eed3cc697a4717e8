//! The stability of each method: measured, with the limits that theory gives.
//!
//! **The model.** One particle of mass m in the plane between two equal springs to fixed walls, each at the stretch λ = l/l0. It has an axial mode,
//! `ω² = 2k/(l0 m)`, and a transverse one, `ω_t² = ω² (1 − 1/λ)`: an oscillation where the springs are stretched, buckling at the rate
//! `σ² = ω² (1/λ − 1)` where they are compressed. `z = ω dt` and λ, or the axial damping ratio ζ, span the map. A spring that turns, which no linear
//! model shows, has tiles of its own over z and the angle by which a step turns it.

mod experiment;
mod limits;
mod map;
mod turning;

pub use experiment::TileVerdict;
pub use limits::Limit;
pub use map::{StabilityMap, Tile, Varied};
