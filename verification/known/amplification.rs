//! The amplification of one mode by one step: the 2×2 matrix on (q, v dt), measured by two steps from the two unit states.

use nalgebra::{Matrix2, Vector3};
use sprung::integrate::{ImplicitOptions, Method};
use sprung::linear::{SolverChoice, SolverOptions};
use sprung::verify::TestCase;
use sprung::{State, Stiffness};

/// A way to step: method, option, and LDLᵀ so that indefinite matrices are no obstacle.
#[derive(Clone, Copy)]
pub struct Way {
    pub method: Method,
    pub option: Stiffness,
}

/// A mode and how far it is displaced: any amount along straight lines, next to nothing across them.
pub struct Mode<'a> {
    pub shape: &'a [Vector3<f64>],
    pub amplitude: f64,
}

impl Mode<'_> {
    fn displace(&self, vectors: &mut [Vector3<f64>], factor: f64) {
        for (v, s) in vectors.iter_mut().zip(self.shape) {
            *v += s * (self.amplitude * factor);
        }
    }

    /// The part of the difference of two fields that is in the mode, in units of the amplitude.
    fn share(&self, vectors: &[Vector3<f64>], rest: &[Vector3<f64>]) -> f64 {
        let along = vectors.iter().zip(rest).zip(self.shape).map(|((v, r), s)| (v - r).dot(s)).sum::<f64>();
        along / (self.amplitude * self.shape.iter().map(Vector3::norm_squared).sum::<f64>())
    }

    /// The matrix by which a step from rest at an equilibrium multiplies (q, v dt).
    pub fn amplification(
        &self,
        subject: &TestCase,
        way: Way,
        dt: f64,
    ) -> Result<Matrix2<f64>, Box<dyn std::error::Error>> {
        let TestCase { system, state: rest, .. } = subject;
        let linear = SolverOptions { solver: SolverChoice::Ldlt, ..SolverOptions::default() };
        let options = ImplicitOptions { stiffness: way.option.into(), linear };
        let column = |displace: &dyn Fn(&mut State)| -> Result<[f64; 2], Box<dyn std::error::Error>> {
            let mut state = rest.clone();
            displace(&mut state);
            way.method.stepper(system, rest, &options)?.step(&mut state, dt)?;
            let still = vec![Vector3::zeros(); rest.velocities.len()];
            Ok([self.share(&state.positions, &rest.positions), dt * self.share(&state.velocities, &still)])
        };
        let [a, c] = column(&|state| self.displace(&mut state.positions, 1.0))?;
        let [b, d] = column(&|state| self.displace(&mut state.velocities, 1.0 / dt))?;
        Ok(Matrix2::new(a, b, c, d))
    }
}

/// The largest magnitude of an eigenvalue.
pub fn spectral_radius(matrix: &Matrix2<f64>) -> f64 {
    let (half_trace, determinant) = (0.5 * matrix.trace(), matrix.determinant());
    let discriminant = half_trace * half_trace - determinant;
    if discriminant < 0.0 { determinant.sqrt() } else { half_trace.abs() + discriminant.sqrt() }
}

/// The angle of a complex pair of eigenvalues; zero for real ones.
pub fn phase(matrix: &Matrix2<f64>) -> f64 {
    let (half_trace, determinant) = (0.5 * matrix.trace(), matrix.determinant());
    (determinant - half_trace * half_trace).max(0.0).sqrt().atan2(half_trace)
}
