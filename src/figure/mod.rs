//! Pictures as plain data: what a plot or a scene sketch shows, not how it is drawn.
//!
//! Checks, inspections and charts describe their pictures with these types; [`report`](crate::report) draws them.

mod animation;
mod decimation;
mod drawing;
mod plot;
mod spy;
mod tiles;
mod topology;
mod upright;

pub use animation::{Animation, Track};
pub use decimation::Decimation;
pub use drawing::{Arrow, Drawing, Segment};
pub use plot::{Axis, Guide, Look, Mark, Plot, Scale, Series};
pub use spy::Spy;
pub use tiles::Tiles;
pub use topology::{Binding, SceneTopology};
pub use upright::Up;
