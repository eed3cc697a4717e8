//! The eighth-order Runge–Kutta method of Dormand and Prince, as the crate `ivp` has it: nothing but the force is shared with this crate's methods.

use super::Deadline;
use crate::accuracy::extent;
use crate::force::{SpringGeometry, set_accelerations};
use crate::system::{State, System};
use ivp::dense::StepInterpolant;
use ivp::ivp::FirstOrderSystem;
use ivp::methods::{DOP853, Tolerance};
use ivp::solout::{ControlFlag, SolOut};
use ivp::status::Status;
use nalgebra::Vector3;
use std::cell::RefCell;
use std::time::Instant;

/// The right-hand side `(x, v)' = (v, M⁻¹ f(x, v, t))` on the free coordinates.
struct Motions<'s> {
    system: &'s System,
    /// A time between kinks: prescribed velocities are constant around it.
    middle: f64,
    scratch: RefCell<Scratch>,
}

struct Scratch {
    state: State,
    extensions: SpringGeometry,
    accelerations: Vec<Vector3<f64>>,
    reduced: Vec<f64>,
}

impl FirstOrderSystem for Motions<'_> {
    fn derivative(&self, t: f64, y: &[f64], dy: &mut [f64]) {
        let system = self.system;
        let n = system.dofs().len();
        let ((x, v), (dx, dv)) = (y.split_at(n), dy.split_at_mut(n));
        dx.copy_from_slice(v);
        let Scratch { state, extensions, accelerations, reduced } = &mut *self.scratch.borrow_mut();
        set_state(system, t, x, v, state);
        system.prescribed().set_velocities(self.middle, &mut state.velocities);
        if extensions.update(system, &*state).is_err() {
            // The method rejects a step with an undefined derivative.
            dv.fill(f64::NAN);
            return;
        }
        set_accelerations(system, extensions, &state.moment(), accelerations);
        system.dofs().gather(accelerations, reduced);
        dv.copy_from_slice(reduced);
    }
}

fn set_state(system: &System, t: f64, x: &[f64], v: &[f64], state: &mut State) {
    state.time = t;
    state.prescribe(system);
    system.dofs().scatter(x, &mut state.positions);
    system.dofs().scatter(v, &mut state.velocities);
}

/// Holds the state reached, and ends an integration that would take too long.
struct StepObserver {
    reached: Vec<f64>,
    span: [f64; 2],
    begin: Instant,
    deadline: Deadline,
}

impl StepObserver {
    /// True where the deadline has passed, or will by far at the present rate.
    fn is_hopeless(&self, time: f64) -> bool {
        let (elapsed, allowed) = (self.begin.elapsed(), self.deadline.since(self.begin));
        let share = (time - self.span[0]) / (self.span[1] - self.span[0]);
        elapsed > allowed || (10 * elapsed > allowed && elapsed.as_secs_f64() > 2.0 * share * allowed.as_secs_f64())
    }
}

impl SolOut for StepObserver {
    fn solout(&mut self, _: f64, t: &mut f64, y: &mut [f64], _: Option<&StepInterpolant<'_>>) -> ControlFlag {
        self.reached.copy_from_slice(y);
        if self.is_hopeless(*t) { ControlFlag::Interrupt } else { ControlFlag::Continue }
    }
}

/// The state `duration` seconds on by the crate `ivp`, to a relative and (times the extent) absolute local tolerance; `None` when the method gives up
/// or the deadline passes. Kinks of prescribed motions, of gravity and of rest lengths are ends of integration intervals.
pub fn dop853(
    system: &System,
    start: &State,
    duration: f64,
    tolerance: f64,
    deadline: impl Into<Deadline>,
) -> Option<State> {
    let n = system.dofs().len();
    let mut state = start.clone();
    let end = start.time + duration;
    let mut reached = vec![0.0; 2 * n];
    let (x, v) = reached.split_at_mut(n);
    system.dofs().gather(&state.positions, x);
    system.dofs().gather(&state.velocities, v);
    if n > 0 {
        let absolute = tolerance * extent(&start.positions, &start.positions);
        let span = [start.time, end];
        let mut observer = StepObserver { reached, span, begin: Instant::now(), deadline: deadline.into() };
        let mut from = start.time;
        for to in kinks(system, start.time, end) {
            interval(system, &state, [from, to], [tolerance, absolute], &mut observer)?;
            from = to;
        }
        reached = observer.reached;
    }
    let (x, v) = reached.split_at(n);
    set_state(system, end, x, v, &mut state);
    state.is_finite().then_some(state)
}

fn interval(
    system: &System,
    state: &State,
    [from, to]: [f64; 2],
    [relative, absolute]: [f64; 2],
    observer: &mut StepObserver,
) -> Option<()> {
    let scratch = Scratch {
        state: state.clone(),
        extensions: SpringGeometry::at(system, state).ok()?,
        accelerations: vec![Vector3::zeros(); system.particles()],
        reduced: vec![0.0; system.dofs().len()],
    };
    let motions = Motions { system, middle: 0.5 * (from + to), scratch: RefCell::new(scratch) };
    // No limit of steps, and no search for stiffness: a stiff problem only takes longer, which the deadline bounds.
    let method = DOP853 { max_steps: usize::MAX, stiff_test: usize::MAX, dense_output: false, ..DOP853::default() };
    let [relative, absolute] = [relative, absolute].map(Tolerance::Scalar);
    let begin = observer.reached.clone();
    let outcome = method.solve(&motions, from, &begin, to, relative, absolute, Some(observer)).ok()?;
    (outcome.status == Status::Success).then_some(())
}

/// The times in (start, end) of kinks of what is given in time, and the end.
pub(super) fn kinks(system: &System, start: f64, end: f64) -> Vec<f64> {
    let mut kinks = system.prescribed().kinks();
    kinks.retain(|&t| t > start && t < end);
    kinks.push(end);
    kinks.dedup();
    kinks
}

#[cfg(test)]
mod tests {
    use super::dop853;
    use crate::accuracy::{Configuration, StepControl, trial};
    use crate::integrate::{ImplicitOptions, Method, Status};
    use crate::spring::Spring;
    use crate::system::{Actuation, Axes, Behaviour, Constraint, Curve, Motion, State, System, SystemBuilder};
    use nalgebra::Vector3;
    use std::time::{Duration, Instant};

    fn far() -> Instant {
        Instant::now() + Duration::from_secs(600)
    }

    /// A damped oscillator on an anchor that moves, with its rate of decay and its frequency.
    fn oscillator(motion: Motion) -> (System, State, f64, f64) {
        let (k, l0, m, b) = (50.0, 0.8, 0.7, 1.3);
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.0, 0.0, 0.0], m);
        builder.spring(0, 1, Spring { stiffness: k, rest_length: l0, damping: b });
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
        let (system, start) = builder.build().unwrap();
        let (rate, square): (f64, f64) = (b / (2.0 * m), k / (l0 * m));
        (system, start, rate, (square - rate * rate).sqrt())
    }

    /// The anchor goes at 0.4 m/s up to 1 s, at −0.6 m/s up to 3 s, at 0.5 m/s up to 4 s, and stands still from then on. Seen from it, with u the
    /// length less its rest length, `m ü + b u̇ + (k/l0) u = 0`, which the anchor's changes of velocity strike. The method is right to a hundred
    /// tolerances; of low order in time it takes tens of thousands of steps, which add up to more.
    #[test]
    fn forces_that_depend_on_time_keep_the_order() {
        let l0 = 0.8;
        let offsets = [0.0, 0.4, -0.8, -0.3].map(|x| Vector3::new(x, 0.0, 0.0)).to_vec();
        let (system, start, rate, omega) = oscillator(Motion::Path { times: vec![0.0, 1.0, 3.0, 4.0], offsets });
        let end = dop853(&system, &start, 5.0, 1e-9, far()).unwrap();
        let (mut u, mut slope, mut before) = (0.2f64, 0.0f64, 0.0);
        for (t, velocity) in [(1.0f64, 0.4), (2.0, -0.6), (1.0, 0.5), (1.0, 0.0)] {
            slope += before - velocity;
            before = velocity;
            let (fade, sine, cosine) = ((-rate * t).exp(), (omega * t).sin(), (omega * t).cos());
            let across = (slope + rate * u) / omega;
            let at = fade * (u * cosine + across * sine);
            slope = fade * omega * (across * cosine - u * sine) - rate * at;
            u = at;
        }
        let error = (end.positions[1].x - (l0 - 0.3 + u)).abs();
        assert!(error < 1e-7, "{error:e}");
    }

    /// A rest length that shrinks to half and grows again: this crate's own DOP853 shares no code with the method here but the forces, and those
    /// at other times by another path.
    #[test]
    fn rest_lengths_may_change_in_time() {
        let (system, start, ..) = oscillator(Motion::Held);
        let factors = Curve { times: vec![0.3, 0.9, 1.1], values: vec![1.0, 0.5, 1.2] };
        let actuation = vec![Actuation { springs: vec![0], factors }];
        let system = system.with_behaviour(Behaviour { actuation, ..Behaviour::default() }).unwrap();
        let end = dop853(&system, &start, 2.0, 1e-10, far()).unwrap();
        let own = Configuration { method: Method::Dop853, options: ImplicitOptions::default() };
        let control = StepControl::Adaptive { rtol: 1e-11, first_step: None };
        let own = trial(&system, &start, &own, control, 2.0, &|| true).unwrap();
        let difference = (end.positions[1].x - own.state.positions[1].x).abs();
        assert!(own.status == Status::Completed && difference < 1e-8, "{difference:e}");
    }

    /// A damper of 10⁵ kg/s on 1 kg lets the spring draw it back at κ/b alone: stiff, and 2·10⁵ steps of any explicit method.
    #[test]
    fn stiff_motions_take_as_many_steps_as_they_need() {
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.3, 0.0, 0.0], 1.0);
        builder.spring(0, 1, Spring { stiffness: 1e4, rest_length: 1.0, damping: 1e5 });
        builder.hold(0);
        let (system, start) = builder.build().unwrap();
        let end = dop853(&system, &start, 12.0, 1e-4, far()).unwrap();
        // The slow rate is κ/b (1 + κ/b²) with κ = k/l0.
        let expected = 1.0 + 0.3 * (-12.0 * 0.1 * (1.0 + 1e-6f64)).exp();
        assert!((end.positions[1].x - expected).abs() < 1e-3, "{} {expected}", end.positions[1].x);
    }

    /// There is nothing to integrate where all is prescribed.
    #[test]
    fn prescribed_particles_are_where_they_are_told_to_be() {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], 1.0);
        let motion = Motion::Velocity(Vector3::new(0.5, 0.0, 0.0));
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
        let (system, start) = builder.build().unwrap();
        let end = dop853(&system, &start, 3.0, 1e-9, far()).unwrap();
        assert_eq!((end.time, end.positions[0].x), (3.0, 1.5));
    }

    /// Less than a tenth of the time says nothing; after that the rate may be half of what it should be.
    #[test]
    fn runs_that_would_take_too_long_are_hopeless() {
        use super::StepObserver;
        let is_hopeless = |elapsed: u64, allowed: u64, time: f64| {
            let begin = Instant::now().checked_sub(Duration::from_secs(elapsed)).unwrap();
            let deadline = (begin + Duration::from_secs(allowed)).into();
            StepObserver { reached: Vec::new(), span: [2.0, 12.0], begin, deadline }.is_hopeless(time)
        };
        for (elapsed, allowed, time, expected) in [
            (150, 1000, 2.7, true),
            (150, 1000, 2.8, false),
            (99, 1000, 2.0, false),
            (1010, 1000, 12.0, true),
            (990, 1000, 12.0, false),
            (990, 1000, 6.0, true),
        ] {
            assert_eq!(is_hopeless(elapsed, allowed, time), expected, "{elapsed} of {allowed} s at {time}");
        }
    }
}
