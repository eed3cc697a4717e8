//! Prescribed coordinates are exactly where their motion has them, at every step of every method.
//!
//! Exact up to rounding: `x(0) + offset(t)` is one sum, and a place on a path three more operations. The motions are
//! computed here a second time, from the scene's numbers.

use super::runs::{each_run, worst_step};
use super::{Check, Claim, Measured, MethodVariant, TestCase, U, ratio, worst};
use crate::integrate::{Method, PositionUpdate};
use crate::system::{Dof, Motion, SAME_TIME, State};

pub(super) fn measure(case: &TestCase) -> Measured {
    // Eight units of rounding for the place on a path.
    let check = |name: String, value, why: &str| Check::new(Claim::Constraints, name, &case.name, value, 8.0, why);
    let position_why = "in units of rounding of the coordinate: a sum, and the interpolation on a path";
    let velocity_why = "in units of rounding: the backward Euler methods give the displacement over dt, all others the motion's velocity";
    let places = many_times(case).into_iter().map(|time| {
        let mut state = State { time, ..case.state.clone() };
        state.prescribe(&case.system);
        distance(case, &state)
    });
    let mut checks = vec![check("prescribed positions at many times".into(), worst(places), position_why)];
    checks.extend(each_run(case, MethodVariant::of(case), 10, |variant, dt, states| {
        let positions = worst(states.iter().map(|state| distance(case, state)));
        let velocities = worst_step(states, |before, after| velocity_error(case, variant.method, dt, before, after));
        [
            check(format!("prescribed positions, {}", variant.name()), positions, position_why),
            check(format!("prescribed velocities, {}", variant.name()), velocities, velocity_why),
        ]
    })?);
    Ok(checks)
}

/// Times before, at, between and after all corners of all paths, far beyond the end included.
fn many_times(case: &TestCase) -> Vec<f64> {
    let mut times = vec![0.0, case.dt, 1.0, 1e3];
    for motion in case.system.prescribed().motions() {
        let corners = motion.kinks();
        times.extend(corners);
        times.extend(corners.windows(2).map(|pair| pair[0] + 0.37 * (pair[1] - pair[0])));
        times.extend(corners.iter().flat_map(|t| [t - 0.9, t + 0.9]));
    }
    times
}

/// The largest distance of a prescribed coordinate from its motion at the state's time, in units of rounding.
fn distance(case: &TestCase, state: &State) -> f64 {
    worst(coordinates(case).map(|(dof, start, motion)| {
        let [offset, _, magnitude] = follow(motion, state.time, dof.axis);
        let error = (state.positions[dof.particle][dof.axis] - (start + offset)).abs();
        ratio(error, U * (start.abs() + magnitude))
    }))
}

/// The largest error of a prescribed velocity after a step, in units of rounding.
fn velocity_error(case: &TestCase, method: Method, dt: f64, before: &State, after: &State) -> f64 {
    worst(coordinates(case).map(|(dof, start, motion)| {
        let (p, axis) = (dof.particle, dof.axis);
        let [_, velocity, magnitude] = follow(motion, after.time, axis);
        let (expected, unit) = if method.is_implicit() && method.moves_by() == PositionUpdate::New {
            let displacement = after.positions[p][axis] - before.positions[p][axis];
            (displacement / dt, U * (start.abs() + magnitude) / dt)
        } else {
            (velocity, U * velocity.abs())
        };
        ratio((after.velocities[p][axis] - expected).abs(), unit)
    }))
}

fn coordinates(case: &TestCase) -> impl Iterator<Item = (Dof, f64, &Motion)> {
    let prescribed = case.system.prescribed();
    prescribed.iter().map(move |(dof, start, motion)| (dof, start, &prescribed.motions()[motion]))
}

/// The offset of a motion at time t by following the path from its beginning, the velocity just after t, or after the kink from which t differs by
/// rounding, and the magnitude of the terms of the offset.
fn follow(motion: &Motion, t: f64, axis: usize) -> [f64; 3] {
    match motion {
        Motion::Held => [0.0; 3],
        Motion::Velocity(v) => [v[axis] * t, v[axis], (v[axis] * t).abs()],
        Motion::Path { times, offsets } => {
            let segments =
                || times.windows(2).zip(offsets.windows(2)).map(|(t, x)| [t[0], t[1], x[0][axis], x[1][axis]]);
            let slope = |[from, to, x, y]: [f64; 4]| (y - x) / (to - from);
            let mut place = offsets[0][axis];
            for [from, to, x, y] in segments() {
                let share = ((t - from) / (to - from)).clamp(0.0, 1.0);
                if share > 0.0 {
                    place = (1.0 - share) * x + share * y;
                }
            }
            let after = times.iter().copied().find(|kink| (kink - t).abs() <= SAME_TIME * t.abs()).unwrap_or(t);
            let velocity = segments().find(|&[from, to, ..]| from <= after && after < to).map_or(0.0, slope);
            let largest = offsets.iter().fold(0.0_f64, |largest, offset| largest.max(offset[axis].abs()));
            // The difference t − t0 is rounded relative to t, which the segment's slope carries over.
            let steepest = segments().map(slope).fold(0.0_f64, |steepest, slope| steepest.max(slope.abs()));
            [place, velocity, largest + t.abs() * steepest]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::fixtures::{line_state, moved, path as resting_path};
    use nalgebra::Vector3;

    /// From 0 by 300 m in the first hundred seconds, back by 200 m in the two hundred that follow.
    fn path() -> Motion {
        let offsets = [0.0, 300.0, 100.0].map(|x| Vector3::new(x, 0.0, 0.0)).to_vec();
        Motion::Path { times: vec![100.0, 200.0, 400.0], offsets }
    }

    #[test]
    fn the_velocity_on_a_path_is_that_after_its_corner() {
        let velocity = |t: f64| follow(&path(), t, 0)[1];
        let times = [50.0, 100.0, 150.0, 200.0, 300.0, 400.0, 500.0];
        assert_eq!(times.map(velocity), [0.0, 3.0, 3.0, -1.0, -1.0, 0.0, 0.0]);
        // Within 1e-12 of the corner is at the corner.
        let close = [200.0 * (1.0 - 5e-13), 200.0 * (1.0 - 2e-12), 400.0 * (1.0 - 5e-13)];
        assert_eq!(close.map(velocity), [-1.0, 3.0, 0.0]);
    }

    #[test]
    fn motions_by_hand() {
        let ahead = Motion::Velocity(Vector3::new(3.0, 0.0, 0.0));
        assert_eq!([follow(&Motion::Held, 2.0, 0), follow(&ahead, -2.0, 0)], [[0.0; 3], [-6.0, 3.0, 6.0]]);
        assert_eq!(follow(&path(), 50.0, 0), [0.0, 0.0, 300.0 + 50.0 * 3.0]);
    }

    /// A particle that is moved at 2 m/s has gone 3 m in ½ s and has a velocity of 7 m/s: 1 m/s more than its displacement says, 5 m/s more
    /// than its motion.
    #[test]
    fn velocities_are_those_of_the_displacement_or_of_the_motion() {
        let case = moved(Motion::Velocity(Vector3::new(2.0, 0.0, 0.0)), 0.5);
        let state = |time, x, v| line_state(time, [x; 3], [v; 3]);
        let error = |method, v| velocity_error(&case, method, 0.5, &state(3.5, 4.0, 0.0), &state(4.0, 7.0, v)) * U;
        for method in [Method::BackwardEuler, Method::LinearBackwardEuler] {
            assert!((error(method, 7.0) - 1.0 / ((1.0 + 8.0) / 0.5)).abs() < 1e-15);
            assert_eq!(error(method, 6.0), 0.0);
        }
        for method in [Method::ImplicitMidpoint, Method::SymplecticEuler, Method::W2] {
            assert_eq!([error(method, 7.0), error(method, 2.0)], [2.5, 0.0]);
        }
    }

    #[test]
    fn paths_are_looked_at_around_all_their_corners() {
        let expected = [0.0, 0.5, 1.0, 1000.0, 1.0, 3.0, 1.74, 0.1, 1.9, 2.1, 3.9];
        let times = many_times(&moved(resting_path(&[1.0, 3.0]), 0.5));
        assert_eq!(times.len(), expected.len());
        assert!(times.iter().zip(expected).all(|(t, expected)| (t - expected).abs() < 1e-12), "{times:?}");
        let checks = measure(&moved(path(), 0.5)).unwrap();
        assert!(checks[0].name == "prescribed positions at many times" && checks.iter().all(Check::passed));
    }
}
