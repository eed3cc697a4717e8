//! Velocity Verlet with predicted velocities: second order, damped or not, for one force evaluation a step.
//!
//! ```text
//! v½ = v + ½h a,   x' = x + h v½,   v* = v + h a,   a' = M⁻¹ f(x', v*),   v' = v½ + ½h a'.
//! ```
//!
//! a' serves the next step. Without damping, and forces from outside, f does not depend on v*, and this is the method of Verlet (1967) in the form with
//! velocities: symplectic, time-reversible, stable for `h ≤ 2/ω_max`. With damping the force at the end would depend on the
//! velocity sought. Its prediction v* is right to O(h²), so is a', and v' to O(h³): second order still, at the price of some
//! stability: a mode of frequency ω and damping ratio ζ is stable for `hω ≤ 2(√(1 + 4ζ²) − 2ζ)`, at ζ of 0, 0.1, 0.5 and 1 for
//! 2, 1.64, 0.83 and 0.47.
//!
//! Forces at the end of a step are kept for the next. They are computed anew where the state is not the one that the last step
//! left, or where prescribed velocities, and with them damping forces, have jumped: steps are cut at the kinks of paths, which
//! keeps the order.

use super::explicit::ensure_room;
use super::propagated_error::LeadingTerm;
use super::substeps::Substep;
use super::{CompletedStep, PropagatedError, SpringVisitor, Statistics, StepFailure, TimeStepper};
use crate::error::{DegenerateSpring, Result};
use crate::force::{SpringGeometry, set_total_force};
use crate::system::{State, StateView, System};
use nalgebra::Vector3;

/// Bytes for a particle, at most.
const PARTICLE: u64 = 150;

/// Second order, one force evaluation a step; stable without damping for `dt ≤ 2/ω_max`.
///
/// # Examples
/// ```
/// use sprung::integrate::{TimeStepper, Verlet};
///
/// # use sprung::{Spring, SystemBuilder};
/// # let mut builder = SystemBuilder::new();
/// # builder.particle([0.0, 0.0, 0.0], 1.0);
/// # builder.particle([1.0, 0.0, 0.0], 1.0);
/// # builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// # builder.hold(0);
/// let (system, mut state) = builder.build()?;
/// let mut stepper = Verlet::new(&system, &state)?;
/// for _ in 0..100 {
///     stepper.step(&mut state, 0.001)?;
/// }
/// // A particle of 1 kg on 10 N/m, 1 m from rest, at t = 0.1 s.
/// let exact = 2.0 - (10.0_f64.sqrt() * 0.1).cos();
/// assert!((state.positions[1].x - exact).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(alias = "leapfrog")]
pub struct Verlet<'s> {
    system: &'s System,
    /// Whether forces may depend on velocities: of damping, or external.
    is_damped: bool,
    /// The state at which the last step ended, and where this one is.
    next: State,
    /// Whether `force` is the one there.
    knows_force: bool,
    force: Vec<Vector3<f64>>,
    /// v*; only where forces may depend on it.
    predicted: Vec<Vector3<f64>>,
    /// A displaced state and the forces there, once an error is propagated.
    displaced: Option<(State, Vec<Vector3<f64>>)>,
    statistics: Statistics,
}

impl<'s> Verlet<'s> {
    /// For a system.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; too little memory.
    pub fn new(system: &'s System, state: &State) -> Result<Self> {
        ensure_room(system, state, PARTICLE)?;
        SpringGeometry::at(system, state)?;
        Ok(Self {
            system,
            is_damped: system.is_damped() || system.has_external_forces(),
            next: state.clone(),
            knows_force: false,
            force: vec![Vector3::zeros(); system.particles()],
            predicted: vec![Vector3::zeros(); system.particles()],
            displaced: None,
            statistics: Statistics::default(),
        })
    }

    /// Sets the force at `next`, with the velocities given or predicted, in sight of who watches the end of a step of so many seconds.
    fn set_force(&mut self, at: Velocities, seen: Option<(&mut dyn SpringVisitor, f64)>) -> Result<(), StepFailure> {
        let Self { system, next, force, predicted, .. } = self;
        self.statistics.work.force_evaluations += 1;
        let velocities = match at {
            Velocities::Predicted if self.is_damped => predicted,
            _ => &next.velocities,
        };
        let moment = StateView { velocities, ..next.moment() };
        let of_any = |set: Result<(), DegenerateSpring>| StepFailure::of_any(system, set.map_err(Into::into));
        match seen {
            None => of_any(set_total_force(system, &moment, force)),
            Some((watch, dt)) if watch.computes_forces(system) => of_any(watch.set_force(&moment, dt, force)),
            Some((watch, dt)) => {
                of_any(set_total_force(system, &moment, force))?;
                watch.see(&moment, dt);
                Ok(())
            }
        }
    }

    /// Advances `next` over a piece of a step; `seen` is for its end.
    fn advance(&mut self, piece: &Substep, seen: Option<(&mut dyn SpringVisitor, f64)>) -> Result<(), StepFailure> {
        let prescribed = self.system.prescribed();
        let h = piece.length();
        if !self.knows_force {
            prescribed.set_velocities(piece.middle(), &mut self.next.velocities);
            self.set_force(Velocities::Given, None)?;
        }
        let masses = self.system.masses();
        let State { positions, velocities, .. } = &mut self.next;
        let moving = positions.iter_mut().zip(&mut *velocities).zip(self.force.iter().zip(masses));
        if self.is_damped {
            for (((x, v), (f, mass)), p) in moving.zip(&mut self.predicted) {
                let kick = f * (0.5 * h / mass);
                *v += kick;
                *x += *v * h;
                *p = *v + kick;
            }
            prescribed.set_velocities(piece.middle(), &mut self.predicted);
            self.system.halo_exchange(&mut self.predicted);
        } else {
            for ((x, v), (f, mass)) in moving {
                *v += f * (0.5 * h / mass);
                *x += *v * h;
            }
        }
        prescribed.set_positions(piece.end, positions);
        self.system.halo_exchange(positions);
        self.next.time = piece.end;
        if seen.is_some() && !self.is_damped {
            // What is prescribed, and what ghosts have, is looked at too.
            prescribed.set_velocities(piece.middle(), &mut self.next.velocities);
            self.system.halo_exchange(&mut self.next.velocities);
        }
        self.set_force(Velocities::Predicted, seen)?;
        for ((v, f), mass) in self.next.velocities.iter_mut().zip(&self.force).zip(masses) {
            *v += f * (0.5 * h / mass);
        }
        self.system.halo_exchange(&mut self.next.velocities);
        self.knows_force = !piece.ends_at_kink;
        Ok(())
    }

    /// Advances `next` over a whole step.
    fn complete(&mut self, dt: f64, mut watch: Option<&mut dyn SpringVisitor>) -> Result<(), StepFailure> {
        let (mut time, end) = (self.next.time, self.next.time + dt);
        while let Some(piece) = Substep::next(self.system.prescribed(), time, end, dt) {
            let is_last = piece.end >= end;
            let seen: Option<(&mut dyn SpringVisitor, f64)> = match &mut watch {
                Some(watch) if is_last => Some((&mut **watch, dt)),
                _ => None,
            };
            self.advance(&piece, seen)?;
            time = piece.end;
        }
        self.next.prescribe(self.system);
        StepFailure::of_any(self.system, if self.next.is_finite() { Ok(()) } else { Err(StepFailure::NonFinite) })
    }

    /// A step, in sight of who watches.
    fn go(&mut self, state: &mut State, dt: f64, watch: Option<&mut dyn SpringVisitor>) -> Result<(), StepFailure> {
        if self.next.positions != state.positions || self.next.velocities != state.velocities {
            self.knows_force = false;
            self.next.copy_from(state);
        }
        self.next.time = state.time;
        let outcome = self.complete(dt, watch);
        match outcome {
            Ok(()) => state.copy_from(&self.next),
            Err(_) => self.knows_force = false,
        }
        outcome
    }
}

/// Which velocities a force is computed with.
#[derive(Clone, Copy)]
enum Velocities {
    Given,
    Predicted,
}

impl TimeStepper for Verlet<'_> {
    fn name(&self) -> &'static str {
        "verlet"
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        StepFailure::of_arguments(self.system, state, dt)?;
        self.go(state, dt, None)
    }

    fn step_seen(&mut self, state: &mut State, dt: f64, watch: &mut dyn SpringVisitor) -> Result<(), StepFailure> {
        self.go(state, dt, Some(watch))
    }

    fn restart(&mut self) {
        self.knows_force = false;
    }

    /// The step linearised, `e½ = e_v + ½h e_a`, `e_x' = e_x + h e½`, `e_a' = M⁻¹ (K e_x' + G (e½ + ½h e_a))`, `e_v' = e½ + ½h e_a'`, the product being
    /// a difference quotient.
    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        let Self { system, is_damped, next, force, predicted, displaced, statistics, .. } = self;
        let h = step.length;
        error.set_local(system, step, LeadingTerm::VERLET);
        let each = error.positions.iter_mut().zip(&mut error.velocities);
        for (((x, v), a), local) in each.zip(&error.accelerations).zip(&error.local_positions) {
            *v += a * (0.5 * h);
            *x += *v * h + local;
        }
        // e_v*, for the product: the prediction v* itself is short of the velocity at the end by ½h² j.
        let ahead = |a: &Vector3<f64>, jerk: &Vector3<f64>| a * (0.5 * h) - jerk * (0.5 * h * h);
        let each = error.velocities.iter_mut().zip(error.accelerations.iter().zip(&error.jerk));
        each.for_each(|(v, (a, jerk))| *v += ahead(a, jerk));
        let end = displaced.get_or_insert_with(|| (next.clone(), force.clone()));
        let (at, force_at) = end;
        let epsilon = error.displace(system, next, h, at);
        let each = error.velocities.iter_mut().zip(error.accelerations.iter().zip(&error.jerk));
        each.for_each(|(v, (a, jerk))| *v -= ahead(a, jerk));
        if epsilon > 0.0 && self.knows_force {
            if *is_damped {
                // Forces are those of predicted velocities.
                for ((at, end), predicted) in at.velocities.iter_mut().zip(&next.velocities).zip(&*predicted) {
                    *at += predicted - end;
                }
            }
            statistics.work.force_evaluations += 1;
            if set_total_force(system, &at.moment(), force_at).is_ok() {
                error.set_accelerations(system, force_at, force, epsilon);
            }
        }
        let each = error.velocities.iter_mut().zip(&error.accelerations);
        for ((v, a), local) in each.zip(&error.local_velocities) {
            *v += a * (0.5 * h) + local;
        }
        true
    }

    fn statistics(&self) -> &Statistics {
        &self.statistics
    }
}

#[cfg(test)]
mod tests;
