//! Time stepping: one method a file behind [`TimeStepper`], and the run loop that drives them.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `step`, `methods`, `newton`, `energy-balance`, `accuracy`, `stability`.

mod adaptive;
mod backward_euler;
mod bdf2;
mod dop853;
mod explicit;
mod failure;
#[cfg(test)]
mod fixtures;
mod implicit;
mod implicit_midpoint;
#[cfg(test)]
mod kinds_tests;
mod linear_tolerance;
#[cfg(test)]
mod loads_tests;
mod matrices;
mod method;
mod monitor;
mod newton;
#[cfg(test)]
mod parts_tests;
mod progressive;
mod propagated_error;
mod regularization;
mod rodas4;
mod run;
mod schedule;
#[cfg(test)]
mod steps_tests;
mod stiffness_policy;
mod substeps;
mod verlet;
mod w_method;

use adaptive::hermite;
pub use adaptive::{
    AdaptiveOptions, AdaptiveStepper, ErrorEstimate, OutputTimes, run_adaptive, run_adaptive_monitored,
};
pub use backward_euler::{BackwardEuler, LinearBackwardEuler};
pub use bdf2::Bdf2;
pub use dop853::Dop853;
pub use explicit::ExplicitEuler;
pub use failure::{NotSolved, Status, StepFailure};
pub use implicit::ImplicitOptions;
pub use implicit_midpoint::ImplicitMidpoint;
pub use matrices::{Matrices, StepMatrices};
pub use method::{Equations, Method, PositionUpdate};
pub use monitor::{
    Balance, ErrorIndicators, INACCURATE, Monitor, MonitorCheckpoint, MonitorOptions, percent, threshold,
};
pub use newton::NewtonOptions;
pub(crate) use progressive::Projection;
#[cfg(feature = "report")]
pub(crate) use propagated_error::rows;
pub use propagated_error::{CompletedStep, PropagatedError};
pub use regularization::Regularization;
pub use rodas4::Rodas4;
pub(crate) use run::Sampler;
pub use run::{Outcome, RunFailure, advance, run, run_monitored};
pub use schedule::Schedule;
pub(crate) use schedule::is_end;
pub use stiffness_policy::StiffnessPolicy;
pub use verlet::Verlet;
pub use w_method::WMethod;

use crate::error::Result;
use crate::force::SpringEnergies;
use crate::linear::LinearSolver;
use crate::memory;
use crate::system::{State, System};
use crate::work::Work;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// A method that advances a system's state.
pub trait TimeStepper {
    /// The method's name on the command line and in files.
    fn name(&self) -> &'static str;

    /// The linear solver in use; `None` for explicit methods.
    fn linear_solver(&self) -> Option<&dyn LinearSolver> {
        None
    }

    /// Advances the state by `dt` seconds.
    ///
    /// # Errors
    /// The reason why the step could not be done; the state is then unchanged.
    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure>;

    /// As [`step`](Self::step), with the energies of the springs, which a method that evaluates all springs at its end computes in the same pass.
    ///
    /// # Errors
    /// As of `step`.
    #[doc(hidden)]
    fn step_seen(&mut self, state: &mut State, dt: f64, _springs: &mut SpringEnergies<'_>) -> Result<(), StepFailure> {
        self.step(state, dt)
    }

    /// The times of kinks of gravity and rest lengths, ascending, in s. A run divides its steps there, see [`advance`].
    fn load_kinks(&self) -> &[f64] {
        &[]
    }

    /// Discards what was remembered of earlier steps: to be called where anything but a step has changed the state or its rate.
    fn restart(&mut self) {}

    /// Propagates the error of a run over the last step done or accepted, and adds the step's own: `e' = Φ e + δ`, see [`PropagatedError`].
    /// Returns `false`, and leaves the error unchanged, where the method cannot, or the error or step is one of another system.
    fn propagate(&mut self, _error: &mut PropagatedError, _step: &CompletedStep<'_>) -> bool {
        false
    }

    /// Work and quality of all steps so far.
    fn statistics(&self) -> &Statistics;
}

/// Work and quality of the steps done so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Statistics {
    /// Counters of work.
    pub work: Work,
    /// The largest `‖b − A x‖/‖b‖` of all accepted solves, recomputed from the solutions; for nonlinear methods the residual force of the equations
    /// over the forces that balance in it.
    pub max_relative_residual: f64,
    /// The largest relative residual that conjugate gradients were allowed to leave; zero where none ran.
    #[serde(default)]
    pub max_tolerance: f64,
    /// Solves of the on-demand policy in which A was indefinite and transverse terms were dropped.
    pub softened_solves: u64,
    /// Transverse terms dropped in these solves, all together.
    pub dropped_terms: u64,
    /// Steps of runs with error control that were tried and not taken.
    pub rejected_steps: u64,
    /// Accepted solves with an indefinite A (LDLᵀ under the full stiffness): such a step need not be meaningful.
    pub indefinite_solves: u64,
}

impl Statistics {
    /// Adds those of an earlier part of the same run.
    pub fn add(&mut self, other: &Self) {
        self.work.add(&other.work);
        self.record_residual(other.max_relative_residual);
        self.max_tolerance = self.max_tolerance.max(other.max_tolerance);
        self.softened_solves += other.softened_solves;
        self.dropped_terms += other.dropped_terms;
        self.rejected_steps += other.rejected_steps;
        self.indefinite_solves += other.indefinite_solves;
    }

    fn record_residual(&mut self, relative_residual: f64) {
        self.max_relative_residual = self.max_relative_residual.max(relative_residual);
    }
}

/// Refuses a state of another system, and a method that holds so many bytes for each spring and particle where there is no room for them.
fn check_room(system: &System, state: &State, bytes: [u64; 2]) -> Result<()> {
    state.check(system)?;
    ensure_room(system, bytes, "the state of the method")
}

fn ensure_room(system: &System, [spring, particle]: [u64; 2], what: &'static str) -> Result<()> {
    let [springs, particles] = [system.active_springs().len() as u64, system.particles() as u64];
    memory::ensure(spring * springs + particle * particles, what)
}

/// True if an error and a step have a row for every particle of a system.
fn fits(system: &System, error: &PropagatedError, step: &CompletedStep) -> bool {
    error.fits(system) && step.before.check(system).is_ok() && step.after.check(system).is_ok()
}

/// A sum over the particles of all parts of a system.
fn sum_of_all(system: &System, of: impl Fn(usize) -> f64) -> f64 {
    let [sum] = system.total([(0..system.own_particles()).map(of).sum()]);
    sum
}

/// Euclidean, over the particles of all parts of a system.
fn norm_of_all(system: &System, vectors: &[Vector3<f64>]) -> f64 {
    sum_of_all(system, |p| vectors[p].norm_squared()).sqrt()
}

/// `‖v‖²` of a particle's vector on its free axes.
fn free_square(system: &System, particle: usize, v: &Vector3<f64>) -> f64 {
    system.dofs().free_axes(particle).project(v).norm_squared()
}

/// Zeros the prescribed components of full-length vectors.
fn zero_prescribed(system: &System, vectors: &mut [Vector3<f64>]) {
    for (dof, ..) in system.prescribed().iter() {
        vectors[dof.particle][dof.axis] = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::Statistics;
    use crate::work::Work;

    /// Counters are added, and the larger of two maxima is kept.
    #[test]
    fn statistics_of_parts_are_added() {
        let of = |number: u64| Statistics {
            work: Work { solves: number, ..Work::default() },
            max_relative_residual: 1e-3 * number as f64,
            max_tolerance: 1e-2 * number as f64,
            softened_solves: 2 * number,
            dropped_terms: 3 * number,
            rejected_steps: 4 * number,
            indefinite_solves: 5 * number,
        };
        let (mut sum, mut other) = (of(3), of(4));
        sum.add(&of(4));
        other.add(&of(3));
        assert_eq!(sum, Statistics { max_relative_residual: 4e-3, max_tolerance: 4e-2, ..of(7) });
        assert_eq!(sum, other);
    }
}
