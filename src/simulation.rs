//! One entry to all runs: a system, options, and a result.

use crate::error::{Invalid, Result};
use crate::force::Energy;
use crate::integrate::{Balance, Method, Monitor, RunFailure, Schedule, Statistics, Status, StiffnessPolicy};
use crate::linear::SolverChoice;
use crate::plan::{DEFAULT_STEP, MethodChoice, RunOptions, records_every};
use crate::system::{State, System};
use std::ops::ControlFlow;

/// A run of a system from a state. The defaults are those of the command: without a dt steps are adaptive, without a method the
/// stiffness of the scene decides.
///
/// # Examples
/// ```
/// use sprung::{Method, Simulation, Spring, SystemBuilder};
///
/// let mut builder = SystemBuilder::new();
/// builder.particle([0.0, 0.0, 0.0], 1.0);
/// builder.particle([1.0, 0.0, 0.0], 1.0);
/// builder.spring(0, 1, Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 });
/// builder.hold(0);
/// let (system, state) = builder.build()?;
///
/// let result = Simulation::new(&system, state).method(Method::Bdf2).rtol(1e-3).run(2.0)?;
/// assert_eq!(result.status.name(), "completed");
/// // A particle of 1 kg on 10 N/m, 1 m from rest.
/// let exact = 2.0 - (2.0 * 10.0_f64.sqrt()).cos();
/// assert!((result.state.positions[1].x - exact).abs() < 0.02);
/// assert!(result.error.is_some_and(|error| error < 0.02));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
#[must_use]
pub struct Simulation<'s> {
    system: &'s System,
    state: State,
    options: RunOptions,
    dt: Option<f64>,
    stops_unstable: bool,
    estimates_error: bool,
}

/// The end of a run.
#[derive(Debug, Clone)]
pub struct SimulationResult {
    /// The status at the end.
    pub status: Status,
    /// The failure that ended it, if any.
    pub failure: Option<RunFailure>,
    /// The last good state.
    pub state: State,
    /// The method.
    pub method: Method,
    /// Steps done.
    pub steps: u64,
    /// Work and residuals.
    pub statistics: Statistics,
    /// Energy at the start and at the end, in J.
    pub energy: [Energy; 2],
    /// The energy balance, in J.
    pub balance: Balance,
    /// The estimated relative position error at the end; `None` where nothing is known of it.
    pub error: Option<f64>,
    /// The time, in s, until which positions are predictable to the threshold of warnings; `None` where that is the end.
    pub predictable_until: Option<f64>,
    /// Reasons to doubt the result.
    pub warnings: Vec<String>,
}

impl<'s> Simulation<'s> {
    /// A run of a system from a state.
    pub fn new(system: &'s System, state: State) -> Self {
        let options = RunOptions::default();
        Self { system, state, options, dt: None, stops_unstable: true, estimates_error: true }
    }

    /// By this method.
    pub fn method(mut self, method: Method) -> Self {
        self.options.method = Some(MethodChoice::Named(method));
        self
    }

    /// With steps of dt seconds.
    pub fn dt(self, dt: f64) -> Self {
        Self { dt: Some(dt), ..self }
    }

    /// With adaptive steps of this relative tolerance, between 0 and 1.
    pub fn rtol(mut self, rtol: f64) -> Self {
        self.options.rtol = Some(rtol);
        self
    }

    /// With this stiffness in the matrix: an option, or the policy.
    pub fn stiffness(mut self, stiffness: impl Into<StiffnessPolicy>) -> Self {
        self.options.stiffness = Some(stiffness.into());
        self
    }

    /// With this linear solver.
    pub fn solver(mut self, solver: SolverChoice) -> Self {
        self.options.solver = Some(solver);
        self
    }

    /// With all options at once; `accuracy` is for [`run_to_accuracy`](crate::accuracy::run_to_accuracy) and is ignored here.
    pub fn options(self, options: RunOptions) -> Self {
        Self { options: RunOptions { accuracy: None, ..options }, ..self }
    }

    /// Continues where energy appears without cause.
    pub fn allow_unstable(self) -> Self {
        Self { stops_unstable: false, ..self }
    }

    /// Without an estimate of the error, which is then not known.
    pub fn without_error_estimate(self) -> Self {
        Self { estimates_error: false, ..self }
    }

    /// Runs for `duration` seconds.
    ///
    /// # Errors
    /// A duration, step or tolerance that cannot be used; a state of another system; coincident ends of a spring at the start; a
    /// matrix that is too large; a tolerance for a method without an error estimate. A run that breaks down is a result.
    pub fn run(self, duration: f64) -> Result<SimulationResult> {
        self.run_observed(duration, |_, _| ControlFlow::Continue(()))
    }

    /// As [`run`](Self::run); `observe` sees the state after every step, or 300 samples of adaptive steps, with the monitor. It ends
    /// the run by `Break`.
    ///
    /// # Errors
    /// As of [`run`](Self::run).
    pub fn run_observed(
        self,
        duration: f64,
        mut observe: impl FnMut(&State, &Monitor) -> ControlFlow<()>,
    ) -> Result<SimulationResult> {
        let Self { system, mut state, options, dt, stops_unstable, estimates_error } = self;
        state.check(system)?;
        if let Some(rtol) = options.rtol.filter(|&rtol| !(rtol > 0.0 && rtol < 1.0)) {
            return Err(Invalid::new("rtol", rtol, "must be between 0 and 1").into());
        }
        let rtol = if dt.is_none() { options.rtol_without_step() } else { options.rtol };
        let interval = dt.unwrap_or(if rtol.is_some() { records_every(duration) } else { DEFAULT_STEP });
        Schedule::check(interval, duration)?;
        let schedule = Schedule::duration(interval, duration);
        let plan = options.plan(system, &state, [interval, duration], rtol)?;
        let mut monitor = Monitor::new(system, &state, plan.monitor(stops_unstable, estimates_error))?;
        let mut stepper = plan.stepper(system, &state)?;
        let outcome = stepper.run(system, &mut state, &schedule, &mut monitor, |_, state, monitor| {
            if options.interrupt.is_requested() { ControlFlow::Break(()) } else { observe(state, monitor) }
        });
        let status = outcome.status();
        let indicators = monitor.indicators(&state);
        let is_known = matches!(status, Status::Completed | Status::Interrupted);
        let warnings = if is_known { indicators.warnings(plan.rtol) } else { Vec::new() };
        Ok(SimulationResult {
            status,
            method: plan.configuration.method,
            steps: outcome.steps,
            failure: outcome.end.err(),
            statistics: *stepper.get().statistics(),
            energy: [monitor.initial(), monitor.energy()],
            balance: monitor.balance(),
            error: indicators.estimate.filter(|_| is_known),
            predictable_until: indicators.predictable_until,
            warnings,
            state,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::force::SpringGeometry;
    use crate::integrate::{ImplicitOptions, Matrices};
    use crate::linear::NotFactored;
    use crate::spring::Stiffness;
    use crate::system::fixtures::row;
    use nalgebra::Vector3;

    /// The same bits as the parts that it is made of, for fixed and adaptive steps.
    #[test]
    fn runs_are_those_of_the_plan() {
        let (system, state) = row(4);
        for (dt, rtol) in [(Some(0.03), None), (None, Some(1e-4)), (None, None)] {
            let simulation = Simulation { dt, ..Simulation::new(&system, state.clone()) };
            let simulation = rtol.map_or(simulation.clone(), |rtol| simulation.rtol(rtol));
            let result = simulation.run(1.0).unwrap();
            let options = RunOptions { rtol, ..RunOptions::default() };
            let chosen = if dt.is_some() { None } else { Some(rtol.unwrap_or(1e-2)) };
            let interval = dt.unwrap_or(1.0 / 300.0);
            let plan = options.plan(&system, &state, [interval, 1.0], chosen).unwrap();
            let mut end = state.clone();
            let mut monitor = Monitor::new(&system, &end, plan.monitor(true, true)).unwrap();
            let schedule = Schedule::duration(interval, 1.0);
            let go_on = |_, _: &State, _: &Monitor| ControlFlow::Continue(());
            plan.stepper(&system, &end).unwrap().run(&system, &mut end, &schedule, &mut monitor, go_on);
            assert_eq!(result.error, monitor.indicators(&end).estimate, "{dt:?} {rtol:?}");
            assert_eq!((result.state, result.method), (end, plan.configuration.method), "{dt:?} {rtol:?}");
        }
    }

    #[test]
    fn a_run_ends_where_its_observer_says() {
        let (system, state) = row(3);
        let mut seen = 0;
        let result = Simulation::new(&system, state)
            .dt(0.01)
            .without_error_estimate()
            .run_observed(1.0, |_, _| {
                seen += 1;
                if seen == 7 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            })
            .unwrap();
        assert_eq!((result.status, result.steps, result.error), (Status::Interrupted, 7, None));
    }

    /// Symplectic Euler far beyond its limit of stability.
    #[test]
    fn unstable_runs_end_unless_they_are_allowed() {
        let (system, mut state) = row(4);
        state.velocities[2].x = 1.0;
        let simulation = Simulation::new(&system, state).method(Method::SymplecticEuler).dt(2.0);
        assert_eq!(simulation.clone().run(60.0).unwrap().status, Status::Unstable);
        assert_ne!(simulation.allow_unstable().run(60.0).unwrap().status, Status::Unstable);
    }

    /// Steps and durations that are none, and states of other systems, are errors of every method, and of matrices; nothing moves.
    #[test]
    fn arguments_that_cannot_be_used_are_errors() {
        let (system, start) = row(4);
        let foreign = |count: usize| {
            let rows = |_| (0..count).map(|p| Vector3::new(p as f64, 0.0, 0.0)).collect();
            State { time: 0.0, positions: rows(0), velocities: rows(1) }
        };
        let short = State { velocities: start.velocities[1..].to_vec(), ..start.clone() };
        for method in Method::ALL {
            let simulation = Simulation::new(&system, start.clone()).method(method);
            for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
                assert!(simulation.clone().dt(wrong).run(1.0).is_err(), "{} {wrong}", method.name());
                // A run of no length is one: of no steps.
                assert_eq!(simulation.clone().dt(0.1).run(wrong).is_ok(), wrong == 0.0, "{} {wrong}", method.name());
                assert!(simulation.clone().rtol(wrong).run(1.0).is_err(), "{} {wrong}", method.name());
            }
            for state in [foreign(0), foreign(3), foreign(5), short.clone()] {
                assert!(method.stepper(&system, &state, &ImplicitOptions::default()).is_err(), "{}", method.name());
                assert!(Simulation::new(&system, state).method(method).run(1.0).is_err());
            }
        }
        let mut matrices = Matrices::new(&system).unwrap();
        assert!(matrices.a(0.1).is_err() && matrices.b(&start, 0.1).is_err(), "no state yet");
        for state in [foreign(0), foreign(3), foreign(5), short] {
            assert!(matrices.update(&state, Stiffness::Full).is_err());
        }
        matrices.update(&start, Stiffness::Full).unwrap();
        assert!(matrices.b(&foreign(3), 0.1).is_err());
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(matrices.a(wrong).is_err() && matrices.b(&start, wrong).is_err(), "{wrong}");
        }
        let mut factor = matrices.a(0.1).unwrap().cholesky().unwrap();
        for length in [0, system.dofs().len() - 1, system.dofs().len() + 1] {
            assert!(factor.solve(&vec![1.0; length]).is_err(), "{length}");
        }
        // Pressed together the springs make A indefinite for a long step.
        let mut pressed = start.clone();
        pressed.positions.iter_mut().for_each(|x| *x *= 0.5);
        if SpringGeometry::at(&system, &pressed).is_ok() {
            matrices.update(&pressed, Stiffness::Full).unwrap();
            let a = matrices.a(1e3).unwrap();
            assert!(matches!(a.cholesky(), Err(NotFactored::Pivot(_))) && a.ldlt().is_ok());
        }
    }
}
