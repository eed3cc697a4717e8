//! From space to paper.

use super::canvas::WIDTH;
use crate::figure::{Drawing, Segment, Up};

/// Free space around a drawing in pixels: badges and arrows may use it.
const BORDER: f64 = 70.0;
/// Length of the longest arrow, as a share of the sheet.
pub(super) const ARROW: f64 = 0.12;
/// The height of a drawing lies between these.
const HEIGHT: (f64, f64) = (220.0, 640.0);

/// A parallel projection of what stands upright.
#[derive(Clone, Copy)]
pub(super) struct Projection {
    up: Up,
    from: Side,
}

#[derive(Clone, Copy)]
enum Side {
    /// x to the right, y upwards.
    Front,
    /// Turned by 35° about the vertical y axis and looked at from 22° above.
    Above,
}

impl Projection {
    /// Scenes in a plane z = const are seen from the front.
    pub fn of(drawing: &Drawing) -> Self {
        let depths = drawing.points.iter().map(|&point| drawing.up.upright(point)[2]);
        let in_plane = depths.clone().zip(depths.skip(1)).all(|(a, b)| a == b);
        let from = if drawing.dimension < 3 || in_plane { Side::Front } else { Side::Above };
        Self { up: drawing.up, from }
    }

    /// Right and up, in the unit of the argument.
    pub fn apply(self, vector: [f64; 3]) -> [f64; 2] {
        let [x, y, z] = self.up.upright(vector);
        match self.from {
            Side::Front => [x, y],
            Side::Above => {
                let (turn_sin, turn_cos) = 35f64.to_radians().sin_cos();
                let (raise_sin, raise_cos) = 22f64.to_radians().sin_cos();
                let depth = x * turn_sin + z * turn_cos;
                [x * turn_cos - z * turn_sin, y * raise_cos - depth * raise_sin]
            }
        }
    }
}

/// A drawing's points on the sheet, scaled to fill it.
pub(super) struct View {
    /// Pixels that the drawing needs in height.
    pub height: i32,
    points: Vec<Option<[f64; 2]>>,
}

impl View {
    /// Places every finite point.
    pub fn of(drawing: &Drawing) -> Self {
        let projection = Projection::of(drawing);
        let finite = |p: [f64; 2]| p.iter().all(|c| c.is_finite()).then_some(p);
        let flat: Vec<Option<[f64; 2]>> = drawing.points.iter().map(|&p| finite(projection.apply(p))).collect();
        let extent = |axis: usize| {
            let bounds = (f64::INFINITY, f64::NEG_INFINITY);
            let (low, high) =
                flat.iter().flatten().fold(bounds, |(low, high), p| (low.min(p[axis]), high.max(p[axis])));
            if low <= high { (0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low) } else { (0.0, 0.0) }
        };
        // Centres and half sizes.
        let ((cx, rx), (cy, ry)) = (extent(0), extent(1));
        let border = if drawing.arrows.is_empty() { BORDER } else { ARROW * f64::from(WIDTH) + 12.0 };
        let room = (0.5 * f64::from(WIDTH) - border, 0.5 * HEIGHT.1 - border);
        let scale = (room.0 / rx).min(room.1 / ry);
        let scale = if scale.is_finite() { scale } else { 1.0 };
        let height = (2.0 * (ry * scale + border)).clamp(HEIGHT.0, HEIGHT.1).round();
        let place = |[x, y]: [f64; 2]| [0.5 * f64::from(WIDTH) + (x - cx) * scale, 0.5 * height - (y - cy) * scale];
        let points = flat.into_iter().map(|p| p.map(place).and_then(finite)).collect();
        Self { height: height as i32, points }
    }

    /// A point's place, if it exists and is finite.
    pub fn point(&self, index: usize) -> Option<[f64; 2]> {
        self.points.get(index).copied().flatten()
    }

    /// The places of a segment's ends.
    pub fn ends(&self, segment: &Segment) -> Option<[[f64; 2]; 2]> {
        let [i, j] = segment.ends;
        Some([self.point(i)?, self.point(j)?])
    }
}
