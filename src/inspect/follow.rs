//! Following a run: what it loses first, and after how many steps.
//!
//! What holds at one state does not hold at the next: springs become taut, slack or fast. A [`Follower`] looks at state after
//! state and remembers where each of four things was lost first: that A is [definite](DefinitenessWatch), that the step is
//! [stable](Property::Stable), that it does not [turn](Turn) springs too far, and that energy only comes from
//! work, by the [ledger](Monitor). The first three are properties of a state, known before the step that goes wrong; the last is what a wrong step leaves.

use super::definiteness_watch::{DefinitenessWatch, Loss};
use super::matrix_pencil::Property;
use super::rotation_limit::Turn;
use crate::error::Result;
use crate::force::{DegenerateSpring, Energy, SpringGeometry};
use crate::integrate::{ErrorIndicators, Monitor, MonitorOptions};
use crate::spring::Stiffness;
use crate::system::{State, System};
use faer::Par;
use nalgebra::Vector3;

/// A point of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Passed {
    /// Steps done.
    pub step: u64,
    /// The time, in s.
    pub time: f64,
}

/// Energy that came from nowhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gain {
    /// What was gained since the energy not accounted for by work and damping was lowest, in J: nothing that is passive gains any.
    pub gained: f64,
    /// What the motion has exchanged until then, in J.
    pub exchanged: f64,
}

/// What a run lost first, each where it did.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FirstLosses {
    /// A is not positive definite.
    pub definite: Option<Loss>,
    /// A is, but the step is longer than the largest stable one. Looked for under `Axial` only: the other options
    /// lose definiteness first, or nothing.
    pub stable: Option<Passed>,
    /// The step has turned a spring too far.
    pub turning: Option<(Passed, Turn)>,
    /// Energy has appeared from nowhere.
    pub energy: Option<(Passed, Gain)>,
}

impl FirstLosses {
    /// The first step after which anything was lost.
    pub fn first(&self) -> Option<u64> {
        let steps = [
            self.definite.as_ref().map(|loss| loss.step),
            self.stable.map(|passed| passed.step),
            self.turning.map(|(passed, _)| passed.step),
            self.energy.map(|(passed, _)| passed.step),
        ];
        steps.into_iter().flatten().min()
    }
}

/// A tenth of the energy exchanged counts as a gain: methods that keep energy on average let it swing by a few per cent.
const GAIN: f64 = 0.1;

/// Rounding of the energies themselves is no gain: sums over springs, each of a difference of lengths.
const ROUNDING: f64 = 1e-10;

/// How far sums of these energies may be wrong, in J.
fn rounding(now: Energy, initial: Energy) -> f64 {
    ROUNDING * (now.kinetic + now.elastic + now.gravitational.abs() + initial.gravitational.abs())
}

/// Looks at the states of a run, for one option and one step length.
pub struct Follower<'s> {
    system: &'s System,
    option: Stiffness,
    dt: f64,
    definiteness: DefinitenessWatch<'s>,
    stability: Option<DefinitenessWatch<'s>>,
    /// The state looked at last, and where its springs were.
    before: Vec<Vector3<f64>>,
    extensions: SpringGeometry,
    monitor: Monitor<'s>,
    first: FirstLosses,
}

impl<'s> Follower<'s> {
    /// Looks at the state from which a run starts with steps of length dt, in s.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large.
    pub fn new(system: &'s System, start: &State, option: Stiffness, dt: f64, par: Par) -> Result<Self> {
        let mut follower = Self {
            system,
            option,
            dt,
            definiteness: DefinitenessWatch::new(system, start, option, dt, par)?,
            stability: match option {
                Stiffness::Axial => Some(DefinitenessWatch::of(Property::Stable, system, start, option, dt, par)?),
                Stiffness::Full | Stiffness::Tension => None,
            },
            before: start.positions.clone(),
            extensions: SpringGeometry::at(system, start)?,
            monitor: Monitor::new(system, start, MonitorOptions { stops_unstable: false, ..MonitorOptions::ENERGY })?,
            first: FirstLosses::default(),
        };
        follower.look_at(0, start)?;
        Ok(follower)
    }

    /// Looks at the next state, after so many steps.
    ///
    /// # Errors
    /// Coincident ends of a spring.
    pub fn look(&mut self, step: u64, state: &State) -> Result<(), DegenerateSpring> {
        let passed = Passed { step, time: state.time };
        if self.first.turning.is_none() {
            let moved: Vec<_> = state.positions.iter().zip(&self.before).map(|(x, before)| x - before).collect();
            let worst = Turn::worst(self.system, &self.extensions, &moved, self.dt, self.option);
            self.first.turning = worst.filter(|turn| turn.excess() > 1.0).map(|turn| (passed, turn));
            self.before.clone_from(&state.positions);
            self.extensions.update(self.system, state)?;
        }
        if self.first.energy.is_none() {
            // It ends no run that was not asked to: what it finds is looked at here.
            let _ = self.monitor.enter(step, state, self.dt);
            self.first.energy = self.gain(state).map(|gain| (passed, gain));
        }
        self.look_at(step, state)
    }

    /// What energy has been gained, where it is worth a word.
    fn gain(&self, state: &State) -> Option<Gain> {
        let ErrorIndicators { gained, exchanged, .. } = self.monitor.indicators(state);
        let rounding = rounding(self.monitor.energy(), self.monitor.initial());
        // A NaN is a gain too: it did not come from a passive scene.
        let kept = gained <= GAIN * exchanged || gained <= rounding;
        (!kept).then_some(Gain { gained, exchanged })
    }

    /// What depends on the state alone.
    fn look_at(&mut self, step: u64, state: &State) -> Result<(), DegenerateSpring> {
        if self.first.definite.is_none() {
            self.first.definite = self.definiteness.look(step, state)?;
        }
        if let (None, Some(watch)) = (self.first.stable, &mut self.stability) {
            let stable = watch.holds(state)?;
            self.first.stable = (!stable).then_some(Passed { step, time: state.time });
        }
        Ok(())
    }

    /// What has been lost until now.
    pub fn first_losses(&self) -> &FirstLosses {
        &self.first
    }
}

#[cfg(test)]
mod tests {
    use super::{Energy, rounding};

    /// 10⁻¹⁰ of all of them, whatever their signs.
    #[test]
    fn rounding_is_that_of_the_sum_of_sizes() {
        let energy = |kinetic, elastic, gravitational| Energy { kinetic, elastic, gravitational };
        let found = rounding(energy(1.0, 20.0, -300.0), energy(7.0, 9.0, -4000.0));
        assert!((found / 4321e-10 - 1.0).abs() < 1e-12, "{found}");
        let found = rounding(energy(1.0, 20.0, 300.0), energy(7.0, 9.0, 4000.0));
        assert!((found / 4321e-10 - 1.0).abs() < 1e-12, "{found}");
    }
}
