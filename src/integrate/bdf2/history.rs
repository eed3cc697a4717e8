//! The last step, as long as it says something about the next one.
//!
//! It does not after a kink of a prescribed path: a force that follows the path has a jump in its rate there, a damping force one
//! of its own. So a step whose interior, or whose last step's interior, holds a kink, or that starts at one, has no past. Nor has a
//! step from a state that is not the one where the last step ended.

use crate::system::{Motion, State, System};

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
            Some(last) if self.ends_at(system, state, h) && !self.has_kink(state.time - last, state.time + h, h) => {
                h / last
            }
            _ => 0.0,
        }
    }

    /// Where the last step started.
    pub fn before(&self) -> &State {
        &self.before
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
        let is_same = |dof: crate::system::Dof| {
            let (p, axis) = (dof.particle, dof.axis);
            state.positions[p][axis] == after.positions[p][axis]
                && state.velocities[p][axis] == after.velocities[p][axis]
        };
        (state.time - after.time).abs() <= rounding && system.dofs().iter().all(is_same)
    }

    /// Whether a kink lies between two times and at neither of them.
    fn has_kink(&self, from: f64, to: f64, h: f64) -> bool {
        let next = self.kinks.partition_point(|&kink| kink <= from + AT * h);
        self.kinks.get(next).is_some_and(|&kink| kink < to - AT * h)
    }
}
