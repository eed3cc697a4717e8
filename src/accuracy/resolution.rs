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
//!
//! Yet what displaces little may push: as a vibration of energy E is slowly changed it keeps `E/ω` (the adiabatic invariant of Landau and Lifshitz,
//! Mechanics, § 49), so that E acts as a potential on what is slow, with the force `−E ∇ω/ω`. A frequency changes by a part of order one where a
//! particle moves by the length ℓ of a spring. With velocities of amplitude w, `E = m w²/2`, particles drift in the time T by
//!
//! ```text
//! ½ (E/(m ℓ)) T² = ¼ w² T²/ℓ,
//! ```
//!
//! w² being the mean, by mass, of the squares of what is fast of the velocities, `(1 − F)² v`, and of `a/ω`, `h² ⟨(1 − F)² a, F (1 − F) a⟩`. Of 418
//! implicit answers to random scenes that left out fast vibrations of amplitudes up to the accuracy 22 were wrong, of 20 of which this
//! drift was above 0.7 of it, and of a third of the others.

use super::extent;
use crate::error::Result;
use crate::force::{Extensions, set_accelerations};
use crate::linear::{Assurance, CostModel, MatrixAndSolver, SolverOptions, Tolerance, select};
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};
use crate::work::Work;
use nalgebra::Vector3;

/// What steps do not resolve of a state's motion, relative to the extent of the scene. Infinite where it cannot be found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Unresolved {
    /// The size of what is too fast.
    pub amplitude: f64,
    /// How far it pushes in a second what is slow; grows with the square of the time.
    pub drift: f64,
    /// What finding it has cost, in force evaluations.
    pub cost: f64,
}

/// What steps of `h` seconds do not resolve of a state's motion.
///
/// # Errors
/// Coincident ends of a spring; a matrix that is too large.
pub(super) fn unresolved(
    system: &System,
    state: &State,
    h: f64,
    options: &SolverOptions,
    costs: &CostModel,
) -> Result<Unresolved> {
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
    let is_prepared = filter.equations.prepare(|_| {}, &mut work).is_ok();
    let mut acceleration = vec![Vector3::zeros(); system.particles()];
    set_accelerations(system, &extensions, &state.moment(), &mut acceleration);
    let fast = if is_prepared { filter.fast_motion(&state.velocities, &acceleration, &mut work) } else { None };
    let cost = costs.cost(&work, filter.equations.factor().map(|factor| factor.size));
    let Some(Fast { amplitude, square_velocity }) = fast else {
        return Ok(Unresolved { amplitude: f64::INFINITY, drift: f64::INFINITY, cost });
    };
    let extent = extent(&state.positions, &state.positions);
    let lengths = extensions.iter().map(|at| at.length);
    let mean_length = lengths.sum::<f64>() / extensions.iter().len().max(1) as f64;
    let drift = if square_velocity > 0.0 { 0.25 * square_velocity / mean_length } else { 0.0 };
    let all = (system.particles() as f64).sqrt();
    Ok(Unresolved { amplitude: amplitude / extent, drift: all * drift / extent, cost })
}

/// Of what is fast.
struct Fast {
    /// Of the displacements of all particles, in m.
    amplitude: f64,
    /// The mean square of velocities, by mass, in m²/s².
    square_velocity: f64,
}

struct Filter<'s> {
    system: &'s System,
    equations: MatrixAndSolver<'s>,
    h: f64,
}

impl Filter<'_> {
    /// What is fast; `None` where a solve fails.
    fn fast_motion(&mut self, v: &[Vector3<f64>], a: &[Vector3<f64>], work: &mut Work) -> Option<Fast> {
        let masses = self.system.masses();
        let total: f64 = masses.iter().sum();
        let product = |v: &[Vector3<f64>], w: &[Vector3<f64>]| {
            v.iter().zip(w).zip(masses).map(|((v, w), mass)| mass * v.dot(w)).sum::<f64>().max(0.0)
        };
        let square = self.h * self.h;
        let once = self.fast(v, work)?;
        let fast = self.fast(&once, work)?;
        let faster = self.fast(&fast, work)?;
        let slowed = self.slow(&faster, work)?;
        let particles = masses.len() as f64;
        let by_velocity = (square * product(&fast, &slowed) * particles / total).sqrt();
        let velocity = product(&fast, &fast);
        let once = self.fast(a, work)?;
        let fast = self.fast(&once, work)?;
        let slowed = self.slow(&fast, work)?;
        let by_acceleration = square * slowed.iter().map(|w| w.norm_squared()).sum::<f64>().sqrt();
        // F (1 − F) a is what the second filter has taken away.
        let slow: Vec<Vector3<f64>> = once.iter().zip(&fast).map(|(once, fast)| once - fast).collect();
        let square_velocity = (velocity + square * product(&fast, &slow)) / total;
        Some(Fast { amplitude: by_velocity + by_acceleration, square_velocity })
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

    /// A particle on a spring of 1 m, with a velocity along it: ω = 10/s, and the amplitude is 0.1 v. The masses are its own and the anchor's.
    fn moving(speed: f64, rest_length: f64, [mass, anchor]: [f64; 2]) -> (System, State) {
        let mut builder = SystemBuilder::new();
        builder.particle([0.0; 3], anchor);
        let particle = builder.particle([1.0, 0.0, 0.0], mass);
        builder.spring(0, 1, Spring { stiffness: 100.0 * mass * rest_length, rest_length, damping: 0.0 });
        builder.hold(0);
        builder.velocities[particle] = Vector3::new(speed, 0.0, 0.0);
        builder.build().unwrap()
    }

    fn left(h: f64, (system, state): &(System, State)) -> Unresolved {
        unresolved(system, state, h, &SolverOptions::default(), &CostModel::of(system)).unwrap()
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
            unresolved(&system, &state, 0.5, &options, &CostModel::of(&system)).unwrap().amplitude
        });
        assert!((sizes[1] / sizes[0] - 1.0).abs() < 1e-4, "{sizes:?}");
    }

    #[test]
    fn what_is_fast_is_told_from_what_is_slow() {
        let relative = |h: f64, masses: [f64; 2]| left(h, &moving(0.01, 1.0, masses)).amplitude;
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

    /// A vibration of 1 m/s, begun with that velocity or with a force: w² is the particle's part of the mass, in m²/s², and in a second both particles
    /// drift by `¼ w²` over the metre of the spring. Of two that is √2 times as much, and the extent is √½ m.
    #[test]
    fn what_is_fast_pushes_what_is_slow() {
        let filter = 100.0f64 / 101.0;
        for (speed, rest_length) in [(1.0, 1.0), (0.0, 0.9)] {
            for (masses, part) in [([1.0, 1.0], 0.5), ([3.0, 1.0], 0.75)] {
                let found = left(1.0, &moving(speed, rest_length, masses)).drift;
                let expected = 0.25 * part * filter.powi(4) * 2.0f64.sqrt() / 0.5f64.sqrt();
                assert!((found / expected - 1.0).abs() < 1e-6, "{speed} {masses:?}: {found:e}, {expected:e}");
            }
        }
        assert_eq!(left(1.0, &moving(0.0, 1.0, [1.0; 2])).drift, 0.0);
    }
}
