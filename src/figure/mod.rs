//! Pictures as plain data: what a plot or a scene sketch shows, not how it is drawn.
//!
//! Checks, inspections and charts describe their pictures with these types; [`report`](crate::report) draws them.

mod drawing;
mod plot;
mod spy;
mod tiles;

pub use drawing::{Arrow, Drawing, Segment};
pub use plot::{Axis, Guide, Mark, Plot, Scale, Series};
pub use spy::Spy;
pub use tiles::Tiles;
