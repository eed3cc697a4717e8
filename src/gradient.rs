//! Gradients through a motion: discrete adjoints, exact for the numbers that a run computes.
//!
//! **One core.** Backward Euler over τ from (x̃, ṽ) solves
//!
//! ```text
//! M (x' − x̃ − τ ṽ)/τ² = F(x', w),      w = v' = (x' − x̃)/τ,
//! ```
//!
//! and three methods are made of it: backward Euler itself; BDF2, with `x̃ = x + β (x − x₋)`, `ṽ = v + β (v − v₋)`; and the implicit midpoint rule, a
//! core step of half the length with `x' = 2x_m − x`, `v' = 2v_m − v`. With cotangents x̄', v̄' of its result and `J = M/τ² − K − G/τ − D`,
//! `D = ∂f_d/∂x`,
//!
//! ```text
//! Jᵀ λ = x̄' + v̄'/τ,    x̃bar = −v̄'/τ + (M/τ² − G/τ) λ,    ṽbar = M λ/τ,    p̄ += (∂F/∂p)ᵀ λ,    m̄ += −λ·(x' − x̃ − τṽ)/τ².
//! ```
//!
//! J is the exact Jacobian, whatever matrix solved the step. Damping makes it unsymmetric: the factor of its symmetric part is refined with D, and
//! where that does not converge J is factored as L U.
//!
//! **Verlet's method** needs products only; its acceleration is carried from step to step, and so is its cotangent.
//!
//! **Memory.** All states are kept where they fit. Beyond, checkpoints are set by binomial bisection (Griewank and Walther, ACM TOMS 26, 2000), and
//! states between them computed again, to the same bits.

mod jacobian;
mod parameters;
mod reverse;
mod tangent;

pub use parameters::Parameters;
pub(crate) use parameters::Point;
pub(crate) use tangent::of_free;

use self::reverse::{Reverse, Snapshot, split};
use self::tangent::Tangents;
use crate::error::{Error, Invalid, Result, check_length};
use crate::force::{DegenerateSpring, SpringGeometry, set_total_force};
use crate::integrate::{BackwardEuler, ImplicitOptions, Method, NewtonOptions, StepFailure, TimeStepper};
use crate::interrupt::Interrupt;
use crate::linear::{SolveFailure, SolverChoice, SolverOptions};
use crate::memory;
use crate::plan::RunOptions;
use crate::simulation::Simulation;
use crate::system::{Dof, State, System};
use nalgebra::Vector3;

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
    method: Method,
    steps: Vec<f64>,
    /// All states, or the first and the last.
    records: Vec<Record>,
    /// Where there is no room for all: the states from which a sweep backwards starts, the first one included.
    snapshots: Vec<Snapshot>,
    checkpoints: usize,
    interrupt: Interrupt,
}

/// A state, and the acceleration that Verlet's method carries.
#[derive(Debug, Clone, PartialEq)]
struct Record {
    state: State,
    acceleration: Vec<Vector3<f64>>,
}

impl<'s> DifferentiableRun<'s> {
    /// Runs for `duration` seconds with steps of dt, the last one shorter where dt does not divide the duration, and keeps as many states as fit in
    /// half of the memory.
    ///
    /// # Errors
    /// A method without an adjoint; a spring law or forces of the caller's own; steps or a duration that cannot be used; a state of another system; a
    /// step that [breaks down](Error::Breakdown).
    pub fn new(system: &'s System, state: &State, method: Method, dt: f64, duration: f64) -> Result<Self> {
        Self::interruptible(system, state, method, [dt, duration], None, Interrupt::NEVER)
    }

    /// As [`new`](Self::new), with room for a number of states or as many as fit; a request to stop ends the run, and later its gradients and
    /// tangents, at the next step.
    ///
    /// # Errors
    /// As of [`new`](Self::new); room for fewer than two states; [`Error::Breakdown`] with the status `interrupted`.
    pub fn interruptible(
        system: &'s System,
        state: &State,
        method: Method,
        [dt, duration]: [f64; 2],
        checkpoints: Option<usize>,
        interrupt: Interrupt,
    ) -> Result<Self> {
        let checkpoints = checkpoints.unwrap_or_else(|| {
            let record = 2 * 72 * system.particles() as u64 + 200;
            (memory::room() / 2 / record).min(usize::MAX as u64) as usize
        });
        if !matches!(method, Method::BackwardEuler | Method::ImplicitMidpoint | Method::Bdf2 | Method::Verlet) {
            let rule = "has no gradient; backward-euler, implicit-midpoint, bdf2 and verlet have one";
            return Err(Invalid::new("method", method.name(), rule).into());
        }
        if system.has_other_laws() || system.external_forces().next().is_some() {
            return Err(Error::Unsupported(
                "gradients are those of the built-in spring law and of loads of the scene".into(),
            ));
        }
        if method == Method::Verlet && system.prescribed().moves() && system.is_damped() {
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
        let mut steps = vec![dt; count];
        if let Some(last) = steps.last_mut() {
            *last = duration - dt * (count - 1) as f64;
        }
        let mut run =
            Self { system, method, steps, records: Vec::new(), snapshots: Vec::new(), checkpoints, interrupt };
        let mut forward = Forward::new(&run, state)?;
        let keeps_all = count < checkpoints;
        run.records.push(forward.here.clone());
        let mut next = 0;
        for step in 0..count {
            if !keeps_all && step == next {
                let Forward { here, before, .. } = &forward;
                // Only BDF2 uses the state before.
                let before = before.clone().filter(|_| method == Method::Bdf2);
                run.snapshots.push(Snapshot { step, here: here.clone(), before });
                next += split(count - step, checkpoints + 1 - run.snapshots.len());
            }
            forward.step(&run, step)?;
            if keeps_all || step + 1 == count {
                run.records.push(forward.here.clone());
            }
        }
        Ok(run)
    }

    /// Steps done.
    pub fn steps(&self) -> usize {
        self.steps.len()
    }

    /// The last state.
    pub fn end(&self) -> &State {
        &self.records[self.records.len() - 1].state
    }

    /// The states that are kept: all, the first one included, or the first and the last.
    pub fn states(&self) -> impl ExactSizeIterator<Item = &State> + '_ {
        self.records.iter().map(|record| &record.state)
    }

    /// The time, in s, from which a gradient says little, because the motion magnifies differences to its own size; `None` where that is later than
    /// the end. Found by a run of the same method with its errors propagated.
    ///
    /// # Errors
    /// As of [`Simulation::run`].
    pub fn predictable_until(&self) -> Result<Option<f64>> {
        let (Some(&dt), Some(first)) = (self.steps.first(), self.records.first()) else { return Ok(None) };
        let duration = self.steps.iter().sum();
        let options = RunOptions { interrupt: self.interrupt, ..RunOptions::default() };
        let run = Simulation::new(self.system, first.state.clone()).options(options).method(self.method).dt(dt);
        let run = run.run(duration)?;
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
        reverse.add_cotangents(self.steps());
        if self.records.len() == self.steps() + 1 {
            for step in (0..self.steps()).rev() {
                reverse.step(step, self.record_before(step), &self.records[step], &self.records[step + 1])?;
            }
        } else {
            let (mut end, mut last) = (self.steps(), &self.records[1]);
            for (taken, snapshot) in self.snapshots.iter().enumerate().rev() {
                reverse.sweep(snapshot, end, last, self.checkpoints - taken)?;
                (end, last) = (snapshot.step, &snapshot.here);
            }
        }
        reverse.finish(&self.records[0])
    }

    /// How the states after some steps change, to first order, with each of several changes of parameters: forward differentiation. The changes share
    /// the factorization of every step.
    ///
    /// # Errors
    /// Parameters of another system; a step whose Jacobian is singular; a step that there is not, or steps that do not ascend.
    pub fn tangents(&self, changes: &[Parameters], steps: &[usize]) -> Result<Vec<Vec<StateChange>>> {
        let [springs, particles] = [self.system.springs().len(), self.system.particles()];
        for change in changes {
            check_length("stiffness", change.stiffness.len(), springs)?;
            check_length("rest_lengths", change.rest_lengths.len(), springs)?;
            check_length("damping", change.damping.len(), springs)?;
            check_length("masses", change.masses.len(), particles)?;
            check_length("loads", change.loads.len(), particles)?;
            check_length("positions", change.positions.len(), particles)?;
            check_length("velocities", change.velocities.len(), particles)?;
        }
        for (index, &step) in steps.iter().enumerate() {
            if step > self.steps() || index > 0 && step <= steps[index - 1] {
                let rule = format!("must ascend, to at most the number of steps, {}", self.steps());
                return Err(Invalid::new("steps", step, rule).at(index).into());
            }
        }
        let first = &self.records[0];
        let mut tangents = Tangents::new(self, changes, first)?;
        let mut found = vec![Vec::with_capacity(steps.len()); changes.len()];
        let keeps_all = self.records.len() == self.steps() + 1;
        let mut forward = if keeps_all { None } else { Some(Forward::new(self, &first.state)?) };
        let last = steps.last().copied().unwrap_or(0);
        for step in 0..=last {
            if steps.contains(&step) {
                found.iter_mut().zip(tangents.states()).for_each(|(found, state)| found.push(state.clone()));
            }
            if step == last {
                break;
            }
            let mut earlier = None;
            let (before, here, next) = match &mut forward {
                None => (self.record_before(step), &self.records[step], &self.records[step + 1]),
                Some(forward) => {
                    earlier.clone_from(&forward.before);
                    forward.step(self, step)?;
                    (earlier.as_ref(), forward.before.as_ref().unwrap_or(first), &forward.here)
                }
            };
            tangents.step(step, before, [here, next])?;
        }
        Ok(found)
    }

    fn record_before(&self, step: usize) -> Option<&Record> {
        step.checked_sub(1).map(|before| &self.records[before])
    }

    fn check_interrupt(&self, step: usize, time: f64) -> Result<()> {
        let stop = || broken(step, time, &SolveFailure::Interrupted.into());
        if self.interrupt.is_requested() { Err(stop()) } else { Ok(()) }
    }

    /// The time step τ of a core, and β of BDF2.
    fn coefficients(&self, step: usize) -> [f64; 2] {
        let h = self.steps[step];
        match self.method {
            Method::ImplicitMidpoint => [0.5 * h, 0.0],
            Method::Bdf2 => {
                let omega = step.checked_sub(1).map_or(0.0, |before| h / self.steps[before]);
                [h * (1.0 + omega) / (1.0 + 2.0 * omega), omega * omega / (1.0 + 2.0 * omega)]
            }
            _ => [h, 0.0],
        }
    }

    fn base(&self, step: usize, before: Option<&Record>, here: &State) -> State {
        let [tau, beta] = self.coefficients(step);
        let mut base = here.clone();
        if self.method != Method::ImplicitMidpoint {
            base.time = here.time + self.steps[step] - tau;
        }
        if let Some(Record { state: before, .. }) = before.filter(|_| beta != 0.0) {
            for (base, before) in [(&mut base.positions, &before.positions), (&mut base.velocities, &before.velocities)]
            {
                base.iter_mut().zip(before).for_each(|(x, before)| *x += (*x - before) * beta);
            }
        }
        base
    }

    fn core(&self, step: usize, before: Option<&Record>, here: &State, next: &State) -> Core {
        let ([tau, beta], base) = (self.coefficients(step), self.base(step, before, here));
        let doubles = self.method == Method::ImplicitMidpoint;
        let mut solved = next.clone();
        if doubles {
            solved.time = base.time + tau;
            solved.positions.iter_mut().zip(&here.positions).for_each(|(x, before)| *x = (*x + before) * 0.5);
            // A path may have a corner within the step.
            solved.prescribe(self.system);
        }
        for ((v, x), base) in solved.velocities.iter_mut().zip(&solved.positions).zip(&base.positions) {
            *v = (x - base) / tau;
        }
        Core { tau, beta, doubles, base, solved }
    }
}

struct Core {
    tau: f64,
    beta: f64,
    /// The core is half of a midpoint step.
    doubles: bool,
    /// (x̃, ṽ).
    base: State,
    /// The configuration that was solved for, with its velocities.
    solved: State,
}

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
        let stepper = if run.method == Method::Verlet {
            acceleration = accelerations(system, start)?;
            None
        } else {
            let linear = SolverOptions::default().with_solver(SolverChoice::Llt);
            let options = ImplicitOptions { linear, ..ImplicitOptions::default() };
            // To rounding: the adjoint is that of a step that was solved.
            let newton = NewtonOptions { tolerance: 1e-13, ..NewtonOptions::default() };
            Some(BackwardEuler::new(system, start, &options, newton)?)
        };
        Ok(Self { stepper, here: Record { state: start.clone(), acceleration }, before: None })
    }

    fn step(&mut self, run: &DifferentiableRun<'s>, step: usize) -> Result<()> {
        let (system, h) = (run.system, run.steps[step]);
        let here = &self.here;
        run.check_interrupt(step, here.state.time)?;
        let mut next = here.clone();
        match &mut self.stepper {
            None => {
                let State { positions, velocities, .. } = &here.state;
                next.state.time += h;
                for Dof { particle: p, axis } in system.dofs().iter() {
                    let (v, a) = (velocities[p][axis], here.acceleration[p][axis]);
                    next.state.positions[p][axis] = positions[p][axis] + h * (v + 0.5 * h * a);
                    next.state.velocities[p][axis] = v + h * a;
                }
                next.state.prescribe(system);
                let degenerate = |spring: DegenerateSpring| broken(step, here.state.time, &spring.into());
                next.acceleration = accelerations(system, &next.state).map_err(degenerate)?;
                for Dof { particle: p, axis } in system.dofs().iter() {
                    let mean = 0.5 * (here.acceleration[p][axis] + next.acceleration[p][axis]);
                    next.state.velocities[p][axis] = velocities[p][axis] + h * mean;
                }
            }
            Some(stepper) => {
                let [tau, _] = run.coefficients(step);
                let mut solved = run.base(step, self.before.as_ref(), &here.state);
                stepper.step(&mut solved, tau).map_err(|failure| broken(step, here.state.time, &failure))?;
                if run.method == Method::ImplicitMidpoint {
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
    Error::Breakdown { step: step + 1, time, status: failure.status().name(), reason: failure.to_string() }
}

fn accelerations(system: &System, state: &State) -> Result<Vec<Vector3<f64>>, DegenerateSpring> {
    let mut force = vec![Vector3::zeros(); system.particles()];
    set_total_force(system, &state.moment(), &mut force)?;
    force.iter_mut().zip(system.masses()).for_each(|(f, mass)| *f /= *mass);
    Ok(of_free(system, &force))
}

#[cfg(test)]
mod tests;
