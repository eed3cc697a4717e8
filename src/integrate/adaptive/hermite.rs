//! A motion between two states that are known.

use crate::system::State;

/// The cubic Hermite polynomial through the ends of a step, and its derivative.
pub(crate) fn hermite(before: &State, after: &State, time: f64, sample: &mut State) {
    let h = after.time - before.time;
    let s = (time - before.time) / h;
    for (p, x0) in before.positions.iter().enumerate() {
        let chord = (after.positions[p] - x0) / h;
        let (v0, v1) = (before.velocities[p], after.velocities[p]);
        // x0 + h (s v0 + s² (3c − 2v0 − v1) + s³ (v0 + v1 − 2c)), c the chord's slope.
        let (second, third) = (chord * 3.0 - v0 * 2.0 - v1, v0 + v1 - chord * 2.0);
        sample.positions[p] = x0 + (v0 + (second + third * s) * s) * (s * h);
        sample.velocities[p] = v0 + (second * 2.0 + third * (3.0 * s)) * s;
    }
}
