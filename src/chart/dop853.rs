//! The library's eighth-order Runge–Kutta method of Dormand and Prince on a mass–spring system.
//!
//! Everything between scene and answer is independent of this crate's methods but the force itself: other formulas, other
//! step control, no matrix. The unknowns are the free coordinates, their velocities, and the time, of which prescribed coordinates
//! are functions: the library's table of nodes (0.6.2) has 0 for the twelfth stage, which is at the end of the step, so that the
//! method would be of low order in the time that it hands over.

use super::Deadline;
use crate::accuracy::extent;
use crate::force::{Extensions, add_damping_force, add_elastic_force, add_weight};
use crate::system::{Motion, State, System};
use nalgebra::Vector3;
use ode_solvers::dop_shared::{IntegrationError, OutputType};
use ode_solvers::{DVector, Dop853};
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
    extensions: Extensions,
    force: Vec<Vector3<f64>>,
    reduced: Vec<f64>,
}

impl ode_solvers::System<f64, DVector<f64>> for Motions<'_> {
    fn system(&self, _: f64, y: &DVector<f64>, dy: &mut DVector<f64>) {
        let system = self.system;
        let n = system.dofs().len();
        let (x, rest) = y.as_slice().split_at(n);
        let (v, time) = rest.split_at(n);
        let (dx, rest) = dy.as_mut_slice().split_at_mut(n);
        let (dv, dt) = rest.split_at_mut(n);
        dx.copy_from_slice(v);
        dt.fill(1.0);
        let Scratch { state, extensions, force, reduced } = &mut *self.scratch.borrow_mut();
        set_state(system, time.first().copied().unwrap_or(f64::NAN), x, v, state);
        system.prescribed().set_velocities(self.middle, &mut state.velocities);
        if extensions.update(system, &state.positions).is_err() {
            // The method rejects a step with an undefined derivative.
            dv.fill(f64::NAN);
            return;
        }
        force.fill(Vector3::zeros());
        add_elastic_force(system, extensions, force);
        add_damping_force(system, extensions, &state.velocities, force);
        add_weight(system, force);
        for (f, mass) in force.iter_mut().zip(system.masses()) {
            *f /= *mass;
        }
        system.dofs().gather(force, reduced);
        dv.copy_from_slice(reduced);
    }
}

fn set_state(system: &System, t: f64, x: &[f64], v: &[f64], state: &mut State) {
    state.time = t;
    state.prescribe(system);
    system.dofs().scatter(x, &mut state.positions);
    system.dofs().scatter(v, &mut state.velocities);
}

/// Elapsed time against simulated time.
struct Clock {
    span: [f64; 2],
    begin: Instant,
    deadline: Deadline,
}

impl Clock {
    /// Whether the deadline has passed, or will by far at the present pace.
    fn is_hopeless(&self, reached: f64) -> bool {
        let (elapsed, allowed) = (self.begin.elapsed(), self.deadline.since(self.begin));
        let share = (reached - self.span[0]) / (self.span[1] - self.span[0]);
        elapsed > allowed || (10 * elapsed > allowed && elapsed.as_secs_f64() > 2.0 * share * allowed.as_secs_f64())
    }
}

/// Steps that the library keeps in memory before it is restarted from the last one.
const CHUNK: usize = 256;

/// Doubles that it may keep.
const KEPT: usize = 4_000_000;

/// The state `duration` seconds on, to a relative and (times the extent) absolute local tolerance; `None` when the method
/// gives up or the deadline passes. Kinks of prescribed motions are ends of integration intervals.
///
/// The method of the crate `ode_solvers`.
pub fn dop853(
    system: &System,
    start: &State,
    duration: f64,
    tolerance: f64,
    deadline: impl Into<Deadline>,
) -> Option<State> {
    let n = system.dofs().len();
    let mut state = start.clone();
    let mut reduced = vec![0.0; n];
    let mut y = DVector::zeros(2 * n + 1);
    y[2 * n] = start.time;
    system.dofs().gather(&state.positions, &mut reduced);
    y.rows_mut(0, n).copy_from_slice(&reduced);
    system.dofs().gather(&state.velocities, &mut reduced);
    y.rows_mut(n, n).copy_from_slice(&reduced);
    let absolute = tolerance * extent(&start.positions, &start.positions);
    let end = start.time + duration;
    if n > 0 {
        let clock = Clock { span: [start.time, end], begin: Instant::now(), deadline: deadline.into() };
        let mut from = start.time;
        for to in kinks(system, start.time, end) {
            y = interval(system, &state, y, [from, to], tolerance, absolute, &clock)?;
            from = to;
        }
    }
    let (x, rest) = y.as_slice().split_at(n);
    set_state(system, end, x, rest.get(..n)?, &mut state);
    state.is_finite().then_some(state)
}

fn interval(
    system: &System,
    state: &State,
    mut y: DVector<f64>,
    [start, to]: [f64; 2],
    relative: f64,
    absolute: f64,
    clock: &Clock,
) -> Option<DVector<f64>> {
    let chunk = (KEPT / y.len().max(1)).clamp(4, CHUNK) as u32;
    let (mut from, mut h) = (start, 0.0);
    loop {
        let scratch = Scratch {
            state: state.clone(),
            extensions: Extensions::at(system, &state.positions).ok()?,
            force: vec![Vector3::zeros(); system.particles()],
            reduced: vec![0.0; system.dofs().len()],
        };
        let motions = Motions { system, middle: 0.5 * (start + to), scratch: RefCell::new(scratch) };
        let length = to - from;
        // The library's defaults for safety factor, PI term and step ratios; its stiffness test never comes round,
        // since a stiff problem only takes longer.
        let mut method = Dop853::from_param(
            motions,
            from,
            to,
            length,
            y,
            relative,
            absolute,
            0.9,
            0.0,
            0.333,
            6.0,
            length,
            h,
            chunk,
            u32::MAX,
            OutputType::Sparse,
        );
        let outcome = method.integrate();
        let (times, states) = (method.x_out(), method.y_out());
        let last = states.last()?.clone();
        match outcome {
            Ok(_) => return Some(last),
            Err(IntegrationError::MaxNumStepReached { .. }) => {
                let reached = *times.last()?;
                if reached <= from || clock.is_hopeless(reached) {
                    return None;
                }
                let before = times.len().checked_sub(2).and_then(|i| times.get(i)).copied().unwrap_or(from);
                h = (reached - before).min(to - reached);
                (from, y) = (reached, last);
            }
            Err(_) => return None,
        }
    }
}

/// The times in (start, end) at which a prescribed velocity jumps, and the end.
fn kinks(system: &System, start: f64, end: f64) -> Vec<f64> {
    let times = system.prescribed().motions().iter().flat_map(|motion| match motion {
        Motion::Path { times, .. } => times.as_slice(),
        Motion::Held | Motion::Velocity(_) => &[],
    });
    let mut kinks: Vec<f64> = times.copied().filter(|&t| t > start && t < end).collect();
    kinks.push(end);
    kinks.sort_unstable_by(f64::total_cmp);
    kinks.dedup();
    kinks
}

#[cfg(test)]
mod tests {
    use super::dop853;
    use crate::spring::Spring;
    use crate::system::{Axes, Constraint, Motion, SystemBuilder};
    use nalgebra::Vector3;
    use std::time::{Duration, Instant};

    /// A damped oscillator whose anchor moves away: the forces depend on time. With u the length less its rest length,
    /// `m ü + b u̇ + (k/l0) u = 0`, u(0) = 0.2, u̇(0) = −v. The method is right to a hundred tolerances; of low order in time it takes tens of
    /// thousands of steps, which add up to more.
    #[test]
    fn forces_that_depend_on_time_keep_the_order() {
        let (k, l0, m, b, v, t) = (50.0, 0.8, 0.7, 1.3, 0.4, 2.0f64);
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        builder.particle([0.0; 3], 1.0);
        builder.particle([1.0, 0.0, 0.0], m);
        builder.spring(0, 1, Spring { stiffness: k, rest_length: l0, damping: b });
        let motion = Motion::Velocity(Vector3::new(v, 0.0, 0.0));
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
        let (system, start) = builder.build().unwrap();
        let deadline = Instant::now() + Duration::from_secs(600);
        let end = dop853(&system, &start, t, 1e-9, deadline).unwrap();
        let (rate, square) = (b / (2.0 * m), k / (l0 * m));
        let omega = (square - rate * rate).sqrt();
        let u = (-rate * t).exp() * (0.2 * (omega * t).cos() + (0.2 * rate - v) / omega * (omega * t).sin());
        let error = (end.positions[1].x - (v * t + l0 + u)).abs();
        assert!(error < 1e-7, "{error:e}");
    }
}
