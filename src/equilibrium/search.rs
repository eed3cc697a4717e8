//! The search for a minimum of the energy.
//!
//! **Newton's method** with `−K(x) p = f`, or a matrix in its place that is positive definite (`factored`), and a non-monotone line search on E.
//!
//! **Differences of E** are sums of rounding errors near the minimum. There the trapezoidal rule `−½ (f(x) + f(x + p))·p`, exact to third order in p,
//! has no cancellation and takes over.
//!
//! **Large scenes**, whose factor would take too long or too much memory, are searched by conjugate gradients with multigrid (`iterative`).
//!
//! **The verdict** is the inertia of −K at the end: negative eigenvalues make a saddle, from which the search goes on along the lowest mode;
//! eigenvalues of zero leave the scene free to move.

use super::{Equilibrium, EquilibriumOptions, Signs, Stability, loads};
use crate::assembly::SymmetricMatrix;
use crate::eigen::{Accuracy, Pencil, ShiftInvert};
use crate::error::Result;
use crate::force::{Energy, SpringGeometry, add_elastic_force};
use crate::integrate::{Matrices, Projection};
use crate::linear::{Cholesky, ConjugateGradient, Ldlt, Preconditioner, dot};
use crate::modes::largest;
use crate::operator::LinearOperator;
use crate::rigid::{bodies, sums_at_ends};
use crate::spring::{Spring, Stiffness};
use crate::system::{Axes, State, System};
use crate::work::Work;
use nalgebra::Vector3;
use std::collections::VecDeque;

/// A shift that is rounding, as a part of ‖K‖.
pub(super) const SINGULAR: f64 = 1e-10;

pub(super) const NEAR: f64 = 1e-3;

const HALVINGS: usize = 50;

pub(super) enum Solver {
    Factored(Box<Cholesky>),
    Iterative(Box<Iterative>),
}

pub(super) struct Iterative {
    pub method: ConjugateGradient,
    pub preconditioner: Preconditioner,
}

pub(super) struct Search<'s> {
    pub system: &'s System,
    pub options: EquilibriumOptions,
    pub matrices: Matrices<'s>,
    pub solver: Solver,
    pub projection: Projection,
    pub state: State,
    pub geometry: SpringGeometry,
    loads: Vec<Vector3<f64>>,
    /// Net forces on the free coordinates, and the largest force that acts.
    pub force: Vec<f64>,
    pub acting: f64,
    /// The largest force that rounding makes of one spring, and of all springs of a particle.
    rounding: [f64; 2],
    /// E without the springs between held particles, whose part is constant.
    energy: f64,
    /// A body has rigid motions.
    pub is_free: bool,
    /// The last σ, in N/m.
    pub shift: f64,
    recent: VecDeque<f64>,
    iterations: usize,
    pub falling: Vec<usize>,
    lowest: Option<(f64, Vec<f64>)>,
    pub work: Work,
}

/// The forces that rounding of positions makes, `u k/l0 ‖x‖` of a spring's farther end. No search gets below these.
fn rounding(system: &System, state: &State, geometry: &SpringGeometry) -> [f64; 2] {
    let springs = geometry.springs(system).map(|((_, ends, spring), _)| {
        let farther = ends.iter().fold(0.0f64, |farther, &end| farther.max(state.positions[end].amax()));
        (ends, spring.axial_stiffness() * farther * f64::EPSILON)
    });
    let springs: Vec<_> = springs.collect();
    let one = springs.iter().map(|(_, force)| *force).fold(0.0, f64::max);
    [one, largest(&sums_at_ends(system, springs.into_iter()))]
}

impl<'s> Search<'s> {
    pub fn new(system: &'s System, state: &State, options: EquilibriumOptions) -> Result<Self> {
        state.check(system)?;
        let mut state = state.clone();
        state.velocities.fill(Vector3::zeros());
        let is_free = bodies(system).iter().any(|body| !body.rigid_motions(system, &state.positions).is_empty());
        let geometry = SpringGeometry::at(system, &state)?;
        let matrices = Matrices::new(system)?;
        let work = Work { symbolic_factorizations: 1, ..Work::default() };
        let mut search = Self {
            solver: Solver::new(system, matrices.k())?,
            rounding: rounding(system, &state, &geometry),
            loads: loads(system, &state, options.load),
            force: vec![0.0; system.dofs().len()],
            projection: Projection::new(system),
            system,
            options,
            matrices,
            state,
            geometry,
            acting: 0.0,
            energy: 0.0,
            is_free,
            shift: 0.0,
            recent: VecDeque::new(),
            iterations: 0,
            falling: Vec::new(),
            lowest: None,
            work,
        };
        search.evaluate();
        Ok(search)
    }

    /// Forces and E at the positions of `geometry`.
    fn evaluate(&mut self) {
        let Self { system, geometry, loads, state, .. } = self;
        self.work.force_evaluations += 1;
        let mut forces = vec![Vector3::zeros(); system.particles()];
        add_elastic_force(system, geometry, &mut forces);
        let tension = geometry.springs(system).map(|((_, _, spring), at)| spring.elastic_force(at).norm());
        let load = loads.iter().map(Vector3::amax).fold(0.0, f64::max);
        // Rounding makes at least a residual of 1e-11: where nothing is strained nothing acts, and what is left is compared with rounding.
        self.acting = tension.fold(load.max(self.rounding[0] / 1e-11), f64::max);
        forces.iter_mut().zip(loads.iter()).for_each(|(f, load)| *f += load);
        system.dofs().gather(&forces, &mut self.force);
        let elastic: f64 =
            geometry.springs(system).map(|((number, ..), at)| system.elastic_energy(number, at, state.time)).sum();
        self.energy = elastic - self.work_of_loads();
    }

    fn work_of_loads(&self) -> f64 {
        self.loads.iter().zip(&self.state.positions).map(|(f, x)| f.dot(x)).sum()
    }

    /// The largest sum of k/l0 at a particle, in N/m.
    pub fn stiffness(&self) -> f64 {
        let springs = self.geometry.springs(self.system).map(|((_, ends, spring), _)| (ends, spring.axial_stiffness()));
        largest(&sums_at_ends(self.system, springs))
    }

    pub fn residual(&self) -> f64 {
        let left = largest(&self.force);
        if left == 0.0 { 0.0 } else { left / self.acting }
    }

    /// A tolerance that rounding does not let it reach gives way to rounding, up to the default.
    fn has_converged(&self) -> bool {
        let is_rounding = largest(&self.force) <= self.rounding[1];
        let tolerance = self.options.tolerance;
        self.residual() <= if is_rounding { tolerance.max(EquilibriumOptions::default().tolerance) } else { tolerance }
    }

    pub fn run(mut self) -> Result<Equilibrium> {
        let mut saddles = 0;
        loop {
            let (mut shifted, mut before) = (0, f64::INFINITY);
            while !self.has_converged() {
                if self.iterations == self.options.iterations {
                    return self.end(Stability::NotConverged);
                }
                self.iterations += 1;
                let (step, is_shifted) = match self.solver {
                    Solver::Factored(_) => self.factored_step()?,
                    Solver::Iterative(_) => self.iterative_step(),
                };
                if !self.line_search(&step) {
                    return self.end(Stability::NotConverged);
                }
                // A direction of negative curvature along which no force acts keeps σ large: twenty such steps have to halve the residual.
                shifted = if is_shifted { shifted + 1 } else { 0 };
                if shifted == 20 {
                    let is_slow = self.residual() > 0.5 * before;
                    (shifted, before) = (0, self.residual());
                    if self.options.leave_saddles
                        && is_slow
                        && let Some(direction) = self.unstable_direction(false)?
                    {
                        self.leave(&direction);
                    }
                }
            }
            self.polish()?;
            let Some(direction) = self.unstable_direction(true)? else { return self.end(Stability::Stable) };
            saddles += 1;
            if !self.options.leave_saddles || saddles > 50 || !self.leave(&direction) {
                return self.end(Stability::Unstable);
            }
        }
    }

    /// Moves along a step until E is low enough; false where no length does.
    fn line_search(&mut self, step: &[f64]) -> bool {
        let slope = dot(&self.force, step);
        if !(slope > 0.0 && slope.is_finite()) {
            return false;
        }
        let (start, force, size) = (self.state.positions.clone(), self.force.clone(), self.size());
        // A long step that turns springs stretches them to second order, which the next step undoes: it has to undercut the largest E of ten steps
        // (Grippo, Lampariello and Lucidi, SIAM J. Numer. Anal. 23, 1986).
        self.recent.truncate(9);
        self.recent.push_front(self.energy);
        let highest = self.recent.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        // No particle moves farther than the scene is large.
        let mut length = (size / largest(step)).min(1.0);
        for _ in 0..HALVINGS {
            if self.place(&start, length, step) {
                let exact = self.energy - highest;
                let by_forces = -0.5 * length * (dot(&force, step) + dot(&self.force, step));
                // Far above the rounding of E, far below what the rule neglects.
                let change = if exact.abs() > 1e-9 * self.terms() { exact } else { by_forces };
                // The part of the slope that counts as sufficient (Nocedal and Wright, Numerical Optimization, 3.1).
                if change <= -1e-4 * length * slope {
                    return true;
                }
            }
            length *= 0.5;
        }
        self.place(&start, 0.0, step);
        false
    }

    /// Sets positions to `start + length · step`; false where springs have no direction or numbers overflow there.
    fn place(&mut self, start: &[Vector3<f64>], length: f64, step: &[f64]) -> bool {
        let dofs = self.system.dofs();
        for (p, (x, from)) in self.state.positions.iter_mut().zip(start).enumerate() {
            *x = from + dofs.get(step, p) * length;
        }
        if self.geometry.update(self.system, &self.state).is_err() {
            return false;
        }
        self.evaluate();
        self.energy.is_finite()
    }

    fn terms(&self) -> f64 {
        let loads = self.loads.iter().zip(&self.state.positions).map(|(f, x)| f.dot(x).abs()).sum::<f64>();
        loads + self.energy.abs()
    }

    /// A length of the problem: the largest extent along an axis, and at least the longest spring, taut or not, and the farthest that the load of a
    /// particle stretches the springs there. A scene that has shrunk to a point still has the last two.
    fn size(&self) -> f64 {
        let Self { system, state, loads, .. } = self;
        // Their own parameters: those of a slack spring are zero.
        let spring = |number: usize| system.spring_then(number, state.time);
        let springs = || self.geometry.springs(system).map(|((number, ends, _), at)| (ends, spring(number), at));
        let extent = |axis: usize| {
            let along = || state.positions.iter().map(|x| x[axis]);
            along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
        };
        let size = springs().map(|(_, spring, at)| at.length.max(spring.rest_length)).chain((0..3).map(extent));
        let stiffness = sums_at_ends(system, springs().map(|(ends, spring, _)| (ends, spring.axial_stiffness())));
        let is_stretched = |p: &usize| stiffness[*p] > 0.0 && system.dofs().free_axes(*p) != Axes::NONE;
        let stretched = (0..loads.len()).filter(is_stretched).map(|p| loads[p].amax() / stiffness[p]);
        size.chain(stretched).fold(0.0, f64::max)
    }

    /// One Newton step at full length, kept where it lowers the residual.
    fn polish(&mut self) -> Result<()> {
        if self.residual() == 0.0 {
            return Ok(());
        }
        let a = self.assemble(Stiffness::Full)?;
        let (start, before) = (self.state.positions.clone(), self.residual());
        if self.factor(&a) {
            let step = self.solve();
            if !self.place(&start, 1.0, &step) || self.residual() >= before {
                self.place(&start, 0.0, &step);
            }
        }
        Ok(())
    }

    fn inertia(&mut self, is_at_rest: bool) -> Result<Signs> {
        let a = self.assemble(Stiffness::Full)?;
        let band = self.zero_band(&a, is_at_rest);
        let order = a.order();
        if order == 0 {
            return Ok(Signs::default());
        }
        let Solver::Factored(cholesky) = &self.solver else { return self.signs_found(&a, band) };
        let mut factorization = Ldlt::sharing(cholesky)?;
        let mut counts = ShiftInvert::new(Pencil::of(&a), &mut factorization, &mut self.work);
        // What cannot be counted is not told from zero.
        let mut below = |shift: f64| counts.below_about(shift).map(|(count, _)| count);
        let (negative, not_positive) = (below(-band).unwrap_or(0), below(band).unwrap_or(order));
        Ok(Signs { negative, zero: not_positive.saturating_sub(negative), positive: order - not_positive })
    }

    /// Eigenvalues up to this size, in N/m, are zero: rounding, and at an equilibrium what the force that is left may change.
    fn zero_band(&self, a: &SymmetricMatrix, is_at_rest: bool) -> f64 {
        let left = if is_at_rest { largest(&self.force) } else { 0.0 };
        // Of those springs whose K depends on their length: neither slack ones nor those without a rest length.
        let turning = |spring: &Spring| spring.rest_length > 0.0 && spring.stiffness != 0.0;
        let lengths = self.geometry.springs(self.system).filter(|((.., spring), _)| turning(spring));
        let shortest = lengths.map(|(_, at)| at.length).fold(f64::INFINITY, f64::min);
        1e-11 * Pencil::of(a).norm() + 10.0 * left / shortest
    }

    /// The direction of the lowest eigenvalue of −K, where that is negative, at an equilibrium or on the way to one, where E falls along it however
    /// much force is left.
    fn unstable_direction(&mut self, is_at_rest: bool) -> Result<Option<Vec<f64>>> {
        self.lowest = None;
        let a = self.assemble(Stiffness::Full)?;
        let band = self.zero_band(&a, is_at_rest);
        if a.order() == 0 || self.factor(&a) {
            return Ok(None);
        }
        let lowest = match &self.solver {
            Solver::Factored(cholesky) => {
                let mut factorization = Ldlt::sharing(cholesky)?;
                let mut search = ShiftInvert::new(Pencil::of(&a), &mut factorization, &mut self.work);
                search.lowest(1, Accuracy::CERTIFIED).into_iter().next()
            }
            Solver::Iterative(_) => self.lowest_found(&a)?.into_iter().min_by(|a, b| a.value.total_cmp(&b.value)),
        };
        self.lowest = lowest.filter(|pair| pair.value <= band).map(|pair| (pair.value, pair.vector));
        Ok(self.lowest.clone().filter(|(value, _)| *value < -band).map(|(_, vector)| vector))
    }

    /// Moves off a saddle, along a direction or against it, to where E is lower.
    fn leave(&mut self, direction: &[f64]) -> bool {
        let (start, energy) = (self.state.positions.clone(), self.energy);
        self.recent.clear();
        let mut length = 0.1 * self.size() / largest(direction);
        for _ in 0..HALVINGS {
            for sign in [1.0, -1.0] {
                if self.place(&start, sign * length, direction) && self.energy - energy < -f64::EPSILON * self.terms() {
                    return true;
                }
            }
            length *= 0.5;
        }
        self.place(&start, 0.0, direction);
        false
    }

    /// The result; a minimum with eigenvalues of zero is indifferent.
    pub fn end(mut self, stability: Stability) -> Result<Equilibrium> {
        let is_at_rest = !matches!(stability, Stability::None | Stability::NotConverged);
        let inertia = self.inertia(is_at_rest)?;
        let is_indifferent = stability == Stability::Stable && inertia.zero > 0;
        Ok(Equilibrium {
            stability: if is_indifferent { Stability::Indifferent } else { stability },
            load: self.options.load,
            residual: self.residual(),
            energy: Energy::of(self.system, &self.state).elastic - self.work_of_loads(),
            iterations: self.iterations,
            inertia,
            counted: matches!(self.solver, Solver::Factored(_)),
            lowest: self.lowest,
            falling: self.falling,
            work: self.work,
            state: self.state,
        })
    }
}
