//! Cotangents from the end of a run to its start, with checkpoints.

use super::jacobian::Jacobian;
use super::tangent::{of_free, predicted};
use super::{Core, Cotangent, DifferentiableRun, Forward, Parameters, Record};
use crate::error::Result;
use crate::integrate::Method;
use crate::system::State;
use nalgebra::Vector3;

/// A state from which others can be computed again.
#[derive(Debug, Clone)]
pub(super) struct Snapshot {
    pub(super) step: usize,
    pub(super) here: Record,
    pub(super) before: Option<Record>,
}

/// The way backwards: cotangents of the state at hand, of the one before (which BDF2 uses too), and of parameters.
pub(super) struct Reverse<'r, 's> {
    run: &'r DifferentiableRun<'s>,
    cotangents: &'r [Cotangent],
    jacobian: Jacobian<'s>,
    forward: Forward<'s>,
    result: Parameters,
    positions: Vec<Vector3<f64>>,
    velocities: Vec<Vector3<f64>>,
    accelerations: Vec<Vector3<f64>>,
    before: [Vec<Vector3<f64>>; 2],
}

impl<'r, 's> Reverse<'r, 's> {
    pub(super) fn new(run: &'r DifferentiableRun<'s>, cotangents: &'r [Cotangent]) -> Result<Self> {
        let zeros = || vec![Vector3::zeros(); run.system.particles()];
        let start = &run.records[0].state;
        Ok(Self {
            run,
            cotangents,
            jacobian: Jacobian::new(run.system, start)?,
            forward: Forward::new(run, start)?,
            result: Parameters::zeros(run.system),
            positions: zeros(),
            velocities: zeros(),
            accelerations: zeros(),
            before: [zeros(), zeros()],
        })
    }

    pub(super) fn add_cotangents(&mut self, step: usize) {
        for cotangent in self.cotangents.iter().filter(|cotangent| cotangent.step == step) {
            self.positions.iter_mut().zip(&cotangent.positions).for_each(|(sum, x)| *sum += x);
            self.velocities.iter_mut().zip(&cotangent.velocities).for_each(|(sum, v)| *sum += v);
        }
    }

    /// The steps from a snapshot to step `end`, backwards, from the state `last` there, with room for a number of states.
    pub(super) fn sweep(&mut self, from: &Snapshot, end: usize, last: &Record, room: usize) -> Result<()> {
        let count = end - from.step;
        (self.forward.here, self.forward.before) = (from.here.clone(), from.before.clone());
        let next = split(count, room);
        if next == count {
            let mut records = vec![from.here.clone()];
            for step in from.step..end - 1 {
                self.forward.step(self.run, step)?;
                records.push(self.forward.here.clone());
            }
            records.push(last.clone());
            for k in (0..count).rev() {
                let before = if k > 0 { Some(&records[k - 1]) } else { from.before.as_ref() };
                self.step(from.step + k, before, &records[k], &records[k + 1])?;
            }
            return Ok(());
        }
        let middle = from.step + next;
        for step in from.step..middle {
            self.forward.step(self.run, step)?;
        }
        let there = Snapshot { step: middle, here: self.forward.here.clone(), before: self.forward.before.clone() };
        self.sweep(&there, end, last, room - 1)?;
        self.sweep(from, middle, &there.here, room)
    }

    pub(super) fn step(&mut self, step: usize, before: Option<&Record>, here: &Record, next: &Record) -> Result<()> {
        self.run.check_interrupt(step, here.state.time)?;
        if self.run.method == Method::Verlet {
            self.verlet(step, here, next)?
        } else {
            self.implicit(step, before, here, next)?
        }
        self.add_cotangents(step);
        Ok(())
    }

    fn implicit(&mut self, step: usize, before: Option<&Record>, here: &Record, next: &Record) -> Result<()> {
        let Self { run, jacobian, result, .. } = self;
        let Core { tau, beta, doubles, base, solved } = run.core(step, before, &here.state, &next.state);
        jacobian.set(&solved, tau)?;
        let doubles = if doubles { 2.0 } else { 1.0 };
        let (system, dofs) = (run.system, run.system.dofs());
        let full: Vec<_> = self.positions.iter().zip(&self.velocities).map(|(x, v)| (x + v / tau) * doubles).collect();
        let right = dofs.reduced(&full);
        let adjoint = dofs.full(&jacobian.solve(&right, true)?);
        let [moved, damped] = result.add_force_adjoint(system, &jacobian.point(&solved), &adjoint);
        let mut earlier = [vec![Vector3::zeros(); full.len()], vec![Vector3::zeros(); full.len()]];
        for p in 0..full.len() {
            let (mass, u, free) = (system.masses()[p], adjoint[p], dofs.free_axes(p));
            let inertia = (solved.positions[p] - base.positions[p] - base.velocities[p] * tau) / (tau * tau);
            result.masses[p] -= u.dot(&inertia);
            let (x, v) = (self.positions[p], self.velocities[p]);
            for axis in 0..3 {
                if !free.contains(axis) {
                    // Held, or led along a path that is shifted as a whole.
                    self.positions[p][axis] = self.before[0][p][axis] + x[axis] + moved[p][axis];
                    self.velocities[p][axis] = 0.0;
                    continue;
                }
                let at_base = -doubles * v[axis] / tau + mass / (tau * tau) * u[axis] - damped[p][axis] / tau;
                let rate_at_base = mass / tau * u[axis];
                let mirrored = if doubles == 2.0 { [-x[axis], -v[axis]] } else { [0.0, 0.0] };
                self.positions[p][axis] = self.before[0][p][axis] + (1.0 + beta) * at_base + mirrored[0];
                self.velocities[p][axis] = self.before[1][p][axis] + (1.0 + beta) * rate_at_base + mirrored[1];
                earlier[0][p][axis] = -beta * at_base;
                earlier[1][p][axis] = -beta * rate_at_base;
            }
        }
        self.before = earlier;
        Ok(())
    }

    /// With cotangents of x', v' and a': those of x, v and a, of `v½ = v + ½h a`, `x' = x + h v½`, `v* = v + h a`, `a' = M⁻¹F(x', v*)`,
    /// `v' = v½ + ½h a'`.
    fn verlet(&mut self, step: usize, here: &Record, next: &Record) -> Result<()> {
        let (system, h) = (self.run.system, self.run.steps[step]);
        let predicted = predicted(system, h, here, next);
        let total: Vec<_> = self.accelerations.iter().zip(&self.velocities).map(|(a, v)| a + v * (0.5 * h)).collect();
        let [moved, damped] = self.force_adjoint(&predicted, &next.acceleration, &total)?;
        for p in 0..total.len() {
            let free = system.dofs().free_axes(p);
            for axis in 0..3 {
                let x = self.positions[p][axis] + moved[p][axis];
                self.positions[p][axis] = x;
                if free.contains(axis) {
                    let middle = self.velocities[p][axis] + h * x;
                    self.velocities[p][axis] = middle + damped[p][axis];
                    self.accelerations[p][axis] = 0.5 * h * middle + h * damped[p][axis];
                } else {
                    self.velocities[p][axis] = 0.0;
                }
            }
        }
        Ok(())
    }

    /// `(K + D)ᵀ μ` and `Gᵀ μ` with `μ = M⁻¹ ā` on free coordinates, of an acceleration `a = M⁻¹ F` at a state; parameters get their parts.
    fn force_adjoint(
        &mut self,
        at: &State,
        acceleration: &[Vector3<f64>],
        cotangent: &[Vector3<f64>],
    ) -> Result<[Vec<Vector3<f64>>; 2]> {
        let Self { run, jacobian, result, .. } = self;
        let system = run.system;
        jacobian.linearise(at)?;
        let scaled: Vec<_> = cotangent.iter().zip(system.masses()).map(|(a, mass)| a / *mass).collect();
        let adjoint = of_free(system, &scaled);
        let changes = result.add_force_adjoint(system, &jacobian.point(at), &adjoint);
        for ((mass, u), a) in result.masses.iter_mut().zip(&adjoint).zip(acceleration) {
            *mass -= u.dot(a);
        }
        Ok(changes)
    }

    pub(super) fn finish(mut self, first: &Record) -> Result<Parameters> {
        if self.run.method == Method::Verlet {
            let cotangent = std::mem::take(&mut self.accelerations);
            let [moved, damped] = self.force_adjoint(&first.state, &first.acceleration, &cotangent)?;
            self.positions.iter_mut().zip(&moved).for_each(|(x, moved)| *x += moved);
            self.velocities.iter_mut().zip(&damped).for_each(|(v, damped)| *v += damped);
        }
        self.result.velocities = of_free(self.run.system, &self.velocities);
        self.result.positions = self.positions;
        Ok(self.result)
    }
}

/// Where a sweep over `count` steps with room for some states, the first one included, sets its next checkpoint; at the end where all have room.
///
/// States computed again at most r times each suffice for `N(room, r) = C(room + r, r)` steps, as the steps from the checkpoint on have one state
/// less, and those before it were passed once: `N(room, r) = N(room − 1, r) + N(room, r − 1)`. With the least such r, as few steps as possible are
/// computed again wherever the first part has from `N(room, r − 2)` to `N(room, r − 1)` steps and the second from `N(room − 1, r − 1)` to
/// `N(room − 1, r)`.
pub(super) fn split(count: usize, room: usize) -> usize {
    // The last state is at hand and needs no room.
    if count <= room + 1 {
        return count;
    }
    let reaches =
        |room: usize, passes: usize| (1..=passes).fold(1.0, |product: f64, k| product * (room + k) as f64 / k as f64);
    let passes = (2..).find(|&passes| reaches(room, passes) >= count as f64).unwrap_or(2);
    (count as f64 - reaches(room - 1, passes)).max(reaches(room, passes - 2)) as usize
}
