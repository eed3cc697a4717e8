//! Scene files, meshes and ready scenes.

#[path = "../common/rejections.rs"]
#[macro_use]
mod rejected;

mod arrays;
mod builtin;
mod formats;
mod mesh;
mod rejections;
mod round_trip;
mod systems;
