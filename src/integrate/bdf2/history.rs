//! The last step, as long as it says something about the next one.
//!
//! It does not after a kink of a prescribed path: a force that follows the path has a jump in its rate there, a damping force one
//! of its own. So a step that starts at a kink, or whose interior or whose last step's interior holds one, has no past. A path that
//! has kinks in the last step and in this one is not taken by its corners: it is a curve given by points, closer than steps resolve them.
//! Nor has a step a past that starts from a state where the last one did not end.

use crate::system::{Dof, Motion, State, System};

/// How near to the end of a step, relative to the step, a kink counts as lying there.
const AT: f64 = 1e-9;

/// The last step.
pub(super) struct History {
    /// Its length, in s; `None` when there was none.
    step: Option<f64>,
    before: State,
    after: State,
    /// Of all prescribed paths, ascending, in s.
    kinks: Vec<f64>,
}

impl History {
    /// No step yet.
    pub fn new(system: &System, state: &State) -> Self {
        let times = |motion: &'_ Motion| match motion {
            Motion::Path { times, .. } => times.clone(),
            Motion::Held | Motion::Velocity(_) => Vec::new(),
        };
        let mut kinks: Vec<f64> = system.prescribed().motions().iter().flat_map(times).collect();
        kinks.sort_by(f64::total_cmp);
        kinks.dedup();
        Self { step: None, before: state.clone(), after: state.clone(), kinks }
    }

    /// ω of a step of h seconds from a state: its ratio to the last step, or zero where that says nothing about it.
    pub fn ratio(&self, system: &System, state: &State, h: f64) -> f64 {
        match self.step {
            Some(last) if self.ends_at(system, state, h) && !self.is_broken(state.time, last, h) => h / last,
            _ => 0.0,
        }
    }

    /// Whether a kink parts the step of h seconds from time t from the last one.
    fn is_broken(&self, t: f64, last: f64, h: f64) -> bool {
        let tolerance = AT * h.min(last);
        // Whether there is one from a time on and before another.
        let between = |from: f64, to: f64| {
            let next = self.kinks.partition_point(|&kink| kink < from);
            self.kinks.get(next).is_some_and(|&kink| kink < to)
        };
        let now = between(t - tolerance, t + h - tolerance);
        let before = between(t - last - tolerance, t - tolerance);
        let inside = between(t - last + tolerance, t - tolerance);
        (now || inside) && !(now && before)
    }

    /// The length of the last step, in s.
    pub fn length(&self) -> Option<f64> {
        self.step
    }

    /// Where the last step started.
    pub fn before(&self) -> &State {
        &self.before
    }

    /// Says that what comes has no past.
    pub fn forget(&mut self) {
        self.step = None;
    }

    /// Takes note of a step of h seconds between two states.
    pub fn record(&mut self, before: &State, after: &State, h: f64) {
        self.step = Some(h);
        self.before.copy_from(before);
        self.after.copy_from(after);
    }

    /// Whether a state is where the last step ended. Its time may have been rounded otherwise, and prescribed coordinates with it.
    fn ends_at(&self, system: &System, state: &State, h: f64) -> bool {
        let after = &self.after;
        let rounding = AT * h + 4.0 * f64::EPSILON * state.time.abs();
        let is_same = |dof: Dof| {
            let (p, axis) = (dof.particle, dof.axis);
            state.positions[p][axis] == after.positions[p][axis]
                && state.velocities[p][axis] == after.velocities[p][axis]
        };
        (state.time - after.time).abs() <= rounding && system.dofs().iter().all(is_same)
    }
}

#[cfg(test)]
mod tests {
    use super::{AT, History};
    use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
    use nalgebra::Vector3;

    /// A free particle and one on a path with kinks at the given times.
    fn led(times: &[f64]) -> (System, State) {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.0, 0.0, 0.0], 1.0);
        let motion = Motion::Path { times: times.to_vec(), offsets: vec![Vector3::zeros(); times.len()] };
        builder.constrain(Constraint { particles: vec![1], axes: Axes::ALL, motion });
        builder.build().unwrap()
    }

    /// The ratio of a step of `h` from time t after one of `last`, on a path with the given kinks.
    fn ratio(kinks: &[f64], t: f64, last: f64, h: f64) -> f64 {
        let (system, start) = led(kinks);
        let (before, after) = (State { time: t - last, ..start.clone() }, State { time: t, ..start });
        let mut history = History::new(&system, &before);
        assert_eq!(history.ratio(&system, &before, last), 0.0);
        history.record(&before, &after, last);
        history.ratio(&system, &after, h)
    }

    #[test]
    fn the_ratio_is_that_to_the_last_step() {
        assert_eq!(ratio(&[99.0], 1.0, 0.5, 0.25), 0.5);
        assert_eq!(ratio(&[99.0], 1.0, 0.5, 1.0), 2.0);
    }

    /// The last step is from 1 to 1.5, this one to 2.
    #[test]
    fn steps_after_kinks_have_no_past() {
        for (kink, has_past) in
            [(0.9, true), (1.0, true), (1.1, false), (1.5, false), (1.9, false), (2.0, true), (2.1, true)]
        {
            assert_eq!(ratio(&[kink], 1.5, 0.5, 0.5) > 0.0, has_past, "{kink}");
        }
    }

    /// How near to the end of a step counts as there is relative to the shorter step. What was before the last step is forgotten.
    #[test]
    fn kinks_near_the_end_of_a_step_are_within_it() {
        let short = 2f64.powi(-10);
        assert_eq!(ratio(&[1.5 + short - 1e-7], 1.5, short, short), 0.0);
        assert_eq!(ratio(&[1.5 + short - 1e-13], 1.5, short, short), 1.0);
        assert_eq!(ratio(&[0.2, 1.7], 1.5, 0.5, 0.5), 0.0);
        // As near to the start as counts is within, as near to the end is not.
        assert_eq!(ratio(&[1.5 - 0.5 * AT], 1.5, 0.5, 0.5), 0.0);
        assert_eq!(ratio(&[1.5 + 0.5 - 0.5 * AT], 1.5, 0.5, 0.5), 1.0);
    }

    #[test]
    fn curves_of_many_points_have_no_kinks() {
        for points in [&[1.0, 1.5, 2.0][..], &[1.1, 1.6], &[1.1, 1.2, 1.3, 1.7]] {
            assert_eq!(ratio(points, 1.5, 0.5, 0.5), 1.0, "{points:?}");
        }
        assert_eq!(ratio(&[1.1, 1.2, 2.3], 1.5, 0.5, 0.5), 0.0);
    }

    /// Another place, speed or time of a free particle; times may have been rounded, and prescribed places with them.
    #[test]
    fn the_past_ends_where_the_state_was_changed() {
        let (system, before) = led(&[99.0]);
        let after = State { time: 1e3, ..before.clone() };
        let mut history = History::new(&system, &before);
        history.record(&before, &after, 0.5);
        let ratio = |change: &dyn Fn(&mut State)| {
            let mut state = after.clone();
            change(&mut state);
            history.ratio(&system, &state, 0.5)
        };
        assert_eq!(ratio(&|state| state.positions[1].x += 1e-9), 1.0);
        assert_eq!(ratio(&|state| state.time += 2e-10), 1.0);
        assert_eq!(ratio(&|state| state.time += 1e-8), 0.0);
        assert_eq!(ratio(&|state| state.positions[0].z += 1e-9), 0.0);
        assert_eq!(ratio(&|state| state.velocities[0].y += 1e-9), 0.0);
        // Rounding of a millisecond's step and of a time of a quarter of an hour: 1.0e-12 s and 0.9e-12 s.
        let later = |by: f64| history.ratio(&system, &State { time: 1e3 + by, ..after.clone() }, 2f64.powi(-10));
        assert!(later(1.6e-12) > 0.0 && later(2.5e-12) == 0.0 && later(1e-9) == 0.0);
    }
}
