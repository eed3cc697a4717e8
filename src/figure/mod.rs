//! Pictures as plain data: what a plot or a scene sketch shows, not how it is drawn.
//!
//! Checks, inspections and charts describe their pictures with these types; [`report`](crate::report) draws them.

mod animation;
mod cast;
mod drawing;
mod plot;
mod spy;
mod thinning;
mod tiles;
mod upright;

pub use animation::{Animation, Track};
pub use cast::{Binding, Cast};
pub use drawing::{Arrow, Drawing, Segment};
pub use plot::{Axis, Guide, Look, Mark, Plot, Scale, Series};
pub use spy::Spy;
pub use thinning::Thinning;
pub use tiles::Tiles;
pub use upright::Up;
