//! What stands for A in an iteration of Newton's method, and when something else does.
//!
//! **Filters that do not fit.** The option `axial` leaves out the transverse stiffness of stretched springs, which may be
//! thousands of times `M/dt²`: its directions are then too long by this factor, and shortening them starves all other modes.
//! `tension` leaves out what compressed springs take away: its directions are too short, and the convergence is linear. When a
//! step must be cut below a quarter, or r does not fall to a quarter, the rest of the time step is solved `on-demand`: with the
//! full stiffness wherever it is definite. All lead to the same solution.
//!
//! **Saddles.** Where Φ bends downwards a little, as for a column just beyond its buckling load, a softened matrix is thousands
//! of times too stiff along the buckling mode: iterations creep off the saddle by a constant small factor. When softened matrices
//! have been slow a few times, the rest of the time step keeps the full stiffness and raises the masses instead, `A + σ M/dt²`
//! with σ about as small as makes it definite (Levenberg's and Marquardt's shift in the metric of the masses). Off the saddle
//! σ falls to zero, and the convergence is quadratic again.

use super::StiffnessPolicy;
use crate::spring::Stiffness;

/// A step below this part of a direction says that the matrix is too soft.
const TOO_SOFT: f64 = 0.25;

/// A residual above this part of the last says that the matrix is too stiff.
const TOO_STIFF: f64 = 0.25;

/// So many slow iterations with softened matrices say that these hide where the energy bends downwards.
const PATIENCE: u32 = 4;

/// Bounds of the part by which masses are raised, and its factor from one attempt to the next.
const LEAST_SHIFT: f64 = 1e-4;
const LARGEST_SHIFT: f64 = 1e8;
const SHIFT_FACTOR: f64 = 4.0;

/// What stands for A.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Matrix {
    /// A under a stiffness policy.
    Filtered(StiffnessPolicy),
    /// A with the full stiffness, its masses raised by this part of themselves where it is not positive definite.
    Shifted(f64),
}

/// The choice for one time step.
pub(super) struct Filter {
    matrix: Matrix,
    slow_softened: u32,
}

impl Filter {
    pub fn new(policy: StiffnessPolicy) -> Self {
        Self { matrix: Matrix::Filtered(policy), slow_softened: 0 }
    }

    pub fn matrix(&self) -> Matrix {
        self.matrix
    }

    /// Before an iteration: less than the last shift may be enough.
    pub fn relax(&mut self) {
        if let Matrix::Shifted(shift) = &mut self.matrix {
            *shift = if *shift > LEAST_SHIFT { *shift / SHIFT_FACTOR } else { 0.0 };
        }
    }

    /// After the matrix was found indefinite: shifts it further. False when there is nothing left to try.
    pub fn raise(&mut self) -> bool {
        match &mut self.matrix {
            Matrix::Shifted(shift) if *shift < LARGEST_SHIFT => {
                *shift = (*shift * SHIFT_FACTOR).max(LEAST_SHIFT);
                true
            }
            _ => false,
        }
    }

    /// After an iteration: the step that it took along its direction, what it left of the residual, and whether its matrix
    /// was softened.
    pub fn learn(&mut self, step: f64, left: f64, is_softened: bool) {
        let is_slow = step < TOO_SOFT || left > TOO_STIFF;
        match self.matrix {
            Matrix::Filtered(policy) if is_slow && policy != StiffnessPolicy::Always(Stiffness::Full) => {
                self.slow_softened += u32::from(is_softened);
                self.matrix = if self.slow_softened < PATIENCE {
                    Matrix::Filtered(StiffnessPolicy::OnDemand)
                } else {
                    Matrix::Shifted(LEAST_SHIFT)
                };
            }
            Matrix::Filtered(_) | Matrix::Shifted(_) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Filter, LARGEST_SHIFT, LEAST_SHIFT, Matrix, PATIENCE};
    use crate::integrate::StiffnessPolicy;
    use crate::spring::Stiffness;

    const ON_DEMAND: Matrix = Matrix::Filtered(StiffnessPolicy::OnDemand);

    #[test]
    fn options_give_way_when_steps_are_cut_or_residuals_stay() {
        for option in Stiffness::ALL {
            let policy = StiffnessPolicy::Always(option);
            for (step, left, is_slow) in
                [(1.0, 0.1, false), (0.25, 0.25, false), (0.24, 0.1, true), (1.0, 0.26, true), (0.24, 0.26, true)]
            {
                let mut filter = Filter::new(policy);
                filter.learn(step, left, true);
                // The full stiffness is no filter, and stays.
                let stays = option == Stiffness::Full || !is_slow;
                assert_eq!(filter.matrix(), if stays { Matrix::Filtered(policy) } else { ON_DEMAND }, "{step} {left}");
            }
        }
    }

    #[test]
    fn only_slow_softened_matrices_try_patience() {
        let mut filter = Filter::new(StiffnessPolicy::OnDemand);
        for _ in 0..2 * PATIENCE {
            filter.learn(0.1, 0.9, false);
            filter.learn(1.0, 0.1, true);
        }
        assert_eq!(filter.matrix(), ON_DEMAND);
        for _ in 1..PATIENCE {
            filter.learn(0.1, 0.9, true);
            assert_eq!(filter.matrix(), ON_DEMAND);
        }
        filter.learn(0.1, 0.9, true);
        assert_eq!(filter.matrix(), Matrix::Shifted(LEAST_SHIFT));
        filter.learn(0.1, 0.9, true);
        assert_eq!(filter.matrix(), Matrix::Shifted(LEAST_SHIFT));
    }

    #[test]
    fn shifts_rise_by_fours_and_fall_by_fours() {
        let mut filter = Filter { matrix: Matrix::Shifted(LEAST_SHIFT), slow_softened: 0 };
        filter.relax();
        assert_eq!(filter.matrix(), Matrix::Shifted(0.0));
        for shift in [1.0, 4.0, 16.0] {
            assert!(filter.raise());
            assert_eq!(filter.matrix(), Matrix::Shifted(shift * LEAST_SHIFT));
        }
        for shift in [4.0, 1.0, 0.0, 0.0] {
            filter.relax();
            assert_eq!(filter.matrix(), Matrix::Shifted(shift * LEAST_SHIFT));
        }
        for (shift, rises) in [(0.5 * LARGEST_SHIFT, true), (LARGEST_SHIFT, false), (2.0 * LARGEST_SHIFT, false)] {
            let mut filter = Filter { matrix: Matrix::Shifted(shift), slow_softened: 0 };
            assert_eq!(filter.raise(), rises);
            assert_eq!(filter.matrix(), Matrix::Shifted(if rises { 4.0 * shift } else { shift }));
        }
    }

    #[test]
    fn filters_are_not_shifted() {
        let mut filter = Filter::new(StiffnessPolicy::OnDemand);
        filter.relax();
        assert!(!filter.raise());
        assert_eq!(filter.matrix(), ON_DEMAND);
    }
}
