//! Central differences of any force, columns of a group together, at a ladder of steps.

use super::extrapolation::{Estimate, LEVELS, extrapolate};
use super::force_error::U;

/// The force, the point that it is moved from, and the steps of every column.
pub(super) struct Measurement<F> {
    pub force: F,
    pub x: Vec<f64>,
    pub steps: Vec<[f64; LEVELS]>,
}

/// How much a component of the force changes from −h to +h, and how large it is, at every step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Change {
    difference: [f64; LEVELS],
    size: [f64; LEVELS],
}

impl Change {
    /// The derivative, given the steps.
    pub fn over(&self, steps: &[f64; LEVELS]) -> Estimate {
        let quotients = std::array::from_fn(|level| self.difference[level] / (2.0 * steps[level]));
        let rounding = std::array::from_fn(|level| U * self.size[level] / steps[level]);
        extrapolate(&quotients, &rounding)
    }
}

impl<F: FnMut(&[f64], &mut [f64])> Measurement<F> {
    /// Changes of every component of the force, all columns of a group moved together.
    pub fn along(&mut self, group: &[usize]) -> Vec<Change> {
        let n = self.x.len();
        let at: Vec<f64> = group.iter().map(|&column| self.x[column]).collect();
        let mut changes = vec![Change { difference: [0.0; LEVELS], size: [0.0; LEVELS] }; n];
        let (mut after, mut before) = (vec![0.0; n], vec![0.0; n]);
        for level in 0..LEVELS {
            self.evaluate(group, &at, (level, 1.0), &mut after);
            self.evaluate(group, &at, (level, -1.0), &mut before);
            for (change, (after, before)) in changes.iter_mut().zip(after.iter().zip(&before)) {
                change.difference[level] = after - before;
                change.size[level] = after.abs().max(before.abs());
            }
        }
        group.iter().zip(&at).for_each(|(&column, &x)| self.x[column] = x);
        changes
    }

    fn evaluate(&mut self, group: &[usize], at: &[f64], (level, sign): (usize, f64), f: &mut [f64]) {
        group.iter().zip(at).for_each(|(&column, &x)| self.x[column] = x + sign * self.steps[column][level]);
        // A force that leaves a component alone must not inherit it from the evaluation before.
        f.fill(0.0);
        (self.force)(&self.x, f);
    }
}

/// The step nearest to h that x + h and x − h show exactly, if any: h rounded to the spacing of numbers at twice x.
pub(super) fn representable(h: f64, x: f64) -> f64 {
    let coarse = 2.0 * x.abs() + h;
    (coarse + h) - coarse
}
