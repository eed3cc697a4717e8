//! How exactly an iteration of Newton's method is worth solving for: Eisenstat and Walker's second forcing term (1996).
//!
//! `η = 0.9 (‖r‖/‖r_last‖)²`, the square of the last iteration's progress, keeps the convergence quadratic. It may not fall
//! below `0.9 η_last²` as long as that is above 0.1, which keeps one lucky iteration from asking for digits that are
//! worth nothing yet; and it never asks for more than the last iteration needs, half the way to the target.

/// The forcing term of one step's iterations.
pub(super) struct Forcing {
    floor: f64,
    last: Option<(f64, f64)>,
}

impl Forcing {
    pub fn new(floor: f64) -> Self {
        Self { floor, last: None }
    }

    /// η for a residual norm that is to come down to a target.
    pub fn next(&mut self, residual: f64, target: f64) -> f64 {
        let wanted = match self.last {
            None => 0.1,
            Some((last, eta)) => {
                let safeguard = 0.9 * eta * eta;
                let wanted = 0.9 * (residual / last).powi(2);
                if safeguard > 0.1 { wanted.max(safeguard) } else { wanted }
            }
        };
        let eta = wanted.min(0.5).max(0.5 * target / residual).max(self.floor);
        self.last = Some((residual, eta));
        eta
    }
}
