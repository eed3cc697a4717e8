//! Changes of the states of a run, from its start to its end.

use super::jacobian::Jacobian;
use super::{Core, DifferentiableRun, Parameters, Record, StateChange};
use crate::error::Result;
use crate::integrate::Method;
use crate::system::{Dof, State, System};
use nalgebra::Vector3;
use rayon::prelude::*;

/// The way forwards of several changes of parameters, which share the Jacobian of every step.
pub(super) struct Tangents<'r, 's> {
    run: &'r DifferentiableRun<'s>,
    jacobian: Jacobian<'s>,
    tangents: Vec<Tangent<'r>>,
}

struct Tangent<'r> {
    change: &'r Parameters,
    now: StateChange,
    accelerations: Vec<Vector3<f64>>,
    before: StateChange,
}

impl<'r, 's> Tangents<'r, 's> {
    pub(super) fn new(run: &'r DifferentiableRun<'s>, changes: &'r [Parameters], first: &Record) -> Result<Self> {
        let mut jacobian = Jacobian::new(run.system, &first.state)?;
        jacobian.linearise(&first.state)?;
        let tangents = changes.iter().map(|change| Tangent::new(run, change, first, &jacobian)).collect();
        Ok(Self { run, jacobian, tangents })
    }

    pub(super) fn states(&self) -> impl Iterator<Item = &StateChange> + '_ {
        self.tangents.iter().map(|tangent| &tangent.now)
    }

    pub(super) fn step(&mut self, step: usize, before: Option<&Record>, [here, next]: [&Record; 2]) -> Result<()> {
        let Self { run, jacobian, tangents } = self;
        let system = run.system;
        run.check_interrupt(step, here.state.time)?;
        if run.method == Method::Verlet {
            let h = run.steps[step];
            let predicted = predicted(system, h, here, next);
            jacobian.linearise(&predicted)?;
            tangents.par_iter_mut().for_each(|tangent| tangent.verlet(h, &predicted, &next.acceleration, jacobian));
            return Ok(());
        }
        let core = run.core(step, before, &here.state, &next.state);
        jacobian.set(&core.solved, core.tau)?;
        let columns: Vec<Vec<f64>> = tangents.par_iter().map(|tangent| tangent.right_side(&core, jacobian)).collect();
        let solutions = jacobian.solve(&columns.concat(), false)?;
        let solved = solutions.par_chunks_exact(system.dofs().len().max(1)).zip(tangents.par_iter_mut());
        solved.for_each(|(solution, tangent)| tangent.advance(&core, system, &system.dofs().full(solution)));
        Ok(())
    }
}

impl<'r> Tangent<'r> {
    fn new(run: &DifferentiableRun<'_>, change: &'r Parameters, first: &Record, jacobian: &Jacobian<'_>) -> Self {
        let system = run.system;
        let now = [change.positions.clone(), of_free(system, &change.velocities)];
        let mut tangent = Self { change, before: now.clone(), now, accelerations: Vec::new() };
        if run.method == Method::Verlet {
            let [x, v] = &tangent.now;
            tangent.accelerations = tangent.acceleration_change(&first.state, &first.acceleration, [x, v], jacobian);
        }
        tangent
    }

    /// δ(M⁻¹F) for changes of positions, velocities and parameters.
    fn acceleration_change(
        &self,
        at: &State,
        acceleration: &[Vector3<f64>],
        [x, v]: [&[Vector3<f64>]; 2],
        jacobian: &Jacobian<'_>,
    ) -> Vec<Vector3<f64>> {
        let Self { change, .. } = self;
        let system = jacobian.system;
        let mut force = jacobian.stiffness_change(x);
        force.iter_mut().zip(jacobian.damping(v)).for_each(|(f, damped)| *f += damped);
        change.add_force_change(system, &jacobian.point(at), &mut force);
        for (p, f) in force.iter_mut().enumerate() {
            *f = (*f - acceleration[p] * change.masses[p]) / system.masses()[p];
        }
        of_free(system, &force)
    }

    fn verlet(&mut self, h: f64, predicted: &State, acceleration: &[Vector3<f64>], jacobian: &Jacobian<'_>) {
        let [mut x, mut v] = self.now.clone();
        for Dof { particle: p, axis } in jacobian.system.dofs().iter() {
            let (dv, da) = (v[p][axis], self.accelerations[p][axis]);
            x[p][axis] += h * (dv + 0.5 * h * da);
            v[p][axis] += h * da;
        }
        let after = self.acceleration_change(predicted, acceleration, [&x, &v], jacobian);
        for ((v, before), after) in self.now[1].iter_mut().zip(&self.accelerations).zip(&after) {
            *v += (before + after) * (0.5 * h);
        }
        (self.now[0], self.accelerations) = (x, after);
    }

    fn base(&self, beta: f64) -> StateChange {
        let ahead = |now: &[Vector3<f64>], before: &[Vector3<f64>]| -> Vec<_> {
            now.iter().zip(before).map(|(now, before)| now + (now - before) * beta).collect()
        };
        [ahead(&self.now[0], &self.before[0]), ahead(&self.now[1], &self.before[1])]
    }

    /// `(M/τ² − G/τ) δx̃ + M δṽ/τ + (K + D) δx_held + ∂F/∂p δp − δm (x' − x̃ − τṽ)/τ²`.
    fn right_side(&self, core: &Core, jacobian: &Jacobian<'_>) -> Vec<f64> {
        let Core { tau, base, solved, .. } = core;
        let (system, change) = (jacobian.system, self.change);
        let [x, v] = self.base(core.beta);
        let free = of_free(system, &x);
        let held: Vec<_> = self.now[0].iter().zip(of_free(system, &self.now[0])).map(|(x, free)| x - free).collect();
        let is_led = held.iter().any(|x| *x != Vector3::zeros());
        let mut force = if is_led { jacobian.stiffness_change(&held) } else { vec![Vector3::zeros(); x.len()] };
        change.add_force_change(system, &jacobian.point(solved), &mut force);
        let damped = jacobian.damping(&free);
        for p in 0..x.len() {
            let mass = system.masses()[p];
            let inertia = (solved.positions[p] - base.positions[p] - base.velocities[p] * *tau) / (tau * tau);
            force[p] +=
                free[p] * (mass / (tau * tau)) - damped[p] / *tau + v[p] * (mass / tau) - inertia * change.masses[p];
        }
        system.dofs().reduced(&force)
    }

    fn advance(&mut self, core: &Core, system: &System, moved: &[Vector3<f64>]) {
        let Core { tau, beta, doubles, .. } = *core;
        let [x, _] = self.base(beta);
        let now = self.now.clone();
        for Dof { particle: p, axis } in system.dofs().iter() {
            let (middle, rate) = (moved[p][axis], (moved[p][axis] - x[p][axis]) / tau);
            self.now[0][p][axis] = if doubles { 2.0 * middle - now[0][p][axis] } else { middle };
            self.now[1][p][axis] = if doubles { 2.0 * rate - now[1][p][axis] } else { rate };
        }
        self.before = now;
    }
}

/// Vectors with zeros for prescribed coordinates.
pub(crate) fn of_free(system: &System, vectors: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    vectors.iter().enumerate().map(|(p, v)| system.dofs().free_axes(p).project(v)).collect()
}

/// The state at which Verlet's method takes forces: x' and `v* = v + h a`.
pub(super) fn predicted(system: &System, h: f64, here: &Record, next: &Record) -> State {
    let mut predicted = next.state.clone();
    for Dof { particle: p, axis } in system.dofs().iter() {
        predicted.velocities[p][axis] = here.state.velocities[p][axis] + h * here.acceleration[p][axis];
    }
    predicted
}
