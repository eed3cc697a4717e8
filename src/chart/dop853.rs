//! The library's eighth-order Runge–Kutta method of Dormand and Prince on a mass–spring system.
//!
//! Everything between scene and answer is independent of this crate's methods but the force itself: other formulas, other
//! step control, no matrix. The unknowns are the free coordinates and their velocities; prescribed coordinates are functions
//! of time.

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
    fn system(&self, t: f64, y: &DVector<f64>, dy: &mut DVector<f64>) {
        let system = self.system;
        let n = system.dofs().len();
        let (x, v) = y.as_slice().split_at(n);
        let (dx, dv) = dy.as_mut_slice().split_at_mut(n);
        dx.copy_from_slice(v);
        let Scratch { state, extensions, force, reduced } = &mut *self.scratch.borrow_mut();
        set_state(system, t, x, v, state);
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
    let mut y = DVector::zeros(2 * n);
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
    let (x, v) = y.as_slice().split_at(n);
    set_state(system, end, x, v, &mut state);
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
