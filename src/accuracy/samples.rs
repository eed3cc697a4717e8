//! The times at which runs are seen, whatever their steps, so that they can be recorded and compared.

use super::course::most_samples;
use crate::integrate::{hermite, is_end};
use crate::system::{State, System};
use std::ops::ControlFlow;

/// The times at which runs are seen: multiples of a spacing, and the end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    pub spacing: f64,
    /// Of these every so many are recorded, and every so many kept to compare runs by.
    pub recorded: u64,
    pub compared: u64,
}

/// A run is compared in at least so many places.
const FEWEST: f64 = 16.0;

impl Grid {
    pub fn new(duration: f64, interval: f64, particles: usize) -> Self {
        let recorded = (FEWEST * interval / duration).ceil().max(1.0);
        let spacing = interval / recorded;
        let samples = (duration / spacing).ceil();
        let compared = (samples / most_samples(particles) as f64).ceil().max(1.0);
        Self { spacing, recorded: recorded as u64, compared: compared as u64 }
    }
}

/// States between the steps of a fixed length.
pub(super) struct Between {
    spacing: f64,
    dt: f64,
    start: f64,
    count: u64,
    /// The last state before the next time to be seen, where that is needed.
    before: State,
    sample: State,
}

impl Between {
    pub fn new(spacing: f64, dt: f64, start: &State) -> Self {
        Self { spacing, dt, start: start.time, count: 0, before: start.clone(), sample: start.clone() }
    }

    fn next(&self) -> f64 {
        self.start + (self.count + 1) as f64 * self.spacing
    }

    pub fn see(
        &mut self,
        system: &System,
        state: &State,
        end: f64,
        mut observe: impl FnMut(u64, &State) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let ends = state.time >= end;
        while self.next() <= state.time && !(ends && is_end(self.next(), [self.start, end])) {
            let time = self.next();
            hermite(&self.before, state, time, &mut self.sample);
            self.sample.time = time;
            self.sample.prescribe(system);
            self.count += 1;
            observe(self.count, &self.sample)?;
        }
        if ends {
            self.count += 1;
            return observe(self.count, state);
        }
        if self.next() <= state.time + 2.0 * self.dt {
            self.before.copy_from(state);
        }
        ControlFlow::Continue(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_record_as_asked_and_compare_often_enough() {
        let grid = Grid::new(1.0, 0.01, 10);
        assert_eq!(grid, Grid { spacing: 0.01, recorded: 1, compared: 2 });
        let grid = Grid::new(1.0, 0.25, 10);
        assert_eq!(grid, Grid { spacing: 0.0625, recorded: 4, compared: 1 });
        let grid = Grid::new(2.0, 5.0, 10);
        assert_eq!((grid.spacing, grid.compared), (0.125, 1));
    }

    /// Steps of 0.3 s on a parabola, seen every 0.25 s: cubic polynomials meet it.
    #[test]
    fn states_between_steps_are_interpolated() {
        let mut builder = crate::SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        let (system, start) = builder.build().unwrap();
        let at = |time: f64| State {
            time,
            positions: vec![nalgebra::Vector3::new(time * time, 0.0, 0.0)],
            velocities: vec![nalgebra::Vector3::new(2.0 * time, 0.0, 0.0)],
        };
        let mut between = Between::new(0.25, 0.3, &start);
        let mut seen = Vec::new();
        for step in 1..=4 {
            let time = if step == 4 { 1.0 } else { 0.3 * f64::from(step) };
            let flow = between.see(&system, &at(time), 1.0, |number, state| {
                seen.push((number, state.time));
                assert!((state.positions[0].x - state.time * state.time).abs() < 1e-15);
                ControlFlow::Continue(())
            });
            assert!(flow.is_continue());
        }
        assert_eq!(seen, [(1, 0.25), (2, 0.5), (3, 0.75), (4, 1.0)]);
    }

    /// Every spacing of 2.5 s, in steps of 3 s on a curve that no cubic polynomial meets: between the ends of the step that it lies in.
    #[test]
    fn states_are_interpolated_within_the_step() {
        let mut builder = crate::SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        let (system, start) = builder.build().unwrap();
        let at = |time: f64| State {
            time,
            positions: vec![nalgebra::Vector3::new(time.powi(4), 0.0, 0.0)],
            velocities: vec![nalgebra::Vector3::new(4.0 * time.powi(3), 0.0, 0.0)],
        };
        let mut between = Between::new(2.5, 3.0, &start);
        let mut seen = Vec::new();
        for step in 1..=5 {
            let (before, after) = (at(3.0 * f64::from(step - 1)), at(3.0 * f64::from(step)));
            let mut expected = start.clone();
            let flow = between.see(&system, &after, 15.0, |_, state| {
                hermite(&before, &after, state.time, &mut expected);
                assert_eq!(state.positions, expected.positions, "{}", state.time);
                seen.push(state.time);
                ControlFlow::Continue(())
            });
            assert!(flow.is_continue());
        }
        assert_eq!(seen, [2.5, 5.0, 7.5, 10.0, 12.5, 15.0]);
    }

    /// A time that lies a hundred-thousandth of the spacing before the end is one of its own; in steps of seconds too.
    #[test]
    fn samples_are_all_seen_whatever_the_unit() {
        let mut builder = crate::SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        let (system, start) = builder.build().unwrap();
        for (unit, end) in [(1e-3, 2.00001), (10.0, 2.0)] {
            let at = |time: f64| State {
                time,
                positions: vec![nalgebra::Vector3::new(time * time, 0.0, 0.0)],
                velocities: vec![nalgebra::Vector3::new(2.0 * time, 0.0, 0.0)],
            };
            let mut between = Between::new(0.25 * unit, 0.3 * unit, &start);
            let mut seen = 0;
            for step in 1..=7 {
                let time = unit * if step == 7 { end } else { 0.3 * f64::from(step) };
                let flow = between.see(&system, &at(time), unit * end, |number, state| {
                    seen = number;
                    let error = state.positions[0].x - state.time * state.time;
                    assert!(error.abs() < 1e-12 * unit * unit, "{number}: {error:e}");
                    ControlFlow::Continue(())
                });
                assert!(flow.is_continue());
            }
            assert_eq!(seen, if end > 2.0 { 9 } else { 8 });
        }
    }
}
