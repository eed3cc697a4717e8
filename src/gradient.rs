//! Gradients through a motion: discrete adjoints, exact for the numbers that a run computes.
//!
//! **One core.** Backward Euler over τ from (x̃, ṽ) solves
//!
//! ```text
//! M (x' − x̃ − τ ṽ)/τ² = F(x', w),      w = v' = (x' − x̃)/τ,
//! ```
//!
//! and three methods are made of it: backward Euler itself; BDF2, with `x̃ = x + β (x − x₋)`, `ṽ = v + β (v − v₋)`; and the implicit midpoint rule, a core
//! step of half the length with `x' = 2x_m − x`, `v' = 2v_m − v`. With cotangents x̄', v̄' of its result and `J = M/τ² − K − G/τ − D`, `D = ∂f_d/∂x`,
//!
//! ```text
//! Jᵀ λ = x̄' + v̄'/τ,    x̃bar = −v̄'/τ + (M/τ² − G/τ) λ,    ṽbar = M λ/τ,    p̄ += (∂F/∂p)ᵀ λ,    m̄ += −λ·(x' − x̃ − τṽ)/τ².
//! ```
//!
//! J is the exact Jacobian, whatever matrix solved the step. Damping makes it unsymmetric: the factor of its symmetric part is refined with D, and where
//! that does not converge J is factored as L U.
//!
//! **Verlet's method** needs products only; its acceleration is carried from step to step, and so is its cotangent.
//!
//! **Memory.** All states are kept where they fit. Beyond, checkpoints are set by binomial bisection (Griewank and Walther, ACM TOMS 26, 2000), and states
//! between them computed again, to the same bits.

use crate::assembly::SymmetricMatrix;
use crate::error::{Error, Invalid, Result, check_length};
use crate::force::{
    SpringGeometry, add_damping_differential, add_damping_product, add_elastic_differential, set_total_force,
};
use crate::integrate::{BackwardEuler, ImplicitOptions, Matrices, Method, NewtonOptions, StepFailure, TimeStepper};
use crate::linear::{Ldlt, SolverChoice, SolverOptions, norm};
use crate::memory;
use crate::operator::LinearOperator;
use crate::simulation::Simulation;
use crate::spring::Stiffness;
use crate::system::{State, System};
use faer::Par;
use faer::linalg::solvers::Solve;
use faer::sparse::{SparseColMat, Triplet};
use nalgebra::Vector3;

/// Derivatives of a number by the parameters of a scene, or a change of these parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// k of every spring.
    pub stiffness: Vec<f64>,
    /// l0 of every spring; the derivative is zero where l0 is, since the law is another there.
    pub rest_lengths: Vec<f64>,
    /// b of every spring.
    pub damping: Vec<f64>,
    /// m of every particle.
    pub masses: Vec<f64>,
    /// g.
    pub gravity: Vector3<f64>,
    /// A constant force on every particle.
    pub loads: Vec<Vector3<f64>>,
    /// Positions at the start; of held and moved coordinates, their whole paths shifted.
    pub positions: Vec<Vector3<f64>>,
    /// Velocities at the start, of free coordinates.
    pub velocities: Vec<Vector3<f64>>,
}

impl Parameters {
    /// Zeros for a system.
    pub fn zeros(system: &System) -> Self {
        let [springs, particles] = [system.springs().len(), system.particles()];
        Self {
            stiffness: vec![0.0; springs],
            rest_lengths: vec![0.0; springs],
            damping: vec![0.0; springs],
            masses: vec![0.0; particles],
            gravity: Vector3::zeros(),
            loads: vec![Vector3::zeros(); particles],
            positions: vec![Vector3::zeros(); particles],
            velocities: vec![Vector3::zeros(); particles],
        }
    }

    /// The sum of products with another set: how fast a number changes along a change.
    pub fn dot(&self, other: &Self) -> f64 {
        let scalars = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let vectors = |a: &[Vector3<f64>], b: &[Vector3<f64>]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
        scalars(&self.stiffness, &other.stiffness)
            + scalars(&self.rest_lengths, &other.rest_lengths)
            + scalars(&self.damping, &other.damping)
            + scalars(&self.masses, &other.masses)
            + self.gravity.dot(&other.gravity)
            + vectors(&self.loads, &other.loads)
            + vectors(&self.positions, &other.positions)
            + vectors(&self.velocities, &other.velocities)
    }

    /// Adds `(∂F/∂p)ᵀ λ` at a configuration, with relative velocities of w.
    pub(crate) fn add_force_adjoint(&mut self, system: &System, at: &Point<'_>, adjoint: &[Vector3<f64>]) {
        for ((number, [i, j], spring), extension) in at.geometry.springs(system) {
            let along = extension.direction.dot(&(adjoint[i] - adjoint[j]));
            let rate = extension.direction.dot(&(at.velocities[i] - at.velocities[j]));
            self.stiffness[number] -= spring.strain(extension) * along;
            self.damping[number] -= rate * along;
            if spring.rest_length > 0.0 {
                self.rest_lengths[number] += spring.stiffness * extension.length / spring.rest_length.powi(2) * along;
            }
        }
        let gravity = gravity(system, at.time);
        for (p, u) in adjoint.iter().enumerate() {
            self.masses[p] += gravity.dot(u);
            self.gravity += u * system.masses()[p];
            self.loads[p] += u;
        }
    }

    /// Adds `∂F/∂p δp` at a configuration, for a change δp of the parameters.
    fn add_force_change(&self, system: &System, at: &Point<'_>, force: &mut [Vector3<f64>]) {
        for ((number, [i, j], spring), extension) in at.geometry.springs(system) {
            let rate = extension.direction.dot(&(at.velocities[i] - at.velocities[j]));
            let mut along = -spring.strain(extension) * self.stiffness[number] - rate * self.damping[number];
            if spring.rest_length > 0.0 {
                let slope = spring.stiffness * extension.length / spring.rest_length.powi(2);
                along += slope * self.rest_lengths[number];
            }
            force[i] += extension.direction * along;
            force[j] -= extension.direction * along;
        }
        let gravity = gravity(system, at.time);
        for (p, f) in force.iter_mut().enumerate() {
            *f += gravity * self.masses[p] + self.gravity * system.masses()[p] + self.loads[p];
        }
    }
}

fn gravity(system: &System, time: f64) -> Vector3<f64> {
    system.loads().gravity.as_ref().map_or(system.gravity(), |gravity| gravity.at(time))
}

/// Where forces are linearised.
pub(crate) struct Point<'a> {
    pub geometry: &'a SpringGeometry,
    pub velocities: &'a [Vector3<f64>],
    pub time: f64,
}

/// Derivatives of a cost by the state after a step.
#[derive(Debug, Clone, PartialEq)]
pub struct Cotangent {
    /// The number of the step; the last state of a run is that of its number of steps, the first that of zero.
    pub step: usize,
    /// ∂J/∂x.
    pub positions: Vec<Vector3<f64>>,
    /// ∂J/∂v.
    pub velocities: Vec<Vector3<f64>>,
}

/// Changes of positions and velocities.
pub type StateChange = [Vec<Vector3<f64>>; 2];

/// A run whose end, and whatever was on the way, can be differentiated.
///
/// # Examples
/// ```
/// use sprung::gradient::{Cotangent, DifferentiableRun};
/// use sprung::nalgebra::Vector3;
/// use sprung::{Method, Spring, SystemBuilder};
///
/// let mut builder = SystemBuilder::new();
/// builder.particle([0.0, 0.0, 0.0], 1.0);
/// builder.particle([1.0, 0.0, 0.0], 1.0);
/// builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// builder.hold(0);
/// let (system, state) = builder.build()?;
/// let run = DifferentiableRun::new(&system, &state, Method::Verlet, 1e-3, 0.1)?;
/// // How the end depends on the stiffness: x = 2 − cos(ωt), ω² = k/2, so that ∂x/∂k = t sin(ωt)/4ω.
/// let end = Cotangent {
///     step: run.steps(),
///     positions: vec![Vector3::zeros(), Vector3::x()],
///     velocities: vec![Vector3::zeros(); 2],
/// };
/// let gradient = run.gradient(&[end])?;
/// let omega = 10f64.sqrt();
/// assert!((gradient.stiffness[0] - 0.1 * (0.1 * omega).sin() / (4.0 * omega)).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct DifferentiableRun<'s> {
    system: &'s System,
    scheme: Scheme,
    lengths: Vec<f64>,
    /// All states, or the first and the last.
    records: Vec<Record>,
    checkpoints: usize,
}

/// The methods that have an adjoint here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scheme {
    BackwardEuler,
    ImplicitMidpoint,
    Bdf2,
    Verlet,
}

/// A state, and the acceleration that Verlet's method carries.
#[derive(Debug, Clone, PartialEq)]
struct Record {
    state: State,
    acceleration: Vec<Vector3<f64>>,
}

/// Newton's method goes on to rounding: the adjoint is that of a step that was solved.
const TOLERANCE: f64 = 1e-13;

impl<'s> DifferentiableRun<'s> {
    /// Runs for `duration` seconds with steps of dt, the last one shorter where dt does not divide the duration, and keeps as many states as fit in half
    /// of the memory.
    ///
    /// # Errors
    /// A method without an adjoint; a spring law or forces of the caller's own; steps or a duration that cannot be used; a state of another system; a
    /// step that breaks down.
    pub fn new(system: &'s System, state: &State, method: Method, dt: f64, duration: f64) -> Result<Self> {
        let record = 2 * 72 * system.particles() as u64 + 200;
        let room = (memory::room() / 2 / record).min(usize::MAX as u64) as usize;
        Self::with_checkpoints(system, state, method, dt, duration, room)
    }

    /// As [`new`](Self::new), with room for a number of states.
    ///
    /// # Errors
    /// As of [`new`](Self::new); room for fewer than two states.
    pub fn with_checkpoints(
        system: &'s System,
        state: &State,
        method: Method,
        dt: f64,
        duration: f64,
        checkpoints: usize,
    ) -> Result<Self> {
        let scheme = match method {
            Method::BackwardEuler => Scheme::BackwardEuler,
            Method::ImplicitMidpoint => Scheme::ImplicitMidpoint,
            Method::Bdf2 => Scheme::Bdf2,
            Method::Verlet => Scheme::Verlet,
            _ => {
                let rule = "has no gradient; backward-euler, implicit-midpoint, bdf2 and verlet have one";
                return Err(Invalid::new("method", method.name(), rule).into());
            }
        };
        if system.has_other_laws() || system.external_forces().next().is_some() {
            return Err(Error::Unsupported(
                "gradients are those of the built-in spring law and of loads of the scene".into(),
            ));
        }
        if scheme == Scheme::Verlet && system.prescribed().moves() && system.is_damped() {
            return Err(Error::Unsupported(
                "verlet has no gradient with damping and moving constraints; bdf2 has one".into(),
            ));
        }
        for (name, value, is_right) in [("dt", dt, dt > 0.0), ("duration", duration, duration >= 0.0)] {
            if !(value.is_finite() && is_right) {
                return Err(Invalid::new(name, value, "must be finite and positive").into());
            }
        }
        if checkpoints < 2 {
            return Err(Invalid::new("checkpoints", checkpoints, "must be at least 2").into());
        }
        state.check(system)?;
        // A remainder within rounding of a step is none.
        let count = (duration / dt * (1.0 - 1e-12)).ceil();
        if count > 1e9 {
            return Err(Invalid::new("dt", dt, "must give fewer than 1e9 steps").into());
        }
        let count = count as usize;
        let mut lengths = vec![dt; count];
        if let Some(last) = lengths.last_mut() {
            *last = duration - dt * (count - 1) as f64;
        }
        let mut run = Self { system, scheme, lengths, records: Vec::new(), checkpoints };
        let mut forward = Forward::new(&run, state)?;
        let keeps_all = count < checkpoints;
        run.records.push(forward.here.clone());
        for step in 0..count {
            forward.step(&run, step)?;
            if keeps_all {
                run.records.push(forward.here.clone());
            }
        }
        if !keeps_all {
            run.records.push(forward.here.clone());
        }
        Ok(run)
    }

    /// Steps done.
    pub fn steps(&self) -> usize {
        self.lengths.len()
    }

    /// The last state.
    pub fn end(&self) -> &State {
        &self.records[self.records.len() - 1].state
    }

    /// The states that are kept: all, the first one included, or the first and the last.
    pub fn states(&self) -> impl ExactSizeIterator<Item = &State> + '_ {
        self.records.iter().map(|record| &record.state)
    }

    /// The time, in s, from which a gradient says little, because the motion magnifies differences to its own size; `None` where that is later than the
    /// end. Found by a run of the same method with its errors propagated.
    ///
    /// # Errors
    /// As of [`Simulation::run`].
    pub fn predictable_until(&self) -> Result<Option<f64>> {
        let (Some(&dt), Some(first)) = (self.lengths.first(), self.records.first()) else { return Ok(None) };
        let method = match self.scheme {
            Scheme::BackwardEuler => Method::BackwardEuler,
            Scheme::ImplicitMidpoint => Method::ImplicitMidpoint,
            Scheme::Bdf2 => Method::Bdf2,
            Scheme::Verlet => Method::Verlet,
        };
        let duration = self.lengths.iter().sum();
        let run = Simulation::new(self.system, first.state.clone()).method(method).dt(dt).run(duration)?;
        Ok(run.predictable_until)
    }

    /// The derivatives of a cost by all parameters, from its derivatives by states on the way: one solve a step, backwards.
    ///
    /// # Errors
    /// A cotangent of a step that there is not, or of another length; a step whose Jacobian is singular.
    pub fn gradient(&self, cotangents: &[Cotangent]) -> Result<Parameters> {
        for cotangent in cotangents {
            if cotangent.step > self.steps() {
                let rule = format!("must be at most the number of steps, {}", self.steps());
                return Err(Invalid::new("cotangent.step", cotangent.step, rule).into());
            }
            check_length("cotangent.positions", cotangent.positions.len(), self.system.particles())?;
            check_length("cotangent.velocities", cotangent.velocities.len(), self.system.particles())?;
        }
        let mut reverse = Reverse::new(self, cotangents)?;
        let first = Snapshot { step: 0, here: self.records[0].clone(), before: None };
        reverse.add_cotangents(self.steps());
        if self.records.len() == self.steps() + 1 {
            for step in (0..self.steps()).rev() {
                let before = step.checked_sub(1).map(|before| &self.records[before]);
                reverse.step(step, before, &self.records[step], &self.records[step + 1])?;
            }
        } else {
            reverse.sweep(&first, self.steps(), self.checkpoints)?;
        }
        reverse.finish(&self.records[0])
    }

    /// How the last state changes, to first order, when parameters change: forward differentiation, one solve a step. Positions and velocities.
    ///
    /// # Errors
    /// Parameters of another system; a step whose Jacobian is singular.
    pub fn tangent(&self, change: &Parameters) -> Result<StateChange> {
        let mut found = self.tangents(std::slice::from_ref(change), &[self.steps()])?;
        Ok(found.pop().and_then(|mut states| states.pop()).unwrap_or_default())
    }

    /// As [`tangent`](Self::tangent), for several changes at once, which share the factorization of every step, and for the states after some steps: for
    /// each change the positions and velocities after each of the steps.
    ///
    /// # Errors
    /// As of [`tangent`](Self::tangent); a step that there is not, or steps that do not ascend.
    pub fn tangents(&self, changes: &[Parameters], steps: &[usize]) -> Result<Vec<Vec<StateChange>>> {
        let [springs, particles] = [self.system.springs().len(), self.system.particles()];
        for change in changes {
            for (name, length) in
                [("stiffness", &change.stiffness), ("rest_lengths", &change.rest_lengths), ("damping", &change.damping)]
            {
                check_length(name, length.len(), springs)?;
            }
            check_length("masses", change.masses.len(), particles)?;
            for (name, vectors) in
                [("loads", &change.loads), ("positions", &change.positions), ("velocities", &change.velocities)]
            {
                check_length(name, vectors.len(), particles)?;
            }
        }
        for (index, &step) in steps.iter().enumerate() {
            if step > self.steps() || index > 0 && step <= steps[index - 1] {
                let rule = format!("must ascend, to at most the number of steps, {}", self.steps());
                return Err(Invalid::new("steps", step, rule).at(index).into());
            }
        }
        let first = &self.records[0];
        let mut jacobian = Jacobian::new(self.system, &first.state)?;
        let made = changes.iter().map(|change| Tangent::new(self, change, first, &mut jacobian));
        let mut tangents = made.collect::<Result<Vec<_>>>()?;
        let mut found = vec![Vec::with_capacity(steps.len()); changes.len()];
        let record = |found: &mut Vec<Vec<_>>, tangents: &[Tangent<'_, 's>], step| {
            if steps.contains(&step) {
                let states = tangents.iter().map(|tangent| [tangent.positions.clone(), tangent.velocities.clone()]);
                found.iter_mut().zip(states).for_each(|(found, state)| found.push(state));
            }
        };
        record(&mut found, &tangents, 0);
        let keeps_all = self.records.len() == self.steps() + 1;
        let mut forward = if keeps_all { None } else { Some(Forward::new(self, &first.state)?) };
        for step in 0..steps.last().copied().unwrap_or(0) {
            let mut earlier = None;
            let (before, here, next) = match &mut forward {
                None => (
                    step.checked_sub(1).map(|before| &self.records[before]),
                    &self.records[step],
                    &self.records[step + 1],
                ),
                Some(forward) => {
                    earlier.clone_from(&forward.before);
                    forward.step(self, step)?;
                    (earlier.as_ref(), forward.before.as_ref().unwrap_or(first), &forward.here)
                }
            };
            for (number, tangent) in tangents.iter_mut().enumerate() {
                tangent.step(step, before, [here, next], &mut jacobian, number == 0)?;
            }
            record(&mut found, &tangents, step + 1);
        }
        Ok(found)
    }

    /// The time step of a core, and β of BDF2, where a step begins.
    fn core(&self, step: usize) -> [f64; 2] {
        let h = self.lengths[step];
        match self.scheme {
            Scheme::BackwardEuler | Scheme::Verlet => [h, 0.0],
            Scheme::ImplicitMidpoint => [0.5 * h, 0.0],
            Scheme::Bdf2 => {
                let omega = step.checked_sub(1).map_or(0.0, |before| h / self.lengths[before]);
                [h * (1.0 + omega) / (1.0 + 2.0 * omega), omega * omega / (1.0 + 2.0 * omega)]
            }
        }
    }

    /// (x̃, ṽ) of a core, at its start.
    fn base(&self, step: usize, before: Option<&Record>, here: &State) -> State {
        let [tau, beta] = self.core(step);
        let mut base = here.clone();
        base.time = here.time + self.lengths[step] - tau;
        if self.scheme == Scheme::ImplicitMidpoint {
            base.time = here.time;
        }
        if let Some(Record { state: before, .. }) = before.filter(|_| beta != 0.0) {
            for (base, before) in [(&mut base.positions, &before.positions), (&mut base.velocities, &before.velocities)]
            {
                base.iter_mut().zip(before).for_each(|(x, before)| *x += (*x - before) * beta);
            }
        }
        base
    }

    /// The configuration that a core solved for, with its velocities, from the states before and after it.
    fn solved(&self, step: usize, base: &State, here: &State, next: &State) -> State {
        let [tau, _] = self.core(step);
        let mut solved = next.clone();
        if self.scheme == Scheme::ImplicitMidpoint {
            solved.time = base.time + tau;
            solved.positions.iter_mut().zip(&here.positions).for_each(|(x, before)| *x = (*x + before) * 0.5);
        }
        for ((v, x), base) in solved.velocities.iter_mut().zip(&solved.positions).zip(&base.positions) {
            *v = (x - base) / tau;
        }
        solved
    }
}

/// The way forwards.
struct Forward<'s> {
    stepper: Option<BackwardEuler<'s>>,
    here: Record,
    before: Option<Record>,
}

impl<'s> Forward<'s> {
    fn new(run: &DifferentiableRun<'s>, start: &State) -> Result<Self> {
        let system = run.system;
        SpringGeometry::at(system, start)?;
        let mut acceleration = Vec::new();
        let stepper = if run.scheme == Scheme::Verlet {
            acceleration = accelerations(system, start)?;
            None
        } else {
            let linear = SolverOptions::default().with_solver(SolverChoice::Llt);
            let options = ImplicitOptions::default().with_linear(linear);
            let newton = NewtonOptions { tolerance: TOLERANCE, ..NewtonOptions::default() };
            Some(BackwardEuler::new(system, start, &options, newton)?)
        };
        Ok(Self { stepper, here: Record { state: start.clone(), acceleration }, before: None })
    }

    fn step(&mut self, run: &DifferentiableRun<'s>, step: usize) -> Result<()> {
        let (system, h) = (run.system, run.lengths[step]);
        let here = &self.here;
        let mut next = here.clone();
        match &mut self.stepper {
            None => {
                let free = |p: usize| system.dofs().free_axes(p);
                let State { positions, velocities, .. } = &here.state;
                let mut predicted = next.state.clone();
                predicted.time += h;
                for p in 0..system.particles() {
                    for axis in free(p).iter() {
                        let (v, a) = (velocities[p][axis], here.acceleration[p][axis]);
                        predicted.positions[p][axis] = positions[p][axis] + h * (v + 0.5 * h * a);
                        predicted.velocities[p][axis] = v + h * a;
                    }
                }
                predicted.prescribe(system);
                next.acceleration = accelerations(system, &predicted)?;
                next.state = predicted;
                for p in 0..system.particles() {
                    for axis in free(p).iter() {
                        let mean = 0.5 * (here.acceleration[p][axis] + next.acceleration[p][axis]);
                        next.state.velocities[p][axis] = velocities[p][axis] + h * mean;
                    }
                }
            }
            Some(stepper) => {
                let [tau, _] = run.core(step);
                let mut solved = run.base(step, self.before.as_ref(), &here.state);
                stepper.step(&mut solved, tau).map_err(|failure| broken(step, here.state.time, &failure))?;
                if run.scheme == Scheme::ImplicitMidpoint {
                    let start = &here.state;
                    for (middle, start) in
                        [(&mut solved.positions, &start.positions), (&mut solved.velocities, &start.velocities)]
                    {
                        middle.iter_mut().zip(start).for_each(|(middle, start)| *middle = *middle * 2.0 - start);
                    }
                }
                solved.time = here.state.time + h;
                solved.prescribe(system);
                next.state = solved;
            }
        }
        if !next.state.is_finite() {
            return Err(broken(step, here.state.time, &StepFailure::NonFinite));
        }
        self.before = Some(std::mem::replace(&mut self.here, next));
        Ok(())
    }
}

fn broken(step: usize, time: f64, failure: &StepFailure) -> Error {
    Error::Unsupported(format!("step {}, from t = {time} s, broke down: {failure}", step + 1))
}

/// M⁻¹ F of free coordinates.
fn accelerations(system: &System, state: &State) -> Result<Vec<Vector3<f64>>> {
    let mut force = vec![Vector3::zeros(); system.particles()];
    set_total_force(system, &state.moment(), &mut force)?;
    for (p, (f, mass)) in force.iter_mut().zip(system.masses()).enumerate() {
        let free = system.dofs().free_axes(p);
        *f = Vector3::from_fn(|axis, _| if free.contains(axis) { f[axis] / mass } else { 0.0 });
    }
    Ok(force)
}

/// `J = A − D` of a core step, or its transpose.
struct Jacobian<'s> {
    system: &'s System,
    matrices: Matrices<'s>,
    ldlt: Ldlt,
    a: SymmetricMatrix,
    geometry: SpringGeometry,
    velocities: Vec<Vector3<f64>>,
    is_factored: bool,
}

/// Corrections at most, the error that counts as rounding, and the contraction below which another correction pays.
const CORRECTIONS: usize = 40;
const SOLVED: f64 = 1e-15;
const CONTRACTS: f64 = 0.5;

impl<'s> Jacobian<'s> {
    fn new(system: &'s System, state: &State) -> Result<Self> {
        let matrices = Matrices::new(system)?;
        let a = matrices.k().scaled(1.0);
        let ldlt = Ldlt::analyse(a.pattern(), Par::Seq)?;
        let geometry = SpringGeometry::at(system, state)?;
        Ok(Self { system, matrices, ldlt, a, geometry, velocities: Vec::new(), is_factored: false })
    }

    /// Linearises at a solved configuration.
    fn set(&mut self, solved: &State, tau: f64) -> Result<()> {
        self.geometry.update(self.system, solved)?;
        self.velocities.clone_from(&solved.velocities);
        self.matrices.update(solved, Stiffness::Full)?;
        self.a = self.matrices.a(tau)?;
        self.is_factored = self.ldlt.factor(&self.a).is_ok();
        Ok(())
    }

    fn full(&self, reduced: &[f64]) -> Vec<Vector3<f64>> {
        let mut full = vec![Vector3::zeros(); self.system.particles()];
        self.system.dofs().scatter(reduced, &mut full);
        full
    }

    /// `D u`, or `Dᵀ u`, on all particles.
    fn turned(&self, u: &[Vector3<f64>], is_transposed: bool) -> Vec<Vector3<f64>> {
        let mut result = vec![Vector3::zeros(); u.len()];
        if !is_transposed {
            add_damping_differential(self.system, &self.geometry, &self.velocities, u, &mut result);
            return result;
        }
        for ((_, [i, j], spring), at) in self.geometry.springs(self.system) {
            if spring.damping > 0.0 && at.length > 0.0 {
                let (n, v, u) = (at.direction, self.velocities[i] - self.velocities[j], u[i] - u[j]);
                let across = |w: Vector3<f64>| (w - n * n.dot(&w)) / at.length;
                let change = -(across(u) * n.dot(&v) + across(v) * n.dot(&u)) * spring.damping;
                result[i] += change;
                result[j] -= change;
            }
        }
        result
    }

    /// `(K + D)ᵀ u` on all particles.
    fn stiffness_adjoint(&self, u: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut result = self.turned(u, true);
        add_elastic_differential(self.system, &self.geometry, u, &mut result);
        result
    }

    /// `(K + D) u` on all particles.
    fn stiffness_change(&self, u: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut result = self.turned(u, false);
        add_elastic_differential(self.system, &self.geometry, u, &mut result);
        result
    }

    /// `G u` on all particles; G is symmetric.
    fn damping(&self, u: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut result = vec![Vector3::zeros(); u.len()];
        add_damping_product(self.system, &self.geometry, u, &mut result);
        result
    }

    /// Solves with J or its transpose: `x ← x + A⁻¹ (b − J x)` until it no longer gets better.
    fn solve(&mut self, b: &[f64], is_transposed: bool) -> Result<Vec<f64>> {
        let (mut x, mut rest) = (vec![0.0; b.len()], b.to_vec());
        let (size, mut before) = (norm(b), f64::INFINITY);
        if size == 0.0 {
            return Ok(x);
        }
        for _ in 0..CORRECTIONS {
            if !self.is_factored {
                break;
            }
            let mut correction = rest;
            self.ldlt.substitute_columns(b.len(), &mut correction);
            x.iter_mut().zip(&correction).for_each(|(x, d)| *x += d);
            rest = self.defect(b, &x, is_transposed);
            // The defect of a solve as good as rounding lets it be is that of its products.
            let (left, floor) = (norm(&rest), SOLVED * (size + self.size() * norm(&x)));
            if left <= floor || left <= 1e3 * floor && left > CONTRACTS * before {
                return Ok(x);
            }
            if !(left <= CONTRACTS * before.min(1e6 * size)) {
                break;
            }
            before = left;
        }
        self.solve_unsymmetric(b, is_transposed)
    }

    fn size(&self) -> f64 {
        self.a.norm_inf(&mut vec![0.0; self.a.order()])
    }

    fn defect(&self, b: &[f64], x: &[f64], is_transposed: bool) -> Vec<f64> {
        let mut product = vec![0.0; b.len()];
        self.a.apply(x, &mut product);
        let mut turned = vec![0.0; b.len()];
        if self.system.is_damped() {
            self.system.dofs().gather(&self.turned(&self.full(x), is_transposed), &mut turned);
        }
        b.iter().zip(&product).zip(&turned).map(|((b, ax), dx)| b - (ax - dx)).collect()
    }

    /// By a sparse factorization L U of J.
    fn solve_unsymmetric(&self, b: &[f64], is_transposed: bool) -> Result<Vec<f64>> {
        let dofs = self.system.dofs();
        let mut entries: Vec<Triplet<usize, usize, f64>> = Vec::new();
        for (row, column, value) in self.a.iter() {
            entries.push(Triplet::new(row, column, value));
            if row != column {
                entries.push(Triplet::new(column, row, value));
            }
        }
        for ((_, [i, j], spring), at) in
            self.geometry.springs(self.system).filter(|((_, _, spring), _)| spring.damping > 0.0)
        {
            let v = self.velocities[i] - self.velocities[j];
            for (other, sign) in [(i, 1.0), (j, -1.0)] {
                for (column, axis) in dofs.rows(other).zip(dofs.free_axes(other).iter()) {
                    let change = spring.damping_differential(at, &v, &Vector3::ith(axis, sign));
                    for (end, sign) in [(i, -1.0), (j, 1.0)] {
                        for (row, axis) in dofs.rows(end).zip(dofs.free_axes(end).iter()) {
                            entries.push(Triplet::new(row, column, sign * change[axis]));
                        }
                    }
                }
            }
        }
        let singular = || Error::Unsupported("the Jacobian of a step is singular".into());
        let jacobian = SparseColMat::try_new_from_triplets(b.len(), b.len(), &entries).map_err(|_| singular())?;
        let factored = jacobian.sp_lu().map_err(|_| singular())?;
        let mut x = faer::Col::from_fn(b.len(), |row| b[row]);
        match is_transposed {
            true => factored.solve_transpose_in_place(x.as_mat_mut()),
            false => factored.solve_in_place(x.as_mat_mut()),
        }
        let x: Vec<f64> = x.iter().copied().collect();
        if x.iter().all(|x| x.is_finite()) { Ok(x) } else { Err(singular()) }
    }
}

/// A state from which others can be computed again.
struct Snapshot {
    step: usize,
    here: Record,
    before: Option<Record>,
}

/// The way backwards: cotangents of the state at hand, of the one before (which BDF2 uses too), and of parameters.
struct Reverse<'r, 's> {
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
    fn new(run: &'r DifferentiableRun<'s>, cotangents: &'r [Cotangent]) -> Result<Self> {
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

    fn add_cotangents(&mut self, step: usize) {
        for cotangent in self.cotangents.iter().filter(|cotangent| cotangent.step == step) {
            self.positions.iter_mut().zip(&cotangent.positions).for_each(|(sum, x)| *sum += x);
            self.velocities.iter_mut().zip(&cotangent.velocities).for_each(|(sum, v)| *sum += v);
        }
    }

    /// The steps from a snapshot to `end`, backwards, with room for a number of states.
    fn sweep(&mut self, from: &Snapshot, end: usize, room: usize) -> Result<()> {
        let count = end - from.step;
        let (here, before) = (from.here.clone(), from.before.clone());
        (self.forward.here, self.forward.before) = (here, before);
        if count <= room.max(1) {
            let mut records = vec![from.here.clone()];
            for step in from.step..end {
                self.forward.step(self.run, step)?;
                records.push(self.forward.here.clone());
            }
            for k in (0..count).rev() {
                let before = if k > 0 { Some(&records[k - 1]) } else { from.before.as_ref() };
                self.step(from.step + k, before, &records[k], &records[k + 1])?;
            }
            return Ok(());
        }
        let middle = from.step + split(count, room);
        for step in from.step..middle {
            self.forward.step(self.run, step)?;
        }
        let there = Snapshot { step: middle, here: self.forward.here.clone(), before: self.forward.before.clone() };
        self.sweep(&there, end, room - 1)?;
        self.sweep(from, middle, room)
    }

    /// One step backwards.
    fn step(&mut self, step: usize, before: Option<&Record>, here: &Record, next: &Record) -> Result<()> {
        if self.run.scheme == Scheme::Verlet {
            self.verlet(step, here, next)?
        } else {
            self.implicit(step, before, here, next)?
        }
        self.add_cotangents(step);
        Ok(())
    }

    fn implicit(&mut self, step: usize, before: Option<&Record>, here: &Record, next: &Record) -> Result<()> {
        let Self { run, jacobian, result, .. } = self;
        let (system, [tau, beta]) = (run.system, run.core(step));
        let base = run.base(step, before, &here.state);
        let solved = run.solved(step, &base, &here.state, &next.state);
        jacobian.set(&solved, tau)?;
        let doubles = if run.scheme == Scheme::ImplicitMidpoint { 2.0 } else { 1.0 };
        let dofs = system.dofs();
        let full: Vec<_> = self.positions.iter().zip(&self.velocities).map(|(x, v)| (x + v / tau) * doubles).collect();
        let mut right = vec![0.0; dofs.len()];
        dofs.gather(&full, &mut right);
        let solution = jacobian.solve(&right, true)?;
        let adjoint = jacobian.full(&solution);
        let (damped, moved) = (jacobian.damping(&adjoint), jacobian.stiffness_adjoint(&adjoint));
        result.add_force_adjoint(
            system,
            &Point { geometry: &jacobian.geometry, velocities: &solved.velocities, time: solved.time },
            &adjoint,
        );
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

    /// With cotangents of x', v' and a': those of x, v and a, of `v½ = v + ½h a`, `x' = x + h v½`, `v* = v + h a`, `a' = M⁻¹F(x', v*)`, `v' = v½ + ½h a'`.
    fn verlet(&mut self, step: usize, here: &Record, next: &Record) -> Result<()> {
        let (system, h) = (self.run.system, self.run.lengths[step]);
        let mut predicted = next.state.clone();
        for (p, v) in predicted.velocities.iter_mut().enumerate() {
            for axis in system.dofs().free_axes(p).iter() {
                v[axis] = here.state.velocities[p][axis] + h * here.acceleration[p][axis];
            }
        }
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
        jacobian.geometry.update(system, at)?;
        jacobian.velocities.clone_from(&at.velocities);
        let free = |p: usize, axis: usize| system.dofs().free_axes(p).contains(axis);
        let scaled = |(p, a): (usize, &Vector3<f64>)| {
            Vector3::from_fn(|axis, _| if free(p, axis) { a[axis] / system.masses()[p] } else { 0.0 })
        };
        let adjoint: Vec<_> = cotangent.iter().enumerate().map(scaled).collect();
        result.add_force_adjoint(
            system,
            &Point { geometry: &jacobian.geometry, velocities: &at.velocities, time: at.time },
            &adjoint,
        );
        for ((mass, u), a) in result.masses.iter_mut().zip(&adjoint).zip(acceleration) {
            *mass -= u.dot(a);
        }
        Ok([jacobian.stiffness_adjoint(&adjoint), jacobian.damping(&adjoint)])
    }

    fn finish(mut self, first: &Record) -> Result<Parameters> {
        if self.run.scheme == Scheme::Verlet {
            let cotangent = std::mem::take(&mut self.accelerations);
            let [moved, damped] = self.force_adjoint(&first.state, &first.acceleration, &cotangent)?;
            self.positions.iter_mut().zip(&moved).for_each(|(x, moved)| *x += moved);
            self.velocities.iter_mut().zip(&damped).for_each(|(v, damped)| *v += damped);
        }
        let dofs = self.run.system.dofs();
        for (p, v) in self.velocities.iter_mut().enumerate() {
            let free = dofs.free_axes(p);
            *v = Vector3::from_fn(|axis, _| if free.contains(axis) { v[axis] } else { 0.0 });
        }
        (self.result.positions, self.result.velocities) = (self.positions, self.velocities);
        Ok(self.result)
    }
}

/// Where a sweep over `count` steps with room for some states sets its next checkpoint: so that with r passes over each step the rest, of at most
/// `C(room − 1 + r, r)` steps, needs one state less.
fn split(count: usize, room: usize) -> usize {
    let reaches =
        |room: usize, passes: usize| (1..=passes).fold(1.0, |product: f64, k| product * (room + k) as f64 / k as f64);
    let passes = (1..).find(|&passes| reaches(room, passes) >= count as f64).unwrap_or(1);
    let rest = reaches(room - 1, passes).min(count as f64 - 1.0) as usize;
    (count - rest.max(1)).max(1)
}

/// The way forwards of a change.
struct Tangent<'r, 's> {
    run: &'r DifferentiableRun<'s>,
    change: &'r Parameters,
    positions: Vec<Vector3<f64>>,
    velocities: Vec<Vector3<f64>>,
    accelerations: Vec<Vector3<f64>>,
    before: [Vec<Vector3<f64>>; 2],
}

impl<'r, 's> Tangent<'r, 's> {
    fn new(
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
    fn acceleration_change(
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
    fn step(
        &mut self,
        step: usize,
        before: Option<&Record>,
        [here, next]: [&Record; 2],
        jacobian: &mut Jacobian<'s>,
        is_first: bool,
    ) -> Result<()> {
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
            for p in 0..particles {
                self.velocities[p] += (self.accelerations[p] + after[p]) * (0.5 * h);
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

#[cfg(test)]
mod tests;
