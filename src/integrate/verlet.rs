//! Velocity Verlet with predicted velocities: second order, damped or not, for one force evaluation a step.
//!
//! ```text
//! v½ = v + ½h a,   x' = x + h v½,   v* = v + h a,   a' = M⁻¹ f(x', v*),   v' = v½ + ½h a'.
//! ```
//!
//! a' serves the next step. Where f does not depend on velocities, this is the method of Verlet (1967): symplectic, time-reversible, stable for
//! `h ≤ 2/ω_max`. With damping the prediction v* is right to O(h²), so is a', and v' to O(h³): still second order. A mode of frequency ω and damping
//! ratio ζ is stable for `hω ≤ 2(√(1 + 4ζ²) − 2ζ)`.
//!
//! Forces are computed anew where the state is not the end of the last step, or where prescribed velocities have jumped: steps are cut at the kinks
//! of paths, which keeps the order.

use super::explicit::check_explicit;
use super::propagated_error::LeadingTerm;
use super::substeps::{Substep, substeps};
use super::{CompletedStep, PropagatedError, Statistics, StepFailure, TimeStepper, fits};
use crate::error::Result;
use crate::force::{SpringEnergies, set_total_force};
use crate::system::{State, StateView, System};
use nalgebra::Vector3;

/// Second order, one force evaluation a step; stable without damping for `dt ≤ 2/ω_max`.
#[doc(alias = "leapfrog")]
pub struct Verlet<'s> {
    system: &'s System,
    /// True if forces may depend on velocities: of damping, or external.
    is_damped: bool,
    /// The end of the last step, and the current state of this one.
    next: State,
    /// True if `force` is the one at `next`.
    knows_force: bool,
    force: Vec<Vector3<f64>>,
    /// v*; only where forces may depend on it.
    predicted: Vec<Vector3<f64>>,
    /// A displaced state and its forces, once an error is propagated.
    displaced: Option<(State, Vec<Vector3<f64>>)>,
    statistics: Statistics,
}

impl<'s> Verlet<'s> {
    /// A stepper for a system.
    ///
    /// # Errors
    /// Coincident ends of a spring in `state`; a state of another system; too little memory.
    pub fn new(system: &'s System, state: &State) -> Result<Self> {
        check_explicit(system, state, 150)?;
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

    /// Sets the force at `next`, with predicted velocities where it depends on them, and moves the energies of the springs there.
    fn set_force(&mut self, springs: Option<(&mut SpringEnergies, f64)>) -> Result<(), StepFailure> {
        let Self { system, next, force, predicted, .. } = self;
        self.statistics.work.force_evaluations += 1;
        let velocities = if self.is_damped { predicted } else { &next.velocities };
        let at = StateView { velocities, ..next.moment() };
        let set = match springs {
            Some((springs, dt)) => springs.set_force(system, &at, dt, force),
            None => set_total_force(system, &at, force),
        };
        StepFailure::of_any(system, set.map_err(Into::into))
    }

    /// Advances `next` over a substep, and the energies of the springs over a step of dt seconds that ends with it.
    fn advance(&mut self, substep: &Substep, springs: Option<(&mut SpringEnergies, f64)>) -> Result<(), StepFailure> {
        let prescribed = self.system.prescribed();
        let h = substep.length();
        if !self.knows_force {
            prescribed.set_velocities(substep.middle(), &mut self.next.velocities);
            self.predicted.copy_from_slice(&self.next.velocities);
            self.set_force(None)?;
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
            prescribed.set_velocities(substep.middle(), &mut self.predicted);
            self.system.halo_exchange(&mut self.predicted);
        } else {
            for ((x, v), (f, mass)) in moving {
                *v += f * (0.5 * h / mass);
                *x += *v * h;
            }
        }
        prescribed.set_positions(substep.end, positions);
        self.system.halo_exchange(positions);
        self.next.time = substep.end;
        if springs.is_some() && !self.is_damped {
            // The energies need prescribed velocities, and those of ghosts.
            prescribed.set_velocities(substep.middle(), &mut self.next.velocities);
            self.system.halo_exchange(&mut self.next.velocities);
        }
        self.set_force(springs)?;
        for ((v, f), mass) in self.next.velocities.iter_mut().zip(&self.force).zip(masses) {
            *v += f * (0.5 * h / mass);
        }
        self.system.halo_exchange(&mut self.next.velocities);
        self.knows_force = !substep.ends_at_kink;
        Ok(())
    }

    /// Advances `next` over a whole step.
    fn complete(&mut self, dt: f64, mut springs: Option<&mut SpringEnergies>) -> Result<(), StepFailure> {
        let system = self.system;
        let end = self.next.time + dt;
        for substep in substeps(system.prescribed(), self.next.time, dt) {
            let springs = springs.as_deref_mut().filter(|_| substep.end >= end).map(|springs| (springs, dt));
            self.advance(&substep, springs)?;
        }
        self.next.prescribe(system);
        StepFailure::unless_finite(system, self.next.is_finite())
    }

    fn whole_step(
        &mut self,
        state: &mut State,
        dt: f64,
        springs: Option<&mut SpringEnergies>,
    ) -> Result<(), StepFailure> {
        StepFailure::of_arguments(self.system, state, dt)?;
        if self.next.positions != state.positions || self.next.velocities != state.velocities {
            self.knows_force = false;
            self.next.copy_from(state);
        }
        self.next.time = state.time;
        let outcome = self.complete(dt, springs);
        match outcome {
            Ok(()) => state.copy_from(&self.next),
            Err(_) => self.knows_force = false,
        }
        outcome
    }
}

impl TimeStepper for Verlet<'_> {
    fn name(&self) -> &'static str {
        "verlet"
    }

    fn load_kinks(&self) -> &[f64] {
        self.system.prescribed().load_kinks()
    }

    fn step(&mut self, state: &mut State, dt: f64) -> Result<(), StepFailure> {
        self.whole_step(state, dt, None)
    }

    fn step_seen(&mut self, state: &mut State, dt: f64, springs: &mut SpringEnergies) -> Result<(), StepFailure> {
        self.whole_step(state, dt, Some(springs))
    }

    fn restart(&mut self) {
        self.knows_force = false;
    }

    /// The linearised step, `e½ = e_v + ½h e_a`, `e_x' = e_x + h e½`, `e_a' = M⁻¹ (K e_x' + G (e½ + ½h e_a))`, `e_v' = e½ + ½h e_a'`, with the
    /// product as a difference quotient.
    fn propagate(&mut self, error: &mut PropagatedError, step: &CompletedStep<'_>) -> bool {
        let Self { system, is_damped, next, force, predicted, displaced, statistics, .. } = self;
        if !fits(system, error, step) {
            return false;
        }
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
        let (at, force_at) = displaced.get_or_insert_with(|| (next.clone(), force.clone()));
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
mod tests {
    use super::*;
    use crate::integrate::{Monitor, MonitorOptions};
    use crate::spring::{Spring, SpringLaw, Tension};
    use crate::system::fixtures::{pulled_with_kinks, tethered};

    /// A particle on a spring along the first axis, of this frequency and damping ratio, away from rest by 0.1 m.
    fn oscillator(frequency: f64, ratio: f64) -> (System, State) {
        let stiffness = 2.0 * frequency * frequency;
        tethered(2.1, 1.0, Spring { stiffness, rest_length: 2.0, damping: 2.0 * ratio * frequency })
    }

    /// A force is kept for the next step, but not where the state has been changed in between, in place or in speed, nor over
    /// a step that failed, nor past a kink.
    #[test]
    fn forces_are_kept_as_long_as_they_are_right() {
        let (system, start) = oscillator(3.0, 0.2);
        let mut stepper = Verlet::new(&system, &start).unwrap();
        let mut state = start.clone();
        let mut evaluations = 0;
        let mut step = |state: &mut State, stepper: &mut Verlet, dt: f64, expected: u64| {
            let mut afresh = state.clone();
            let outcome = stepper.step(state, dt);
            evaluations += expected;
            assert_eq!(stepper.statistics().work.force_evaluations, evaluations);
            if outcome.is_ok() {
                Verlet::new(&system, state).unwrap().step(&mut afresh, dt).unwrap();
                assert!((afresh.positions[1] - state.positions[1]).norm() < 1e-4, "{afresh:?} {state:?}");
            }
            outcome
        };
        for (dt, evaluations) in [(0.01, 2), (0.01, 1), (0.02, 1)] {
            step(&mut state, &mut stepper, dt, evaluations).unwrap();
        }
        state.velocities[1].x += 0.5;
        step(&mut state, &mut stepper, 0.01, 2).unwrap();
        state.positions[1].x += 0.1;
        step(&mut state, &mut stepper, 0.01, 2).unwrap();
        stepper.restart();
        step(&mut state, &mut stepper, 0.01, 2).unwrap();
        let before = state.clone();
        assert_eq!(step(&mut state, &mut stepper, 1e300, 1), Err(StepFailure::NonFinite));
        assert_eq!(state, before);
        step(&mut state, &mut stepper, 0.01, 2).unwrap();
    }

    /// Pulls by a newton, whatever the length.
    #[derive(Debug)]
    struct Steady;

    impl SpringLaw for Steady {
        fn tension(&self, _: usize, _: &Spring, _: f64) -> Tension {
            Tension { force: 1.0, slope: 0.5 }
        }

        fn energy(&self, _: usize, _: &Spring, length: f64) -> f64 {
            length
        }
    }

    /// The energies change nothing, even where a law keeps them from computing the forces.
    #[test]
    fn energies_change_nothing() {
        let (system, start) = oscillator(5.0, 0.1);
        for system in [system.clone(), system.with_spring_law(Steady)] {
            let (mut seen, mut alone) = (start.clone(), start.clone());
            let mut steppers = [(); 2].map(|()| Verlet::new(&system, &start).unwrap());
            let mut monitor = Monitor::new(&system, &start, MonitorOptions::default()).unwrap();
            for steps in 1..=3 {
                steppers[0].step_seen(&mut seen, 0.01, monitor.springs()).unwrap();
                monitor.enter(steps, &seen, 0.01).unwrap();
                steppers[1].step(&mut alone, 0.01).unwrap();
            }
            assert_eq!(seen, alone);
        }
    }

    /// However many substeps a step has, the energies are those over the whole of it.
    #[test]
    fn a_step_has_one_pass_over_the_springs() {
        let (system, mut state) = pulled_with_kinks();
        let mut stepper = Verlet::new(&system, &state).unwrap();
        let mut energies = [(); 2].map(|()| SpringEnergies::new(&system, &state, std::iter::empty()));
        for _ in 0..2 {
            stepper.step_seen(&mut state, 0.5, &mut energies[0]).unwrap();
            let velocities = if stepper.is_damped { &stepper.predicted } else { &state.velocities };
            energies[1].see(&StateView { velocities, ..state.moment() }, 0.5);
            let [along, after] = energies.each_mut().map(|energies| energies.enter(&state, 0.5));
            assert_eq!(along, after);
        }
        assert!(stepper.statistics().work.force_evaluations > 4);
    }
}
