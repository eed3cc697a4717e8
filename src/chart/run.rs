//! One run: what it costs, and its errors at the end against the reference.

use super::{Deadline, Reference};
use crate::accuracy::{Configuration, StepControl, relative_position_error, trial};
use crate::error::Result;
use crate::force::{Energy, angular_momentum};
use crate::integrate::Status;
use crate::linear::CostModel;
use crate::system::{State, System};
use crate::work::Work;
use nalgebra::Vector3;
use serde::Serialize;
use std::time::Duration;

/// An error above this is no result: the run counts as failed.
pub const LARGEST_ERROR: f64 = 1.0;

/// One run of the sweep.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Run {
    /// The method's name.
    pub method: &'static str,
    /// The stiffness policy's name; `none` for a method without matrices.
    pub stiffness: &'static str,
    /// The linear solver used; `none` for a method without matrices.
    pub solver: &'static str,
    /// Tolerance of conjugate gradients; `None` for other solvers.
    pub tolerance: Option<f64>,
    /// Relative tolerance of adaptive steps; `None` for steps of one length.
    pub rtol: Option<f64>,
    /// Time step, in s; of adaptive steps the mean.
    pub dt: f64,
    /// The status at its end.
    pub status: Status,
    /// The message of the failure.
    pub failure: Option<String>,
    /// The [relative position error](relative_position_error) at the end time; `None` for a run that did not get there.
    pub error: Option<f64>,
    /// Other errors at the end time.
    pub quality: Option<Quality>,
    /// The shortest of `repeats` repetitions after a first one, in s; of the first where there was time for no other.
    pub wall_seconds: f64,
    /// Repetitions after the first.
    pub repeats: u32,
    /// The work done, the same on any machine.
    pub work: Work,
    /// The [cost](CostModel) of the work, in force evaluations.
    pub cost: f64,
}

impl Run {
    /// The method's name, `w2, adaptive` where its steps are: what a person chooses first.
    pub fn variant(&self) -> String {
        format!("{}{}", self.method, if self.rtol.is_some() { ADAPTIVE } else { "" })
    }

    /// Its steps, in words.
    pub fn step_control(&self) -> String {
        match self.rtol {
            Some(rtol) => format!("adaptive steps, rtol = {}", short(rtol)),
            None => format!("dt = {} s", short(self.dt)),
        }
    }

    /// The error of a run that completed with one below [`LARGEST_ERROR`].
    pub fn useful_error(&self) -> Option<f64> {
        self.error.filter(|error| *error < LARGEST_ERROR)
    }

    /// Why a run has no useful error, in a word or two.
    pub fn cause(&self) -> Option<String> {
        match self.error {
            _ if self.useful_error().is_some() => None,
            Some(_) => Some("error above 100 %".into()),
            None => Some(self.status.name().replace('-', " ")),
        }
    }
}

/// Errors of a final state against the reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quality {
    /// The [relative position error](relative_position_error).
    pub error: f64,
    /// `(E − Ê)/s`: total energy above that of the reference, over the energy s that the motion exchanges.
    pub energy_drift: f64,
    /// `‖Σ m x × v − Σ m x̂ × v̂‖ / Σ m ‖x̂ − c‖ ‖v̂‖`, both about the centroid c of the reference.
    pub angular_momentum_drift: f64,
}

impl Quality {
    /// The errors of a state against the reference at the same time. s is the kinetic and elastic energy of the reference at its end and at
    /// the start, and the gravitational energy between.
    pub fn of(system: &System, state: &State, reference: &State, start: &State) -> Self {
        let [energy, ideal, initial] = [state, reference, start].map(|state| Energy::of(system, state));
        let stored = (ideal.kinetic + ideal.elastic) + (initial.kinetic + initial.elastic);
        let exchanged = stored + (ideal.gravitational - initial.gravitational).abs();
        let centroid = reference.positions.iter().sum::<Vector3<f64>>() / reference.positions.len().max(1) as f64;
        let about = |state: &State| {
            let positions = state.positions.iter().map(|x| x - centroid).collect();
            angular_momentum(system, &State { positions, ..state.clone() })
        };
        let momenta = system.masses().iter().zip(&reference.velocities).map(|(m, v)| m * v.norm());
        let turning: f64 = momenta.zip(&reference.positions).map(|(p, x)| p * (x - centroid).norm()).sum();
        let angular = (about(state) - about(reference)).norm();
        let relative = |difference: f64, scale: f64| if difference == 0.0 { 0.0 } else { difference / scale };
        Self {
            error: relative_position_error(&state.positions, &reference.positions, &start.positions),
            energy_drift: relative(energy.total() - ideal.total(), exchanged),
            angular_momentum_drift: relative(angular, turning),
        }
    }
}

pub(super) struct Bench<'s> {
    pub system: &'s System,
    pub start: &'s State,
    pub duration: f64,
    pub reference: &'s Reference,
    pub costs: CostModel,
}

impl Bench<'_> {
    /// Runs and measures; `None` when the deadline came first.
    pub fn measure(
        &self,
        configuration: &Configuration,
        control: StepControl,
        deadline: Deadline,
    ) -> Result<Option<Run>> {
        let in_time = || deadline.allows(Duration::ZERO);
        let once = || trial(self.system, self.start, configuration, control, self.duration, &in_time);
        let first = once()?;
        if first.status == Status::Interrupted {
            return Ok(None);
        }
        // The first run warms the caches up; the noise of a long one is small against its length.
        let mut again = Vec::new();
        while first.wall < Duration::from_millis(100) && again.len() < 3 && deadline.allows(first.wall) {
            again.push(once()?.wall);
        }
        let completed = first.status == Status::Completed;
        let quality = completed.then(|| Quality::of(self.system, &first.state, &self.reference.state, self.start));
        let work = first.statistics.work;
        let (dt, rtol) = match control {
            StepControl::Step(dt) => (dt, None),
            StepControl::Adaptive { rtol, .. } => (self.duration / first.steps.max(1) as f64, Some(rtol)),
        };
        let iterates = configuration.method.is_implicit() && work.factorizations == 0;
        Ok(Some(Run {
            method: configuration.method.name(),
            stiffness: configuration.stiffness(),
            solver: first.solver,
            tolerance: iterates.then_some(configuration.options.linear.tolerance.strictest()),
            rtol,
            dt,
            status: first.status,
            failure: first.failure.map(|failed| failed.failure.to_string()),
            error: quality.map(|quality| quality.error),
            quality,
            wall_seconds: again.iter().min().unwrap_or(&first.wall).as_secs_f64(),
            repeats: again.len() as u32,
            work,
            cost: self.costs.cost(&work, first.factor),
        }))
    }
}

/// The suffix of the name of a method whose steps adapt.
pub(super) const ADAPTIVE: &str = ", adaptive";

pub(super) fn short(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e7).contains(&size) {
        return format!("{value:.1e}");
    }
    let digits = (2.0 - size.max(1e-300).log10().floor()).clamp(0.0, 12.0) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Spring, SystemBuilder};

    /// Two particles of 1 and 3 kg, 2 m apart on a spring at rest, that turn about their middle at 1 rad/s; the run turns 10 % too fast. By hand:
    /// energies ½ Σ m v² = 2 and 2.42 J, of which 4 J are exchanged; angular momenta Σ m r v = 4 and 4.4 kg·m²/s.
    #[test]
    fn errors_are_relative_to_what_moves() {
        let mut builder = SystemBuilder::new();
        builder.particle([5.0, -1.0, 0.0], 1.0);
        builder.particle([5.0, 1.0, 0.0], 3.0);
        builder.spring(0, 1, Spring { stiffness: 7.0, rest_length: 2.0, damping: 0.0 });
        let (system, mut start) = builder.build().unwrap();
        start.velocities = vec![Vector3::x(), -Vector3::x()];
        let mut fast = start.clone();
        fast.velocities.iter_mut().for_each(|v| *v *= 1.1);
        let quality = Quality::of(&system, &fast, &start, &start);
        assert_eq!(quality.error, 0.0);
        assert!((quality.energy_drift - 0.42 / 4.0).abs() < 1e-12, "{quality:?}");
        assert!((quality.angular_momentum_drift - 0.1).abs() < 1e-12, "{quality:?}");
        fast.positions[1].z = 0.2;
        assert!(Quality::of(&system, &fast, &start, &start).error > 0.1);
    }
}
