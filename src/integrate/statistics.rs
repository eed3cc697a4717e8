//! What a time stepper has done so far.

use crate::work::Work;
use serde::{Deserialize, Serialize};

/// Work and quality of the steps done so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Statistics {
    /// Counters of work.
    pub work: Work,
    /// The largest `‖b − A x‖/‖b‖` of all accepted solves, recomputed from the solutions. Of nonlinear methods the
    /// residual force of the equations over the forces that balance in it, after their last iteration.
    pub max_relative_residual: f64,
    /// The largest relative residual that conjugate gradients were allowed to leave; zero where none ran.
    #[serde(default)]
    pub max_tolerance: f64,
    /// Solves of the on-demand policy in which A was indefinite and transverse terms were dropped.
    pub softened_solves: u64,
    /// Transverse terms dropped in these solves, all together.
    pub dropped_terms: u64,
    /// Steps of runs with error control that were tried and not taken.
    pub rejected_steps: u64,
    /// Accepted solves with an indefinite A (LDLᵀ under the full stiffness): such a step need not be meaningful.
    pub indefinite_solves: u64,
}

impl Statistics {
    /// Adds what an earlier part of the same run did.
    pub fn add(&mut self, other: &Self) {
        let Self {
            work,
            max_relative_residual,
            max_tolerance,
            softened_solves,
            dropped_terms,
            rejected_steps,
            indefinite_solves,
        } = *other;
        self.work.add(&work);
        self.record(max_relative_residual);
        self.max_tolerance = self.max_tolerance.max(max_tolerance);
        self.softened_solves += softened_solves;
        self.dropped_terms += dropped_terms;
        self.rejected_steps += rejected_steps;
        self.indefinite_solves += indefinite_solves;
    }

    pub(super) fn record(&mut self, relative_residual: f64) {
        self.max_relative_residual = self.max_relative_residual.max(relative_residual);
    }
}

#[cfg(test)]
mod tests {
    use super::Statistics;
    use crate::work::Work;

    /// Counters are added, and of the largest the largest is kept.
    #[test]
    fn parts_of_a_run_are_added() {
        let of = |number: u64| Statistics {
            work: Work { solves: number, ..Work::default() },
            max_relative_residual: 1e-3 * number as f64,
            max_tolerance: 1e-2 * number as f64,
            softened_solves: 2 * number,
            dropped_terms: 3 * number,
            rejected_steps: 4 * number,
            indefinite_solves: 5 * number,
        };
        let (mut sum, mut other) = (of(3), of(4));
        sum.add(&of(4));
        other.add(&of(3));
        assert_eq!(sum, Statistics { max_relative_residual: 4e-3, max_tolerance: 4e-2, ..of(7) });
        assert_eq!(sum, other);
    }
}
