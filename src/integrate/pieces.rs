//! Steps of a fixed length, cut where prescribed paths have kinks: between kinks motions are smooth, and prescribed velocities
//! constant.

use super::Schedule;
use super::schedule::Step;
use crate::system::Prescribed;

/// Kinks within this part of a step of one of its ends are at that end.
const SLACK: f64 = 1e-12;

/// A part of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Piece {
    /// When it begins, in s.
    pub start: f64,
    /// When it ends, in s.
    pub end: f64,
    /// Whether prescribed velocities jump there.
    pub ends_at_kink: bool,
}

impl Piece {
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

/// The length of steps of `dt` seconds on the `distance` between two kinks, in a run that is compared with others, of steps up to `longest`. Where even
/// those are cut all are shorter, in proportion: else all runs would do the same there, and agree on it.
pub(super) fn in_proportion(dt: f64, distance: f64, longest: f64) -> f64 {
    dt * (distance / longest).min(1.0)
}

/// Steps of `dt` seconds [in proportion](in_proportion), from one time to another; the last before a kink or the end are shorter.
pub(crate) fn steps_between_kinks(
    prescribed: &Prescribed,
    [start, end]: [f64; 2],
    [dt, longest]: [f64; 2],
) -> impl Iterator<Item = Step> {
    let stops = std::iter::successors(Some(start), move |&from| {
        (from < end).then(|| prescribed.next_kink(from).map_or(end, |kink| kink.min(end)))
    });
    let stops: Vec<f64> = stops.collect();
    let legs: Vec<[f64; 2]> = stops.iter().zip(stops.iter().skip(1)).map(|(from, to)| [*from, *to]).collect();
    legs.into_iter().flat_map(move |[from, to]| {
        let schedule = Schedule::duration(in_proportion(dt, to - from, longest), to - from);
        (0..schedule.len()).filter_map(move |number| {
            let ends_at_kink = number + 1 == schedule.len() && to < end;
            let end = if number + 1 == schedule.len() { to } else { from + schedule.elapsed(number + 1) };
            Some(Step { dt: schedule.step(number)?, end, ends_at_kink })
        })
    })
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
    use super::{Piece, Step, steps_between_kinks};
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
            while let Some(piece) = Piece::next(system.prescribed(), at, start + step, step) {
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

    /// Kinks at 0.5 s, 1 s and 1.25 s, on the way from 0.25 s to 3 s. Where steps may be 0.75 s long, the ways of 0.25, 0.5 and 0.25 s take one
    /// of the longest steps each, and two of steps of 0.5 s, the second shorter; the last way takes steps as they are.
    #[test]
    fn steps_between_kinks_become_shorter_with_the_others() {
        let system = with_kinks();
        let steps = |dt: f64| -> Vec<Step> {
            let steps: Vec<Step> = steps_between_kinks(system.prescribed(), [0.25, 3.0], [dt, 0.75]).collect();
            let mut time = 0.25;
            for step in &steps {
                assert!((time + step.dt - step.end).abs() < 1e-15);
                assert_eq!(step.ends_at_kink, [0.5, 1.0, 1.25].contains(&step.end));
                time = step.end;
            }
            assert_eq!(time, 3.0);
            steps
        };
        let lengths = |dt: f64| steps(dt).iter().map(|step| (1e6 * step.dt).round() / 1e6).collect::<Vec<_>>();
        assert_eq!(lengths(0.75), [0.25, 0.5, 0.25, 0.75, 0.75, 0.25]);
        let [near, far] = [[0.166667, 0.083333], [0.333333, 0.166667]];
        assert_eq!(lengths(0.5), [&near[..], &far, &near, &[0.5, 0.5, 0.5, 0.25]].concat());
    }
}
