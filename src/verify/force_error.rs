//! Error bounds of central differences of the elastic force.
//!
//! A spring's force is `f = −(k/l0) d + k n(d)`, `n = d/‖d‖`: only n is curved; without a rest length it is `f = −k d`, and all that n contributes is
//! absent. Along a displacement δ of d, with θ the angle between δ and n, its second and third derivatives have the norms
//!
//! ```text
//! ‖n''‖  = (‖δ‖/l)² sin θ √(1 + 3 cos²θ)                               ≤ (2/√3) (‖δ‖/l)²
//! ‖n'''‖ = (‖δ‖/l)³ sin θ √((9 cos²θ − 3)² + 36 cos²θ sin²θ)           ≤ 3 (‖δ‖/l)³
//! ```
//!
//! (differentiate the angle `atan(s sin θ/(1 + s cos θ))` that n turns by). So the central difference over ±h differs from the derivative by at most
//! `k h² ‖δ‖³/(2 (l − h‖δ‖)³)`, by Taylor's theorem with the remainder taken at the shortest length in between. If x ± h round to a pair whose middle
//! is off by m, the difference is the derivative elsewhere, wrong by at most `(2/√3) k m ‖δ‖/l²`.
//!
//! Rounding: a computed d has a relative error of u, l one of 3.5 u, n one of 5.5 u; the strain is off by `3.5 u l/l0`
//! and twice u of itself. With two more products the force is off by at most `13 u k max(1, l/l0)`, 15 u over lengths
//! within l/8. Adding the forces of all springs at a particle adds u of their sum of magnitudes for every spring.

use super::reference::{active_links, sizes};
use super::{Link, U, random_vector};
use crate::force::{DegenerateSpring, SpringGeometry};
use crate::system::System;
use nalgebra::Vector3;

/// `(2/√3)`, the largest `‖n''‖` at unit length and displacement.
pub(super) const SECOND: f64 = 1.154_700_538_379_251_6;

impl Link {
    /// Rounding of the force, in N.
    pub fn force_rounding(&self) -> f64 {
        15.0 * U * (self.axial * self.length).max(self.curved)
    }

    /// Rounding of an entry of the block by any stable formula, in N/m: k/l0 and k/l are rounded 12 times.
    pub fn block_rounding(&self) -> f64 {
        12.0 * U * self.magnitude()
    }

    /// Truncation of the central difference over ±h along a displacement of norm `delta`, in N/m.
    pub fn truncation(&self, h: f64, delta: f64) -> f64 {
        let shortest = self.length - h * delta;
        if self.curved == 0.0 {
            return 0.0;
        }
        if shortest > 0.0 { 0.5 * self.curved * h * h * (delta / shortest).powi(3) } else { f64::INFINITY }
    }

    /// Factor of h² in the truncation along a unit displacement, for small h.
    pub fn curvature(&self) -> f64 {
        0.5 * self.curved / self.length.powi(3)
    }

    /// All errors of a central difference but the rounding of forces: truncation, the offset of the middle, the rounding of the block itself.
    pub fn difference_error(&self, step: Step) -> f64 {
        let h = 0.5 * step.width();
        let moved =
            if self.curved == 0.0 { 0.0 } else { SECOND * self.curved * step.offset / (self.length - h).powi(2) };
        self.truncation(h, 1.0) + moved + self.block_rounding()
    }
}

/// A central difference's two points after rounding.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    pub forward: f64,
    pub backward: f64,
    /// The distance of the middle from the wanted point.
    offset: f64,
}

impl Step {
    /// Truncation `T h²` and rounding `ρ/h` are least together at `h = (ρ/2T)^{1/3}`; not beyond an eighth of the
    /// length, and at least 16 units in the last place of x.
    pub fn best(x: f64, rounding: f64, curvature: f64, length: f64) -> Self {
        let best = (rounding / (2.0 * curvature)).cbrt();
        // Without a spring the force is zero and any step will do.
        let h = Some(best.min(length / 8.0)).filter(|h| h.is_finite()).unwrap_or(1.0);
        Self::around(x, h.max(32.0 * U * x.abs()))
    }

    /// The points x ± h.
    pub fn around(x: f64, h: f64) -> Self {
        let (forward, backward) = (x + h, x - h);
        Self { forward, backward, offset: 0.5 * ((forward - x) - (x - backward)).abs() }
    }

    /// The distance of the two points: exact where h is small against x, by Sterbenz' lemma.
    pub fn width(&self) -> f64 {
        self.forward - self.backward
    }
}

/// The error analysis of f_el at one configuration.
pub(super) struct ForceError<'a> {
    pub system: &'a System,
    /// The springs that have a free end.
    pub links: Vec<Link>,
    /// Positions in `links` of every particle's springs.
    at: Vec<Vec<usize>>,
    /// Bound of the rounding error of the force on every particle, in N.
    pub rounding: Vec<f64>,
}

impl<'a> ForceError<'a> {
    pub fn new(system: &'a System, positions: &[Vector3<f64>]) -> Result<Self, DegenerateSpring> {
        // Every spring has a direction.
        SpringGeometry::at(system, positions)?;
        let links = active_links(system, positions);
        let particles = system.particles();
        let mut at = vec![Vec::new(); particles];
        for (position, link) in links.iter().enumerate() {
            link.ends.iter().for_each(|&end| at[end].push(position));
        }
        let magnitudes = sizes(&links, particles, |link| link.elastic_force().norm());
        let mut rounding = sizes(&links, particles, Link::force_rounding);
        for ((rounding, magnitude), springs) in rounding.iter_mut().zip(magnitudes).zip(&at) {
            *rounding += springs.len() as f64 * U * magnitude;
        }
        Ok(Self { system, links, at, rounding })
    }

    pub fn links_at(&self, particle: usize) -> impl Iterator<Item = &Link> + '_ {
        self.at[particle].iter().map(|&position| &self.links[position])
    }

    /// The springs that put a block at the rows of one particle and the columns of another, or the same.
    pub fn links_between(&self, row: usize, column: usize) -> impl Iterator<Item = &Link> + '_ {
        self.links_at(column).filter(move |link| row == column || link.ends.contains(&row))
    }

    /// The length of the shortest spring at a particle, in m; infinite without one.
    pub fn shortest(&self, particle: usize) -> f64 {
        self.links_at(particle).map(|link| link.length).fold(f64::INFINITY, f64::min)
    }

    /// `l/(2√3)` of the shortest spring at a particle, in m: with three such components it moves by half of that spring. Zero without one.
    pub fn displacement(&self, particle: usize) -> f64 {
        let shortest = self.shortest(particle);
        if shortest.is_finite() { shortest / (2.0 * 3.0_f64.sqrt()) } else { 0.0 }
    }

    /// A random direction that moves no particle by more than half of its shortest spring, reduced.
    pub fn direction(&self, seed: u64) -> Vec<f64> {
        let dofs = self.system.dofs();
        let mut w = random_vector(dofs.len(), seed);
        for particle in 0..self.system.particles() {
            w[dofs.rows(particle)].iter_mut().for_each(|w| *w *= self.displacement(particle));
        }
        w
    }

    pub fn step(&self, particle: usize, x: f64) -> Step {
        let curvature = self.links_at(particle).map(Link::curvature).sum();
        Step::best(x, self.rounding[particle], curvature, self.shortest(particle))
    }

    /// Bound of the error of the difference quotient of the force on `row` along a coordinate of `column`, in N/m.
    pub fn allowed(&self, row: usize, column: usize, step: Step) -> f64 {
        let own: f64 = self.links_between(row, column).map(|link| link.difference_error(step)).sum();
        own + self.rounding[row] / (0.5 * step.width())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::fixtures::assert_close;
    use crate::verify::fixtures::pair;
    use crate::verify::reference::links;

    /// Over ±1/4 m, with a middle that is 1/8 m off, of a spring of k = 100 N that is 1 m long, 2 m at rest.
    #[test]
    fn errors_of_a_difference_by_hand() {
        let case = pair(2.0, 0.1);
        let link = links(&case.system, &case.state.positions)[0];
        let curved = 0.5 * 100.0 * 0.0625 / 0.75_f64.powi(3);
        assert_close(link.truncation(0.25, 1.0), curved);
        assert_close(link.curvature(), 50.0);
        let moved = SECOND * 100.0 * 0.125 / (0.75 * 0.75);
        let block = 12.0 * U * 100.0 * 1.5;
        let step = Step { forward: 1.25, backward: 0.75, offset: 0.125 };
        assert_close(link.difference_error(step), curved + moved + block);
        assert_close(link.block_rounding(), block);
        assert_close(link.force_rounding(), 15.0 * U * 100.0);
        assert_eq!(link.truncation(1.25, 1.0), f64::INFINITY);
    }

    /// The best step is `(ρ/2T)^(1/3)`, an eighth of the length at most; without a spring it is 1.
    #[test]
    fn steps_balance_rounding_and_truncation() {
        let ends = |step: Step| [step.forward, step.backward, step.offset, step.width()];
        assert_eq!(ends(Step::best(1.0, 1.0, 4.0, 100.0)), [1.5, 0.5, 0.0, 1.0]);
        assert_eq!(ends(Step::best(1.0, 1.0, 1e-6, 2.0)), [1.25, 0.75, 0.0, 0.5]);
        assert_eq!(ends(Step::best(3.0, 0.0, 0.0, f64::INFINITY)), [4.0, 2.0, 0.0, 2.0]);
    }
}
