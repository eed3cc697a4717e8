//! A sketch of a scene, and which way is up in it.

use crate::spring::Spring;
use crate::system::{State, System};
use nalgebra::Vector3;
use serde::Serialize;

/// A scene at one state: particles, springs coloured by a scalar, and what deserves a look.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    /// The title, in a few words.
    pub title: String,
    /// The conclusion, in a sentence; may be empty.
    pub conclusion: String,
    /// The name of the segments' scalar, for the colour scale.
    pub scalar: String,
    /// Number of modelled axes: 1, 2 or 3. A planar scene is drawn flat.
    pub dimension: usize,
    /// The axis that points upwards.
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
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// Indices of its end points.
    pub ends: [usize; 2],
    /// The number that colours it.
    pub scalar: f64,
    /// Why it is singled out, for example `spring 7: sign flipped`; `None` for the others.
    pub label: Option<String>,
}

/// A vector at a point of a [`Drawing`].
#[derive(Debug, Clone, Copy, PartialEq)]
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
        let segment = |(pair, spring): (&[u32; 2], &Spring)| {
            let ends = pair.map(|p| p as usize);
            let [xi, xj] = ends.map(|p| state.positions.get(p).copied().unwrap_or_default());
            let scalar = ((xi - xj).norm() - spring.rest_length) / spring.gauge_length();
            Segment { ends, scalar, label: None }
        };
        let segments = system.pairs().iter().zip(system.springs()).map(segment).collect();
        let free = |p: &usize| system.dofs().free_axes(*p).count() == system.dimension();
        let held = (0..system.particles()).filter(|p| !free(p)).collect();
        let (title, conclusion, scalar) = (title.into(), String::new(), "strain l/l₀ − 1".into());
        let (dimension, up) = (system.dimension(), Up::against(system.gravity(), system.dimension()));
        Self { title, conclusion, scalar, dimension, up, points, held, segments, arrows: Vec::new() }
    }

    /// Adds a conclusion.
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

/// The axis that points upwards in pictures: against gravity where that follows an axis of a scene in space; y elsewhere.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Up {
    /// Its number.
    pub axis: usize,
    /// 1 or −1.
    pub sign: f64,
}

impl Up {
    /// The upward axis of a scene with so many axes.
    pub fn against(gravity: Vector3<f64>, dimension: usize) -> Self {
        let axis = gravity.iamax();
        match dimension {
            3 if gravity[axis].abs() > 0.9 * gravity.norm() => Self { axis, sign: -gravity[axis].signum() },
            _ => Self { axis: 1, sign: 1.0 },
        }
    }

    /// The same vector with this axis as y, turned and not mirrored.
    pub fn upright(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = match self.axis {
            0 => [z, x, y],
            1 => [x, y, z],
            _ => [y, z, x],
        };
        if self.sign < 0.0 { [-x, -y, z] } else { [x, y, z] }
    }
}

#[cfg(test)]
mod tests {
    use super::{Drawing, Up};
    use crate::{Spring, SystemBuilder};
    use nalgebra::Vector3;

    /// From (0, 0) to (3, 4) with rest lengths of 4 m and, over 1 m, none; and of unchanged length.
    #[test]
    fn strains_are_changes_over_the_rest_length() {
        let mut builder = SystemBuilder::new();
        for position in [[0.0; 3], [3.0, 4.0, 0.0], [3.0, 0.0, 0.0]] {
            builder.particle(position, 1.0);
        }
        for (i, j, rest_length) in [(0, 1, 4.0), (1, 0, 0.0), (0, 2, 3.0)] {
            builder.spring(i, j, Spring { stiffness: 1.0, rest_length, damping: 0.0 });
        }
        builder.hold(2);
        let (system, state) = builder.build().unwrap();
        let drawing = Drawing::strains("strain", &system, &state);
        let strains: Vec<(usize, f64)> =
            drawing.segments.iter().map(|segment| (segment.ends[0], segment.scalar)).collect();
        assert_eq!(strains, [(0, 0.25), (1, 5.0), (0, 0.0)]);
        assert_eq!(drawing.held, [2]);
    }

    /// The direction against gravity points upwards, and right hands stay right.
    #[test]
    fn pictures_stand_upright() {
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                let gravity = Vector3::ith(axis, -9.81 * sign);
                let up = Up::against(gravity, 3);
                assert_eq!(up.upright((-gravity).into())[1], 9.81);
                let turned = [0, 1, 2].map(|k| Vector3::from(up.upright(Vector3::ith(k, 1.0).into())));
                assert_eq!(turned[0].cross(&turned[1]), turned[2]);
            }
        }
        let askew = Vector3::new(1.0, -1.0, 0.0);
        assert_eq!(
            [Up::against(askew, 3), Up::against(-Vector3::y(), 2), Up::against(Vector3::y(), 2)].map(|up| up.axis),
            [1; 3]
        );
    }
}
