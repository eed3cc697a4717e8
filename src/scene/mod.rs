//! Scene files, meshes and ready scenes: from a description to a [`System`](crate::System) and its [`State`](crate::State), and back.
//!
//! A [`Scene`] holds the contents of a scene file, TOML, JSON or [NumPy arrays](Scene::write_npz): [`Scene::load`] reads one, [`Scene::build`] checks
//! every value and builds the system, [`Scene::to_toml`], [`Scene::to_json`] and [`Scene::write_npz`] write it, to the bit.

mod build;
pub mod builtin;
mod load;
mod mesh;
mod npz;
mod schema;
mod snapshot;
mod values;
mod write;

pub use build::Built;
pub use builtin::{Kind, builtin, refined};
#[cfg(feature = "report")]
pub(crate) use load::json_table;
pub use mesh::MeshGeometry;
#[cfg(feature = "report")]
pub(crate) use npz::NpzWriter;
pub use schema::{
    ActuationEntry, AxisName, ConstraintEntry, Drag, FactorPath, ForceEntry, Gravity, GravityPath, Mesh, Particles,
    Path, Scene, Springs, TimeSettings,
};
pub use values::{Flags, PerItem, Row, Values};
