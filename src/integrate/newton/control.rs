//! The decisions of a Newton iteration: the accuracy of its direction, its matrix, its step length, and the target of r.
//!
//! **Forcing term** (Eisenstat and Walker's second, 1996). `η = 0.9 (‖r‖/‖r_last‖)²` keeps the convergence quadratic. It does not fall below
//! `0.9 η_last²` as long as that is above 0.1, and never asks for more than the last iteration needs, half of the target.
//!
//! **Options that do not fit.** Where a step is cut below a quarter, or r does not fall to a quarter, the rest of the time step is solved
//! `on-demand`: with the full stiffness wherever it is definite; the progressive policy stays. All lead to the same solution.
//!
//! **Saddles.** Where Φ has slightly negative curvature, as for a column just beyond its buckling load, a regularized matrix is far too stiff along
//! the buckling mode. After a few slow iterations with regularized matrices the rest of the time step keeps the full stiffness and raises the masses
//! instead, `A + σ M/dt²` with σ about as small as makes it definite (the shift of Levenberg and Marquardt in the metric of the masses).

use crate::force::SpringGeometry;
use crate::integrate::StiffnessPolicy;
use crate::spring::Stiffness;
use crate::system::{Axes, State, System};
use nalgebra::Vector3;

/// The forcing term η; see the module.
pub(in crate::integrate) struct Forcing {
    floor: f64,
    last: Option<(f64, f64)>,
}

impl Forcing {
    pub fn new(floor: f64) -> Self {
        Self { floor, last: None }
    }

    /// η for a residual norm and its target.
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

/// A matrix in place of A.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum NewtonMatrix {
    /// A under a stiffness policy.
    Policy(StiffnessPolicy),
    /// `A + σ M/dt²` with the full stiffness and this σ.
    Shifted(f64),
}
pub(super) struct MatrixChoice {
    pub matrix: NewtonMatrix,
    slow_iterations: u32,
}

/// The least σ above zero, and its factor from one attempt to the next.
const LEAST_SHIFT: f64 = 1e-4;
const SHIFT_FACTOR: f64 = 4.0;

impl MatrixChoice {
    pub fn new(policy: StiffnessPolicy) -> Self {
        Self { matrix: NewtonMatrix::Policy(policy), slow_iterations: 0 }
    }

    /// Lowers the shift before an iteration: less than the last may be enough.
    pub fn lower_shift(&mut self) {
        if let NewtonMatrix::Shifted(shift) = &mut self.matrix {
            *shift = if *shift > LEAST_SHIFT { *shift / SHIFT_FACTOR } else { 0.0 };
        }
    }

    /// Raises the shift of an indefinite matrix; returns `false` where there is none, or the masses outweigh everything.
    pub fn raise_shift(&mut self) -> bool {
        match &mut self.matrix {
            NewtonMatrix::Shifted(shift) if *shift < 1e8 => {
                *shift = (*shift * SHIFT_FACTOR).max(LEAST_SHIFT);
                true
            }
            _ => false,
        }
    }

    /// Records an iteration: its step along the direction, the ratio of residuals after and before it, and whether its matrix was regularized.
    pub fn record(&mut self, step: f64, ratio: f64, is_regularized: bool) {
        let NewtonMatrix::Policy(policy) = self.matrix else { return };
        let is_slow = step < 0.25 || ratio > 0.25;
        if !is_slow || policy == StiffnessPolicy::Always(Stiffness::Full) {
            return;
        }
        self.slow_iterations += u32::from(is_regularized);
        if self.slow_iterations >= 4 {
            self.matrix = NewtonMatrix::Shifted(LEAST_SHIFT);
        } else if policy != StiffnessPolicy::Progressive {
            self.matrix = NewtonMatrix::Policy(StiffnessPolicy::OnDemand);
        }
    }
}
#[derive(Clone, Copy)]
pub(super) struct Point {
    /// ‖r‖.
    pub residual: f64,
    /// Φ, and its uncertainty by rounding of its terms and of the positions.
    pub potential: f64,
    pub noise: f64,
    /// rᵀΔ.
    pub slope: f64,
    /// −f_dᵀΔ, the part of the slope that is in no potential.
    pub damping_slope: f64,
}

/// c in Armijo's condition.
const SUFFICIENT_DECREASE: f64 = 1e-4;

impl Point {
    /// True if φ has decreased enough after a step.
    pub fn is_lower(&self, from: &Self, step: f64) -> bool {
        let work = 0.5 * step * (from.damping_slope + self.damping_slope);
        let change = self.potential - from.potential + work;
        let noise = self.noise + from.noise;
        change <= SUFFICIENT_DECREASE * step * from.slope
            || change <= noise && self.slope <= (1.0 - 2.0 * SUFFICIENT_DECREASE) * from.slope.abs()
    }

    /// The factor of the next step to try: to the zero of a linear slope, within bounds.
    pub fn shortening(&self, from: &Self) -> f64 {
        let zero = from.slope / (from.slope - self.slope);
        if self.slope > 0.0 { zero.clamp(0.1, 0.5) } else { 0.5 }
    }
}

/// The scales that r is compared with, in N.
#[derive(Clone, Copy)]
pub(super) struct ForceBalance {
    /// Norm of the forces that balance in r, their magnitudes added up particle by particle.
    pub forces: f64,
    /// Norm of the change of r by rounding, below which no target can lie.
    pub rounding: f64,
}

impl ForceBalance {
    /// For a step of dt seconds from a state to a trial state with these extensions. `sums` is scratch: x holds forces, y their rounding.
    pub fn new(
        system: &System,
        extensions: &SpringGeometry,
        [state, trial]: [&State; 2],
        dt: f64,
        sums: &mut [Vector3<f64>],
    ) -> Self {
        let gravity = system.gravity().norm();
        for (p, mass) in system.masses().iter().enumerate() {
            let momentum = state.velocities[p].norm() + trial.velocities[p].norm();
            let force = mass * (momentum / dt + gravity);
            sums[p] = Vector3::new(force, f64::EPSILON * force, 0.0);
        }
        for ((_, [i, j], spring), at) in extensions.springs(system) {
            let damping = spring.damping * at.direction.dot(&(trial.velocities[i] - trial.velocities[j]));
            let force = (spring.stiffness * spring.strain(at)).abs() + damping.abs();
            // Rounding of the positions, and of the length computed from them.
            let magnitude = trial.positions[i].norm() + trial.positions[j].norm() + 2.0 * at.length;
            let rounding = f64::EPSILON * (spring.axial_stiffness() * magnitude + force);
            sums[i] += Vector3::new(force, rounding, 0.0);
            sums[j] += Vector3::new(force, rounding, 0.0);
        }
        let square = |component: usize| {
            let own = sums.iter().enumerate().take(system.own_particles());
            let free = own.filter(|&(p, _)| system.dofs().free_axes(p) != Axes::NONE);
            free.map(|(_, s)| s[component] * s[component]).sum::<f64>()
        };
        let [forces, rounding] = system.total([square(0), square(1)]).map(f64::sqrt);
        Self { forces, rounding }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::fixtures::scene;

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-12 * b
    }

    /// The square of the progress, 0.9 (2/8)² and 0.9 (1/2)²; at most a half, after which no less than 0.9·0.5² = 0.225 is asked for, while
    /// there is no such bound after 0.1; at least the floor, and half of the target.
    #[test]
    fn forcing_terms_follow_the_progress() {
        for (floor, target, sequence) in [
            (0.0, 1e-9, &[(8.0, 0.1), (2.0, 0.05625), (1.0, 0.225)][..]),
            (0.0, 1e-9, &[(1.0, 0.1), (3.0, 0.5), (3e-3, 0.225), (3e-4, 0.9e-2)]),
            (0.0, 1e-9, &[(1.0, 0.1), (0.01, 0.9e-4)]),
            (1e-3, 1e-9, &[(1.0, 0.1), (1e-4, 1e-3)]),
            (1e-3, 1e-6, &[(1e-4, 0.1), (4e-6, 0.125)]),
        ] {
            let mut forcing = Forcing::new(floor);
            for &(residual, expected) in sequence {
                let eta = forcing.next(residual, target);
                assert!(close(eta, expected), "{residual}: {eta} instead of {expected}");
            }
        }
    }

    const ON_DEMAND: NewtonMatrix = NewtonMatrix::Policy(StiffnessPolicy::OnDemand);

    /// The full stiffness is no regularization, and stays.
    #[test]
    fn slow_iterations_replace_options() {
        for option in Stiffness::ALL {
            let policy = NewtonMatrix::Policy(option.into());
            for (step, ratio, is_slow) in
                [(1.0, 0.1, false), (0.25, 0.25, false), (0.24, 0.1, true), (1.0, 0.26, true), (0.24, 0.26, true)]
            {
                let mut choice = MatrixChoice::new(option.into());
                choice.record(step, ratio, true);
                let stays = option == Stiffness::Full || !is_slow;
                assert_eq!(choice.matrix, if stays { policy } else { ON_DEMAND }, "{step} {ratio}");
            }
        }
    }

    /// Both policies have a matrix for every iteration until four with regularized ones were slow.
    #[test]
    fn only_slow_iterations_with_regularized_matrices_count() {
        for policy in [StiffnessPolicy::OnDemand, StiffnessPolicy::Progressive] {
            let mut choice = MatrixChoice::new(policy);
            for _ in 0..8 {
                choice.record(0.1, 0.9, false);
                choice.record(1.0, 0.1, true);
            }
            let shifted = NewtonMatrix::Shifted(LEAST_SHIFT);
            let policy = NewtonMatrix::Policy(policy);
            for expected in [policy, policy, policy, shifted, shifted] {
                choice.record(0.1, 0.9, true);
                assert_eq!(choice.matrix, expected);
            }
        }
    }

    #[test]
    fn shifts_rise_and_fall_by_factors_of_four() {
        let shifted = |shift| MatrixChoice { matrix: NewtonMatrix::Shifted(shift), slow_iterations: 0 };
        let mut choice = shifted(LEAST_SHIFT);
        choice.lower_shift();
        assert_eq!(choice.matrix, NewtonMatrix::Shifted(0.0));
        for shift in [1.0, 4.0, 16.0] {
            assert!(choice.raise_shift());
            assert_eq!(choice.matrix, NewtonMatrix::Shifted(shift * LEAST_SHIFT));
        }
        for shift in [4.0, 1.0, 0.0, 0.0] {
            choice.lower_shift();
            assert_eq!(choice.matrix, NewtonMatrix::Shifted(shift * LEAST_SHIFT));
        }
        for (shift, next) in [(0.5e8, Some(2e8)), (1e8, None)] {
            let mut choice = shifted(shift);
            assert_eq!(choice.raise_shift(), next.is_some());
            assert_eq!(choice.matrix, NewtonMatrix::Shifted(next.unwrap_or(shift)));
        }
        let mut choice = MatrixChoice::new(StiffnessPolicy::OnDemand);
        choice.lower_shift();
        assert!(!choice.raise_shift() && choice.matrix == ON_DEMAND);
    }

    const START: Point = Point { residual: 1.0, potential: 10.0, noise: 0.0, slope: -4.0, damping_slope: 0.5 };

    /// Over a quarter of the direction the damping forces do 0.5·0.25·(0.5 + 0.3) = 0.1, and 1e-4 is to be gained.
    #[test]
    fn the_potential_with_the_work_of_damping_must_fall() {
        let after = |potential| Point { potential, slope: 9.0, damping_slope: 0.3, ..START };
        assert!(after(9.8999 - 1e-9).is_lower(&START, 0.25));
        assert!(!after(9.8999 + 1e-9).is_lower(&START, 0.25));
    }

    /// Where rounding hides the fall, the slope must have fallen to 1 − 2·1e-4 of its magnitude.
    #[test]
    fn the_slope_decides_within_the_noise() {
        let from = Point { noise: 0.2, damping_slope: 0.0, ..START };
        for (change, slope, is_lower) in
            [(0.49, 3.9991, true), (0.49, 3.9993, false), (0.49, -7.0, true), (0.51, -7.0, false)]
        {
            let after = Point { potential: from.potential + change, noise: 0.3, slope, ..from };
            assert_eq!(after.is_lower(&from, 0.25), is_lower, "{change} {slope}");
        }
    }

    #[test]
    fn steps_are_shortened_to_the_zero_of_a_linear_slope() {
        for (before, slope, factor) in [(-1.0, 3.0, 0.25), (-3.0, 1.0, 0.5), (-1.0, 99.0, 0.1), (-1.0, -0.5, 0.5)] {
            assert_eq!(Point { slope, ..START }.shortening(&Point { slope: before, ..START }), factor);
        }
    }

    /// Two free particles below a held one: every magnitude by hand.
    #[test]
    fn forces_and_roundings_are_added_up_in_magnitude() {
        let particles = [([0.0; 3], 7.0), ([3.0, 0.0, 0.0], 2.0), ([3.0, 4.0, 0.0], 0.5)];
        let mut builder = scene(&particles, &[(0, 1, [100.0, 2.0, 4.0]), (1, 2, [30.0, 5.0, 3.0])]);
        let (system, mut state) = builder.gravity(0.0, -6.0, -8.0).hold(0).clone().build().unwrap();
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let mut trial = state.clone();
        trial.velocities[1] = Vector3::new(3.0, 4.0, 0.0);
        trial.velocities[2] = Vector3::new(0.0, -3.0, 0.0);
        state.velocities[1] = Vector3::new(0.0, 0.0, 2.0);
        state.velocities[2] = Vector3::new(1.0, 0.0, 0.0);
        let ForceBalance { forces, rounding } =
            ForceBalance::new(&system, &extensions, [&state, &trial], 0.5, &mut [Vector3::zeros(); 3]);
        // Inertia and weight, then the springs' stretch and damping: 48 + (50 + 12) + (6 + 21) and 9 + 27.
        assert!((forces - 137f64.hypot(36.0)).abs() < 1e-11, "{forces}");
        // 48 + (50·(3 + 2·3) + 62) + (6·(3 + 5 + 2·4) + 27) and 9 + 123.
        let ulps = rounding / f64::EPSILON;
        assert!((ulps - 683f64.hypot(132.0)).abs() < 1e-10, "{ulps}");
    }
}
