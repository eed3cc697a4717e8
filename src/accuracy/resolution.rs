//! What of a motion is too fast for a step.
//!
//! A method that damps vibrations which its steps do not resolve may converge, step halved after step, to the motion
//! without them, and its runs agree. So it is asked first how large that part of the motion is. Backward Euler's filter
//!
//! ```text
//! F = (1 + h² M⁻¹(−K))⁻¹,     1/(1 + (hω)²) of a mode of frequency ω,
//! ```
//!
//! keeps what is slow against h. What `(1 − F)³` leaves of the velocities and of the accelerations is fast. Modes of hω = 0.3 count with
//! 6·10⁻⁴ of themselves, those of hω = 3 with 0.73.
//!
//! What is fast may displace little: a mode of velocity v has the amplitude `v/ω`, one of acceleration a the amplitude `a/ω²`. Both
//! follow from the same filter, since `1/ω² = h² F/(1 − F)`: of the accelerations it is `h² F (1 − F)² a`, and the square of that of the
//! velocities `h² ⟨(1 − F)² v, F (1 − F)³ v⟩`, a scalar product with the masses, in which F is symmetric, over their mean.

use super::extent;
use crate::error::Result;
use crate::force::{Extensions, set_accelerations};
use crate::linear::{Assurance, CostModel, MatrixAndSolver, SolverOptions, Tolerance, select};
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};
use crate::work::Work;
use nalgebra::Vector3;

/// The size of a state's motion that steps of `h` seconds do not resolve, relative to the extent of the scene, and what finding it
/// has cost, in force evaluations. Infinite where it cannot be found.
///
/// # Errors
/// Coincident ends of a spring; a matrix that is too large.
pub(super) fn unresolved(
    system: &System,
    state: &State,
    h: f64,
    options: &SolverOptions,
    costs: &CostModel,
) -> Result<(f64, f64)> {
    let extensions = Extensions::at(system, &state.positions)?;
    let combination = Combination { mass: 1.0 / (h * h), damping: 0.0, stiffness: -1.0 };
    // Without the terms that make A indefinite: a filter must be one.
    let operator = SystemOperator::new(system, &extensions, Stiffness::Tension, combination);
    let mut work = Work { assemblies: 1, force_evaluations: 1, ..Work::default() };
    let solver = select(
        system,
        &SolverOptions { tolerance: Tolerance::Fixed(1e-6), ..*options },
        Assurance::Definite,
        &mut work,
    )?;
    let mut filter = Filter { system, equations: MatrixAndSolver::new(operator, solver), h };
    filter.equations.place(&state.positions);
    if filter.equations.prepare(|_| {}, &mut work).is_err() {
        return Ok((f64::INFINITY, costs.cost(&work, None)));
    }
    let mut acceleration = vec![Vector3::zeros(); system.particles()];
    set_accelerations(system, &extensions, &state.moment(), &mut acceleration);
    let displacement = filter.displacement(state.velocities.clone(), acceleration, &mut work);
    let relative = displacement.map(|d| d / extent(&state.positions, &state.positions));
    let factor = filter.equations.factor().map(|factor| factor.size);
    Ok((relative.unwrap_or(f64::INFINITY), costs.cost(&work, factor)))
}

struct Filter<'s> {
    system: &'s System,
    equations: MatrixAndSolver<'s>,
    h: f64,
}

impl Filter<'_> {
    /// The amplitudes of what is fast; `None` where a solve fails.
    fn displacement(&mut self, v: Vec<Vector3<f64>>, a: Vec<Vector3<f64>>, work: &mut Work) -> Option<f64> {
        let twice = |filter: &mut Self, w: &[Vector3<f64>], work: &mut Work| {
            let once = filter.fast(w, work)?;
            filter.fast(&once, work)
        };
        let fast = twice(self, &v, work)?;
        let faster = self.fast(&fast, work)?;
        let slowed = self.slow(&faster, work)?;
        let masses = self.system.masses();
        let mean = masses.iter().sum::<f64>() / masses.len().max(1) as f64;
        let products =
            fast.iter().zip(&slowed).zip(masses).map(|((fast, slowed), mass)| mass / mean * fast.dot(slowed));
        let by_velocity = self.h * products.sum::<f64>().max(0.0).sqrt();
        let fast = twice(self, &a, work)?;
        let slowed = self.slow(&fast, work)?;
        let by_acceleration = self.h * self.h * slowed.iter().map(|w| w.norm_squared()).sum::<f64>().sqrt();
        Some(by_velocity + by_acceleration)
    }

    /// `(1 − F) w`.
    fn fast(&mut self, w: &[Vector3<f64>], work: &mut Work) -> Option<Vec<Vector3<f64>>> {
        let slow = self.slow(w, work)?;
        Some(w.iter().zip(&slow).map(|(w, slow)| w - slow).collect())
    }

    /// `F w`, what is prescribed being slow by itself.
    fn slow(&mut self, w: &[Vector3<f64>], work: &mut Work) -> Option<Vec<Vector3<f64>>> {
        let dofs = self.system.dofs();
        let (mut rhs, mut slow) = (vec![0.0; dofs.len()], vec![0.0; dofs.len()]);
        let weighted: Vec<Vector3<f64>> =
            w.iter().zip(self.system.masses()).map(|(w, mass)| w * (mass / (self.h * self.h))).collect();
        dofs.gather(&weighted, &mut rhs);
        let mut kept = vec![Vector3::zeros(); w.len()];
        for (dof, ..) in self.system.prescribed().iter() {
            if let (Some(to), Some(from)) = (kept.get_mut(dof.particle), w.get(dof.particle)) {
                to[dof.axis] = from[dof.axis];
            }
        }
        self.equations.matrix().subtract_coupling(&kept, &mut rhs);
        self.equations.prepared()?.solve(&rhs, &mut slow, work).ok()?;
        dofs.scatter(&slow, &mut kept);
        Some(kept)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::SolverChoice;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;

    /// A particle on a spring at rest length, with a velocity along it: ω = 10/s, and the amplitude is 0.1 v. The masses are its own and the
    /// anchor's.
    fn moving(speed: f64, [mass, anchor]: [f64; 2]) -> (System, State) {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], anchor);
        let particle = builder.particle([1.0, 0.0, 0.0], mass);
        builder.spring(0, 1, Spring { stiffness: 100.0 * mass, rest_length: 1.0, damping: 0.0 });
        builder.hold(0);
        builder.velocities[particle] = Vector3::new(speed, 0.0, 0.0);
        builder.build().unwrap()
    }

    /// However loosely equations are to be solved elsewhere, here they are to a millionth.
    #[test]
    fn what_is_fast_is_found_exactly() {
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        for p in 0..30 {
            let particle = builder.particle([f64::from(p), 0.0, 0.0], 1.0 + 0.1 * f64::from(p));
            builder.velocities[particle].x = (0.7 * f64::from(p)).sin();
        }
        for p in 0..29 {
            builder.spring(p, p + 1, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.0 });
        }
        let (system, state) = builder.build().unwrap();
        let sizes = [SolverChoice::Llt, SolverChoice::Cg].map(|solver| {
            let options = SolverOptions { solver, tolerance: Tolerance::Fixed(0.3), ..SolverOptions::default() };
            unresolved(&system, &state, 0.5, &options, &CostModel::of(&system)).unwrap().0
        });
        assert!((sizes[1] / sizes[0] - 1.0).abs() < 1e-4, "{sizes:?}");
    }

    #[test]
    fn what_is_fast_is_told_from_what_is_slow() {
        let relative = |h: f64, masses: [f64; 2]| {
            let (system, state) = moving(0.01, masses);
            let costs = CostModel::of(&system);
            unresolved(&system, &state, h, &SolverOptions::default(), &costs).unwrap().0
        };
        let extent = 0.5f64.sqrt();
        // hω = 0.1: (0.01/1.01)³; hω = 10: (100/101)³.
        let expected = |filter: f64| 0.01 / 10.0 * filter / extent;
        let close = |value: f64, expected: f64| (value / expected - 1.0).abs() < 1e-6;
        // Squares count with the mass, over the mean of both: of 4 kg and 12 kg a half.
        for (masses, part) in [([1.0, 1.0], 1.0f64), ([4.0, 12.0], 0.5)] {
            for (h, filter) in [(0.01, 0.01f64 / 1.01), (1.0, 100.0 / 101.0)] {
                let found = relative(h, masses);
                assert!(close(found, part.sqrt() * expected(filter.powi(3))), "{h} {masses:?}: {found:e}");
            }
        }
    }
}
