//! Steps of a fixed length, cut where prescribed paths have kinks: between kinks motions are smooth, and prescribed velocities
//! constant.

use crate::system::Prescribed;

/// Kinks within this part of a step of one of its ends are at that end.
const SLACK: f64 = 1e-12;

/// A part of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Substep {
    /// When it begins, in s.
    pub start: f64,
    /// When it ends, in s.
    pub end: f64,
    /// Whether prescribed velocities jump there.
    pub ends_at_kink: bool,
}

impl Substep {
    /// The first piece of what is left, from `start`, of a step of `step` seconds that ends at `end`; `None` where nothing is.
    pub fn next(prescribed: &Prescribed, start: f64, end: f64, step: f64) -> Option<Self> {
        if start >= end {
            return None;
        }
        let slack = SLACK * step;
        let kink = prescribed.next_kink(start + slack).filter(|&kink| kink <= end + slack);
        let at = kink.filter(|&kink| kink < end - slack).unwrap_or(end);
        Some(Self { start, end: at, ends_at_kink: kink.is_some() })
    }

    pub fn length(&self) -> f64 {
        self.end - self.start
    }

    /// A time at which prescribed velocities are those of the piece.
    pub fn middle(&self) -> f64 {
        0.5 * (self.start + self.end)
    }
}

/// A damped particle drawn by another that starts, turns and stops with jerks, a quarter of a second each.
#[cfg(test)]
pub(super) fn drawn_with_jerks() -> (crate::system::System, crate::system::State) {
    use crate::spring::Spring;
    use crate::system::{Axes, Constraint, Motion, SystemBuilder};
    use nalgebra::Vector3;

    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.particle([2.1, 0.0, 0.0], 1.0);
    let offsets = [[0.0, 0.0, 0.0], [0.5, 0.1, 0.0], [0.25, 0.0, 0.0]].map(Vector3::from).to_vec();
    let motion = Motion::Path { times: vec![0.25, 0.5, 0.75], offsets };
    builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
    builder.spring(0, 1, Spring { stiffness: 30.0, rest_length: 2.0, damping: 3.0 });
    builder.build().unwrap()
}

#[cfg(test)]
mod tests {
    use super::Substep;
    use crate::system::{Axes, Constraint, Motion, System, SystemBuilder};
    use nalgebra::Vector3;

    /// With kinks at 0.5 s, 1 s and 1.25 s.
    fn with_kinks() -> System {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        let times = vec![0.5, 1.0, 1.25];
        let motion = Motion::Path { offsets: vec![Vector3::zeros(); times.len()], times };
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
        builder.build().unwrap().0
    }

    #[test]
    fn steps_are_cut_at_kinks() {
        let system = with_kinks();
        let pieces = |start: f64, step: f64| {
            let (mut at, mut pieces) = (start, Vec::new());
            while let Some(piece) = Substep::next(system.prescribed(), at, start + step, step) {
                assert_eq!((piece.start, piece.middle()), (at, at + 0.5 * piece.length()));
                at = piece.end;
                pieces.push((piece.length(), piece.ends_at_kink));
            }
            pieces
        };
        assert_eq!(pieces(0.0, 0.25), [(0.25, false)]);
        assert_eq!(pieces(0.25, 0.25), [(0.25, true)]);
        assert_eq!(pieces(0.25, 1.75), [(0.25, true), (0.5, true), (0.25, true), (0.75, false)]);
        assert_eq!(pieces(0.25, 0.0), []);
        // Rounding puts no sliver between a step and a kink.
        assert_eq!(pieces(0.5 - 1e-14, 0.25).len(), 1);
        assert_eq!(pieces(0.25, 0.25 - 1e-14), [(0.5 - 1e-14 - 0.25, true)]);
        assert_eq!(pieces(0.25, 0.25 + 1e-14).len(), 1);
        assert_eq!(pieces(0.25, 0.25 + 1e-9).len(), 2);
        // What is a sliver is relative to the step.
        let step = 2f64.powi(-10);
        assert_eq!(pieces(0.5 - step, step + 2e-10).len(), 2);
        // Here the end less what counts as nothing is rounded to the very kink.
        assert_eq!(pieces(0.5 - step, step + 9.0 * 2f64.powi(-53)).len(), 1);
    }
}
