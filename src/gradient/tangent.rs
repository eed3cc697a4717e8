//! Changes of the states of a run, from its start to its end.

use super::jacobian::Jacobian;
use super::{DifferentiableRun, Parameters, Point, Record, Scheme};
use crate::error::Result;
use crate::system::State;
use nalgebra::Vector3;

/// The way forwards of a change.
pub(super) struct Tangent<'r, 's> {
    pub(super) run: &'r DifferentiableRun<'s>,
    pub(super) change: &'r Parameters,
    pub(super) positions: Vec<Vector3<f64>>,
    pub(super) velocities: Vec<Vector3<f64>>,
    pub(super) accelerations: Vec<Vector3<f64>>,
    pub(super) before: [Vec<Vector3<f64>>; 2],
}

impl<'r, 's> Tangent<'r, 's> {
    pub(super) fn new(
        run: &'r DifferentiableRun<'s>,
        change: &'r Parameters,
        first: &Record,
        jacobian: &mut Jacobian<'s>,
    ) -> Result<Self> {
        let system = run.system;
        let free = |p: usize, axis: usize| system.dofs().free_axes(p).contains(axis);
        let velocities = change.velocities.iter().enumerate();
        let velocities: Vec<_> =
            velocities.map(|(p, v)| Vector3::from_fn(|axis, _| if free(p, axis) { v[axis] } else { 0.0 })).collect();
        let mut tangent = Self {
            run,
            change,
            before: [change.positions.clone(), velocities.clone()],
            positions: change.positions.clone(),
            accelerations: Vec::new(),
            velocities,
        };
        if run.scheme == Scheme::Verlet {
            let (x, v) = (tangent.positions.clone(), tangent.velocities.clone());
            tangent.accelerations =
                tangent.acceleration_change(&first.state, &first.acceleration, [&x, &v], jacobian)?;
        }
        Ok(tangent)
    }

    /// δ(M⁻¹F) for changes of positions, velocities and parameters.
    pub(super) fn acceleration_change(
        &self,
        at: &State,
        acceleration: &[Vector3<f64>],
        [x, v]: [&[Vector3<f64>]; 2],
        jacobian: &mut Jacobian<'s>,
    ) -> Result<Vec<Vector3<f64>>> {
        let Self { run, change, .. } = self;
        let system = run.system;
        jacobian.geometry.update(system, at)?;
        jacobian.velocities.clone_from(&at.velocities);
        let mut force = jacobian.stiffness_change(x);
        force.iter_mut().zip(jacobian.damping(v)).for_each(|(f, damped)| *f += damped);
        change.add_force_change(
            system,
            &Point { geometry: &jacobian.geometry, velocities: &at.velocities, time: at.time },
            &mut force,
        );
        for (p, f) in force.iter_mut().enumerate() {
            let free = system.dofs().free_axes(p);
            let total = (*f - acceleration[p] * change.masses[p]) / system.masses()[p];
            *f = Vector3::from_fn(|axis, _| if free.contains(axis) { total[axis] } else { 0.0 });
        }
        Ok(force)
    }

    /// One step. The Jacobian is linearised there by the first of several changes.
    pub(super) fn step(
        &mut self,
        step: usize,
        before: Option<&Record>,
        [here, next]: [&Record; 2],
        jacobian: &mut Jacobian<'s>,
        is_first: bool,
    ) -> Result<()> {
        self.run.check_interrupt(step, here.state.time)?;
        let (system, h) = (self.run.system, self.run.lengths[step]);
        let particles = system.particles();
        let is_free = |p: usize, axis: usize| system.dofs().free_axes(p).contains(axis);
        if self.run.scheme == Scheme::Verlet {
            let mut predicted = next.state.clone();
            let (mut x, mut v) = (self.positions.clone(), self.velocities.clone());
            for p in 0..particles {
                for axis in system.dofs().free_axes(p).iter() {
                    predicted.velocities[p][axis] = here.state.velocities[p][axis] + h * here.acceleration[p][axis];
                    let (dv, da) = (self.velocities[p][axis], self.accelerations[p][axis]);
                    x[p][axis] += h * (dv + 0.5 * h * da);
                    v[p][axis] = dv + h * da;
                }
            }
            let after = self.acceleration_change(&predicted, &next.acceleration, [&x, &v], jacobian)?;
            for ((v, before), after) in self.velocities.iter_mut().zip(&self.accelerations).zip(&after) {
                *v += (before + after) * (0.5 * h);
            }
            (self.positions, self.accelerations) = (x, after);
            return Ok(());
        }
        let Self { run, change, .. } = self;
        let [tau, beta] = run.core(step);
        let base = run.base(step, before, &here.state);
        let solved = run.solved(step, &base, &here.state, &next.state);
        if is_first {
            jacobian.set(&solved, tau)?;
        }
        // Changes of (x̃, ṽ).
        let ahead = |now: &[Vector3<f64>], before: &[Vector3<f64>]| -> Vec<_> {
            now.iter().zip(before).map(|(now, before)| now + (now - before) * beta).collect()
        };
        let (x, v) = (ahead(&self.positions, &self.before[0]), ahead(&self.velocities, &self.before[1]));
        let held: Vec<_> = (0..particles)
            .map(|p| Vector3::from_fn(|axis, _| if is_free(p, axis) { 0.0 } else { self.positions[p][axis] }))
            .collect();
        let mut force = jacobian.stiffness_change(&held);
        change.add_force_change(
            system,
            &Point { geometry: &jacobian.geometry, velocities: &solved.velocities, time: solved.time },
            &mut force,
        );
        let free: Vec<_> = x
            .iter()
            .enumerate()
            .map(|(p, x)| Vector3::from_fn(|axis, _| if is_free(p, axis) { x[axis] } else { 0.0 }))
            .collect();
        let damped = jacobian.damping(&free);
        for p in 0..particles {
            let (mass, more) = (system.masses()[p], change.masses[p]);
            let inertia = (solved.positions[p] - base.positions[p] - base.velocities[p] * tau) / (tau * tau);
            force[p] += free[p] * (mass / (tau * tau)) - damped[p] / tau + v[p] * (mass / tau) - inertia * more;
        }
        let mut right = vec![0.0; system.dofs().len()];
        system.dofs().gather(&force, &mut right);
        let solution = jacobian.solve(&right, false)?;
        let moved = jacobian.full(&solution);
        let doubles = run.scheme == Scheme::ImplicitMidpoint;
        let now = [self.positions.clone(), self.velocities.clone()];
        for p in 0..particles {
            for axis in system.dofs().free_axes(p).iter() {
                let (middle, rate) = (moved[p][axis], (moved[p][axis] - x[p][axis]) / tau);
                self.positions[p][axis] = if doubles { 2.0 * middle - now[0][p][axis] } else { middle };
                self.velocities[p][axis] = if doubles { 2.0 * rate - now[1][p][axis] } else { rate };
            }
        }
        self.before = now;
        Ok(())
    }
}
