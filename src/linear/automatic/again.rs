//! When conjugate gradients are tried again.
//!
//! Factorizations are chosen where conjugate gradients cost more, and what these cost changes with the motion: a column that buckles and a cloth that crumples take
//! several times the iterations that they take later. So one matrix is left to conjugate gradients again after sixteen that were factored, and where that fails after
//! twice as many each time: of n matrices few more than log₂(n/16) are tried in vain, each at less than the price of a factorization with its solve, and of the coarse
//! levels that multigrid makes before it begins.

/// Matrices that are factored before the first trial.
const FIRST: u64 = 16;

/// What a matrix may cost conjugate gradients, of a factorization and its solve, for them to be chosen again: costs are counted, and may be off.
const WORTH: f64 = 0.8;

/// When conjugate gradients are tried again, and what a trial may cost, in force evaluations.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trials {
    /// Matrices to be factored between two trials.
    interval: u64,
    /// Of them, those before the next.
    before: u64,
    /// What conjugate gradients may have spent when the trial that goes on ends.
    limit: Option<f64>,
}

impl Trials {
    pub const NONE_YET: Self = Self { interval: FIRST, before: FIRST, limit: None };

    /// Takes note of a matrix, where factorizations are chosen, that cost `direct` with their solve; whether it is left to conjugate gradients, which have spent so
    /// much so far.
    pub fn take(&mut self, spent: f64, direct: f64) -> bool {
        if self.limit.is_none() && self.before == 0 {
            self.limit = Some(spent + WORTH * direct);
        }
        self.before = self.before.saturating_sub(1);
        self.limit.is_some()
    }

    /// What is left to conjugate gradients, if they are being tried.
    pub fn left(&self, spent: f64) -> Option<f64> {
        self.limit.map(|limit| limit - spent)
    }

    /// A matrix was refused, on which factorizations would have spent so much too.
    pub fn refused(&mut self, direct: f64) {
        self.limit = self.limit.map(|limit| limit + direct);
    }

    /// The trial is over, whatever came of it.
    pub fn end(&mut self) {
        self.interval = self.interval.saturating_mul(2);
        (self.before, self.limit) = (self.interval, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The seventeenth matrix may cost 0.8 · 10 evaluations, and a quarter of what is refused; the next is the thirty-third after it.
    #[test]
    fn trials_become_rare_and_cost_less_than_a_factorization() {
        let mut trials = Trials::NONE_YET;
        let mut tried = Vec::new();
        for matrix in 1..=120 {
            if trials.take(100.0, 10.0) {
                assert_eq!(trials.left(103.0), Some(5.0));
                trials.refused(2.0);
                assert!(trials.take(104.0, 10.0), "it goes on with the next matrix");
                assert_eq!(trials.left(104.0), Some(6.0));
                trials.end();
                tried.push(matrix);
            }
            assert_eq!(trials.left(100.0), None);
            trials.refused(2.0);
        }
        assert_eq!(tried, [17, 50, 115]);
    }
}
