//! Steps of a fixed length, cut at the kinks of prescribed paths: between kinks motions are smooth, and prescribed velocities constant.

use crate::system::Prescribed;

/// A part of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Substep {
    /// In s.
    pub start: f64,
    pub end: f64,
    /// True if prescribed velocities jump at the end.
    pub ends_at_kink: bool,
}

impl Substep {
    pub fn length(&self) -> f64 {
        self.end - self.start
    }

    /// A time at which prescribed velocities are those of the substep.
    pub fn middle(&self) -> f64 {
        0.5 * (self.start + self.end)
    }
}

/// The substeps of a step of dt seconds. A kink within 10⁻¹² dt of an end of the step is at that end.
pub(super) fn substeps(prescribed: &Prescribed, mut start: f64, dt: f64) -> impl Iterator<Item = Substep> {
    let (end, slack) = (start + dt, 1e-12 * dt);
    std::iter::from_fn(move || {
        if start >= end {
            return None;
        }
        let kink = prescribed.next_kink(start + slack).filter(|&kink| kink <= end + slack);
        let cut = kink.filter(|&kink| kink < end - slack).unwrap_or(end);
        let substep = Substep { start, end: cut, ends_at_kink: kink.is_some() };
        start = cut;
        Some(substep)
    })
}

#[cfg(test)]
mod tests {
    use super::substeps;
    use crate::integrate::fixtures::scene;
    use crate::system::{Axes, Constraint, Motion};
    use nalgebra::Vector3;

    /// With kinks at 0.5 s, 1 s and 1.25 s.
    #[test]
    fn steps_are_cut_at_kinks() {
        let mut builder = scene(&[([0.0; 3], 1.0)], &[]);
        let motion = Motion::Path { times: vec![0.5, 1.0, 1.25], offsets: vec![Vector3::zeros(); 3] };
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
        let (system, _) = builder.build().unwrap();
        let cut = |start: f64, step: f64| {
            let mut end = start;
            let cut = substeps(system.prescribed(), start, step).map(|substep| {
                assert_eq!((substep.start, substep.middle()), (end, end + 0.5 * substep.length()));
                end = substep.end;
                (substep.length(), substep.ends_at_kink)
            });
            cut.collect::<Vec<_>>()
        };
        assert_eq!(cut(0.0, 0.25), [(0.25, false)]);
        assert_eq!(cut(0.25, 0.25), [(0.25, true)]);
        assert_eq!(cut(0.25, 1.75), [(0.25, true), (0.5, true), (0.25, true), (0.75, false)]);
        assert_eq!(cut(0.25, 0.0), []);
        // Rounding puts no sliver between a step and a kink.
        assert_eq!(cut(0.5 - 1e-14, 0.25).len(), 1);
        assert_eq!(cut(0.25, 0.25 - 1e-14), [(0.5 - 1e-14 - 0.25, true)]);
        assert_eq!(cut(0.25, 0.25 + 1e-14).len(), 1);
        assert_eq!(cut(0.25, 0.25 + 1e-9).len(), 2);
        // A sliver is relative to the step.
        let step = 2f64.powi(-10);
        assert_eq!(cut(0.5 - step, step + 2e-10).len(), 2);
        // The end less the slack is rounded to the very kink.
        assert_eq!(cut(0.5 - step, step + 9.0 * 2f64.powi(-53)).len(), 1);
    }
}
