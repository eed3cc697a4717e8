//! Pictures as plain data: what a plot or a scene sketch shows; [`report`](crate::report) draws them.

mod animation;
mod cells;
mod decimation;
mod drawing;
mod plot;
mod topology;

pub use animation::{Animation, Track};
pub use cells::{Spy, Tiles};
pub use decimation::Decimation;
pub use drawing::{Arrow, Drawing, Segment, Up};
pub use plot::{Axis, Guide, Look, Mark, Plot, Scale, Series};
pub use topology::{Binding, SceneTopology};
