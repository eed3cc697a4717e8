//! Progressive projection: the transverse terms of compressed springs are dropped only where the residual is large.
//!
//! With r the residual of the equations to be solved, of a Newton iteration or of the start of a linearised step, and a threshold τ, the matrix has
//! `tension` for the springs with `max(‖r_i‖, ‖r_j‖) > τ` and `full` for all others: a large residual says that the exact quadratic model is not to
//! be trusted there. The iteration begins with τ = ∞. A matrix that is refused as indefinite lowers τ, `τ ← ½ min(τ, max ‖r_p‖)`, until it is
//! definite: with τ below every residual the matrix is that of `tension`, which always is. The next iteration begins with 2τ and has another r.
//!
//! Source: Fernández-Fernández, Löschner and Bender, "Progressively Projected Newton's Method", Computer Graphics Forum 45(2), 2026
//! (arXiv 2505.21013), for elements of any energy; the halves and doubles are theirs.

use super::free_square;
use crate::force::SpringGeometry;
use crate::spring::Stiffness;
use crate::system::System;
use nalgebra::Vector3;

/// The threshold τ, and the residual that it is compared with; allocated once for a system.
#[derive(Debug, Clone)]
pub(crate) struct Projection {
    threshold: f64,
    /// ‖r_p‖ on the free axes, in N, in the first component.
    residuals: Vec<Vector3<f64>>,
    largest: f64,
    /// For every active spring: `Full`, or `Tension` where it is projected.
    options: Vec<Stiffness>,
}

impl Projection {
    pub fn new(system: &System) -> Self {
        Self {
            threshold: f64::INFINITY,
            residuals: vec![Vector3::zeros(); system.particles()],
            largest: 0.0,
            options: vec![Stiffness::Full; system.active_springs().len()],
        }
    }

    /// Forgets the threshold: another problem begins.
    pub fn restart(&mut self) {
        self.threshold = f64::INFINITY;
    }

    /// Begins an iteration with a residual r, full-length, and twice the last threshold.
    pub fn begin(&mut self, system: &System, r: &[Vector3<f64>]) {
        self.threshold *= 2.0;
        for (p, (size, r)) in self.residuals.iter_mut().zip(r).enumerate() {
            size.x = free_square(system, p, r).sqrt();
        }
        system.halo_exchange(&mut self.residuals);
        let own = self.residuals.iter().take(system.own_particles());
        [self.largest] = system.largest([own.fold(0.0, |largest: f64, size| largest.max(size.x))]);
    }

    /// Chooses the springs to project; returns the number of terms dropped, in all parts of a system.
    pub fn update(&mut self, system: &System, extensions: &SpringGeometry) -> usize {
        let Self { threshold, residuals, options, .. } = self;
        let mut dropped = 0;
        for (option, ((number, ends, spring), at)) in options.iter_mut().zip(extensions.springs(system)) {
            let is_projected = spring.is_compressed(at) && ends.into_iter().any(|end| residuals[end].x > *threshold);
            *option = if is_projected { Stiffness::Tension } else { Stiffness::Full };
            dropped += usize::from(is_projected && system.owns_spring(number));
        }
        let [dropped] = system.total([dropped as f64]);
        dropped as usize
    }

    /// Lowers the threshold, after a refusal of a matrix that had so many terms dropped, until more are; returns `false` where
    /// no threshold drops more and not all.
    pub fn lower(&mut self, system: &System, extensions: &SpringGeometry, dropped: usize, compressed: usize) -> bool {
        // Residuals below this part of the largest are rounding.
        let least = f64::EPSILON * self.largest;
        while self.threshold > least {
            self.threshold = 0.5 * self.threshold.min(self.largest);
            let more = self.update(system, extensions);
            if more > dropped {
                return more < compressed;
            }
        }
        false
    }

    /// An option for every active spring, in their order.
    pub fn options(&self) -> &[Stiffness] {
        &self.options
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::fixtures::scene;
    use crate::spring::Spring;
    use crate::system::fixtures::tethered;

    /// Four particles in a row; the springs 0–1 and 2–3 are compressed, 1–2 is stretched. Residuals of 8, 0, 1 and 3 N.
    #[test]
    fn springs_at_large_residuals_are_projected() {
        let springs = [(0, 1, [1.0, 2.0, 0.0]), (1, 2, [1.0, 0.5, 0.0]), (2, 3, [1.0, 2.0, 0.0])];
        let (system, state) = scene(&[0.0, 1.0, 2.0, 3.0].map(|x| ([x, 0.0, 0.0], 1.0)), &springs).build().unwrap();
        let at = SpringGeometry::at(&system, &state.positions).unwrap();
        let mut projection = Projection::new(&system);
        let residual = [8.0, 0.0, 1.0, -3.0].map(|r| Vector3::new(0.0, r, 0.0));
        projection.begin(&system, &residual);
        assert_eq!(projection.update(&system, &at), 0);
        // Half of the largest.
        assert!(projection.lower(&system, &at, 0, 2));
        assert_eq!(projection.threshold, 4.0);
        assert_eq!(projection.options(), [Stiffness::Tension, Stiffness::Full, Stiffness::Full]);
        // At 2 N the spring 2–3 follows, and these are all.
        assert!(!projection.lower(&system, &at, 1, 2));
        assert_eq!((projection.threshold, projection.update(&system, &at)), (2.0, 2));
        projection.begin(&system, &residual);
        assert_eq!((projection.threshold, projection.update(&system, &at)), (4.0, 1));
        projection.restart();
        projection.begin(&system, &residual);
        assert_eq!(projection.update(&system, &at), 0);
        // Nothing is large where all is zero.
        projection.begin(&system, &[Vector3::zeros(); 4]);
        assert!(!projection.lower(&system, &at, 0, 2));
    }

    /// Along an axis on which a particle is held it has no residual.
    #[test]
    fn reactions_are_no_residuals() {
        let (system, _) = tethered(1.0, 1.0, Spring { stiffness: 1.0, rest_length: 2.0, damping: 0.0 });
        let mut projection = Projection::new(&system);
        projection.begin(&system, &[Vector3::new(9.0, 0.0, 0.0), Vector3::new(3.0, 4.0, 0.0)]);
        assert_eq!((projection.largest, projection.residuals[0].x), (5.0, 0.0));
    }
}
