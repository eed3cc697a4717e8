//! A sketch of a scene.

use super::Up;
use crate::system::{State, System};
use nalgebra::Vector3;
use serde::Serialize;

/// A scene at one state: particles, springs coloured by a scalar, and what deserves a look.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Drawing {
    /// What the drawing shows, in a few words.
    pub title: String,
    /// What it says, in a sentence; empty where it is left to speak.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub conclusion: String,
    /// What the segments' scalar is, for the colour scale.
    pub scalar: String,
    /// Number of modelled axes: 1, 2 or 3. A planar scene is drawn flat.
    pub dimension: usize,
    /// Which axis points upwards.
    #[serde(skip)]
    pub up: Up,
    /// Positions of the particles, in m.
    pub points: Vec<[f64; 3]>,
    /// Indices of the points with a prescribed coordinate.
    pub held: Vec<usize>,
    /// The springs.
    pub segments: Vec<Segment>,
    /// Vectors at points, for example an eigenvector; drawn to a common scale of their own.
    pub arrows: Vec<Arrow>,
}

/// A spring in a [`Drawing`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Segment {
    /// Indices of its end points.
    pub ends: [usize; 2],
    /// The number that colours it.
    pub scalar: f64,
    /// Why it is singled out, for example `spring 7: sign flipped`; `None` for the others.
    pub label: Option<String>,
}

/// A vector at a point of a [`Drawing`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Arrow {
    /// Index of the point.
    pub point: usize,
    /// The vector, in any unit.
    pub vector: [f64; 3],
}

impl Drawing {
    /// The springs of a scene coloured by their strain `l/l0 − 1`.
    pub fn strains(title: impl Into<String>, system: &System, state: &State) -> Self {
        let points: Vec<[f64; 3]> = state.positions.iter().map(|&x| x.into()).collect();
        let segments = system
            .pairs()
            .iter()
            .zip(system.springs())
            .map(|(pair, spring)| {
                let ends = pair.map(|p| p as usize);
                let [xi, xj] = ends.map(|p| state.positions.get(p).copied().unwrap_or_else(Vector3::zeros));
                let scalar = ((xi - xj).norm() - spring.rest_length) / spring.gauge_length();
                Segment { ends, scalar, label: None }
            })
            .collect();
        let free = |p: &usize| system.dofs().free_axes(*p).count() == system.dimension();
        let held = (0..system.particles()).filter(|p| !free(p)).collect();
        let (title, conclusion, scalar) = (title.into(), String::new(), "strain l/l₀ − 1".into());
        let (dimension, up) = (system.dimension(), Up::against(system.gravity(), system.dimension()));
        Self { title, conclusion, scalar, dimension, up, points, held, segments, arrows: Vec::new() }
    }

    /// Says what it says.
    pub fn concluding(self, conclusion: impl Into<String>) -> Self {
        Self { conclusion: conclusion.into(), ..self }
    }

    /// Singles out a spring; an index that does not exist is passed over.
    pub fn highlight(mut self, spring: usize, label: impl Into<String>) -> Self {
        if let Some(segment) = self.segments.get_mut(spring) {
            segment.label = Some(label.into());
        }
        self
    }

    /// Draws a vector at every particle, as for an eigenvector.
    pub fn with_arrows<'a>(mut self, vectors: impl IntoIterator<Item = &'a Vector3<f64>>) -> Self {
        self.arrows = vectors.into_iter().enumerate().map(|(point, &v)| Arrow { point, vector: v.into() }).collect();
        self
    }
}
