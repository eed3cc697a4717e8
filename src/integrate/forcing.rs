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

#[cfg(test)]
mod tests {
    use super::Forcing;

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-12 * b
    }

    #[test]
    fn the_square_of_the_progress_is_asked_for() {
        let mut forcing = Forcing::new(0.0);
        assert!(close(forcing.next(8.0, 1e-9), 0.1));
        // 0.9 (2/8)², then 0.9 (1/2)².
        assert!(close(forcing.next(2.0, 1e-9), 0.05625));
        assert!(close(forcing.next(1.0, 1e-9), 0.225));
    }

    #[test]
    fn half_is_the_most() {
        let mut forcing = Forcing::new(0.0);
        forcing.next(1.0, 1e-9);
        assert_eq!(forcing.next(3.0, 1e-9), 0.5);
    }

    /// After η = 0.5 no less than 0.9·0.5² = 0.225 is asked for; after 0.1 there is no such bound.
    #[test]
    fn one_lucky_iteration_asks_for_no_digits() {
        let mut forcing = Forcing::new(0.0);
        forcing.next(1.0, 1e-9);
        forcing.next(3.0, 1e-9);
        assert!(close(forcing.next(3e-3, 1e-9), 0.225));
        assert!(close(forcing.next(3e-4, 1e-9), 0.9e-2));
        let mut forcing = Forcing::new(0.0);
        forcing.next(1.0, 1e-9);
        assert!(close(forcing.next(0.01, 1e-9), 0.9e-4));
    }

    #[test]
    fn the_target_and_the_floor_bound_it_below() {
        let mut forcing = Forcing::new(1e-3);
        forcing.next(1.0, 1e-9);
        assert!(close(forcing.next(1e-4, 1e-9), 1e-3));
        // Half of 1e-6 of 4e-6.
        assert!(close(forcing.next(4e-6, 1e-6), 0.125));
    }
}
