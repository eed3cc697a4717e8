//! Prescribed coordinates are exactly where their motion has them, at every step of every method.
//!
//! What is exact is rounded: `x(0) + offset(t)` is one sum, and a place on a path three more operations. The motions are
//! worked out here a second time, from the scene's numbers.

use super::measured::Measured;
use super::runs::{Way, direct};
use super::{Check, Claim, TestCase, U, worst};
use crate::integrate::PositionUpdate;
use crate::system::{Dof, Motion, SAME_TIME, State};

const STEPS: usize = 10;

/// Units of rounding that the place on a path may differ by.
const UNITS: f64 = 8.0;

pub(super) fn has_prescribed(subject: &TestCase) -> bool {
    !subject.system.prescribed().is_empty()
}

pub(super) fn measure(subject: &TestCase) -> Measured {
    let mut checks = vec![at_many_times(subject)];
    for way in Way::of(subject) {
        let dt = way.step(subject);
        let Some(states) = way.run(subject, direct(), dt, STEPS)? else { continue };
        let value = worst(states.iter().map(|state| distance(subject, state)));
        let why = "in units of rounding of the coordinate: a sum, and the interpolation on a path";
        let name = format!("prescribed positions, {}", way.name());
        checks.push(Check::new(Claim::Constraints, name, &subject.name, value, UNITS, why));
        let speeds = states.windows(2).map(|pair| speed_error(subject, way, dt, &pair[0], &pair[1]));
        let why = "in units of rounding: the backward Euler methods give the displacement over dt, all others the \
                   motion's velocity";
        let name = format!("prescribed velocities, {}", way.name());
        checks.push(Check::new(Claim::Constraints, name, &subject.name, worst(speeds), UNITS, why));
    }
    Ok(checks)
}

/// Before, at, between and after all corners of all paths, far beyond the end included.
fn many_times(subject: &TestCase) -> Vec<f64> {
    let mut times = vec![0.0, subject.dt, 1.0, 1e3];
    for motion in subject.system.prescribed().motions() {
        if let Motion::Path { times: corners, .. } = motion {
            times.extend(corners);
            times.extend(corners.windows(2).map(|pair| pair[0] + 0.37 * (pair[1] - pair[0])));
            times.extend(corners.iter().flat_map(|t| [t - 0.9, t + 0.9]));
        }
    }
    times
}

fn at_many_times(subject: &TestCase) -> Check {
    let distances = many_times(subject).into_iter().map(|time| {
        let mut state = State { time, ..subject.state.clone() };
        state.prescribe(&subject.system);
        distance(subject, &state)
    });
    let why = "in units of rounding of the coordinate: a sum, and the interpolation on a path";
    Check::new(Claim::Constraints, "prescribed positions at many times", &subject.name, worst(distances), UNITS, why)
}

/// The largest distance of a prescribed coordinate from its motion at the state's time, in units of rounding.
fn distance(subject: &TestCase, state: &State) -> f64 {
    worst(coordinates(subject).map(|(dof, start, motion)| {
        let offset = offset(motion, state.time, dof.axis);
        let error = (state.positions[dof.particle][dof.axis] - (start + offset)).abs();
        let size = start.abs() + reach(motion, state.time, dof.axis);
        if error == 0.0 { 0.0 } else { error / (U * size) }
    }))
}

fn speed_error(subject: &TestCase, way: Way, dt: f64, before: &State, after: &State) -> f64 {
    worst(coordinates(subject).map(|(dof, start, motion)| {
        let velocity = after.velocities[dof.particle][dof.axis];
        let (x, y) = (before.positions[dof.particle][dof.axis], after.positions[dof.particle][dof.axis]);
        let (expected, unit) = if !(way.method.is_implicit() && way.method.moves_by() == PositionUpdate::New) {
            let expected = velocity_after(motion, after.time, dof.axis);
            (expected, U * expected.abs())
        } else {
            ((y - x) / dt, U * (start.abs() + reach(motion, after.time, dof.axis)) / dt)
        };
        let error = (velocity - expected).abs();
        if error == 0.0 { 0.0 } else { error / unit }
    }))
}

fn coordinates(subject: &TestCase) -> impl Iterator<Item = (Dof, f64, &Motion)> {
    let prescribed = subject.system.prescribed();
    prescribed.iter().map(move |(dof, start, motion)| (dof, start, &prescribed.motions()[motion]))
}

/// Where the motion is at time t, by going along the path from its beginning.
fn offset(motion: &Motion, t: f64, axis: usize) -> f64 {
    match motion {
        Motion::Held => 0.0,
        Motion::Velocity(v) => v[axis] * t,
        Motion::Path { times, offsets } => {
            let mut place = offsets[0][axis];
            for n in 1..times.len() {
                let share = ((t - times[n - 1]) / (times[n] - times[n - 1])).clamp(0.0, 1.0);
                if share > 0.0 {
                    place = (1.0 - share) * offsets[n - 1][axis] + share * offsets[n][axis];
                }
            }
            place
        }
    }
}

/// How fast the motion is just after time t, or after the kink from which t differs by rounding.
fn velocity_after(motion: &Motion, t: f64, axis: usize) -> f64 {
    match motion {
        Motion::Held => 0.0,
        Motion::Velocity(v) => v[axis],
        Motion::Path { times, offsets } => {
            let t = times.iter().copied().find(|kink| (kink - t).abs() <= SAME_TIME * t.abs()).unwrap_or(t);
            let segment = (1..times.len()).find(|&n| times[n - 1] <= t && t < times[n]);
            segment.map_or(0.0, |n| (offsets[n][axis] - offsets[n - 1][axis]) / (times[n] - times[n - 1]))
        }
    }
}

/// The size of the numbers that the offset at time t is made of.
fn reach(motion: &Motion, t: f64, axis: usize) -> f64 {
    match motion {
        Motion::Held => 0.0,
        Motion::Velocity(v) => (v[axis] * t).abs(),
        Motion::Path { times, offsets } => {
            let largest = offsets.iter().fold(0.0_f64, |largest, offset| largest.max(offset[axis].abs()));
            // The difference t − t0 is rounded relative to t, which the segment's slope carries over.
            let steepest = times.windows(2).zip(offsets.windows(2));
            let slopes = steepest.map(|(t, x)| (x[1][axis] - x[0][axis]).abs() / (t[1] - t[0]));
            largest + t.abs() * slopes.fold(0.0, f64::max)
        }
    }
}

#[cfg(test)]
mod tests;
