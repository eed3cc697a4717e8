//! What errors are relative to, and how long a first step is.

use super::{AdaptiveOptions, ErrorEstimate};
use crate::force::{SpringGeometry, set_accelerations};
use crate::system::{State, System};
use nalgebra::Vector3;

/// The tolerance at which every step may make an error of it.
const COARSE: f64 = 0.5;

/// The way of particles, relative to X, up to which errors at the end grow in proportion to it.
const FAR: f64 = 10.0;

/// X is at least this part of the largest so far: two particles that pass each other have no extent for a moment.
const LEAST_EXTENT: f64 = 1e-2;

/// A run in which nothing moves yet nor is pulled has at least this part of X/T for a speed.
const LEAST_SPEED: f64 = 1e-3;

/// X, V and the length of the run.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scales {
    /// r.
    tolerance: f64,
    rtol: f64,
    /// (p + 1)/q: errors at the end fall as the power q/(p + 1) of what steps are held to.
    power: f64,
    duration: f64,
    /// V.
    speed: f64,
    /// The largest spread of the particles so far.
    spread: f64,
}

impl Scales {
    /// At the start of a run by a method of order q whose estimate falls as h^(p + 1), and the number of force evaluations that took. Where forces are undefined the first step fails
    /// and says so; here they count as none.
    pub fn at_start(system: &System, state: &State, how: &AdaptiveOptions, [q, p]: [u32; 2]) -> (Self, u64) {
        let (rtol, duration) = (how.rtol, how.part_of.unwrap_or(how.duration));
        let power = f64::from(p + 1) / f64::from(q);
        let tolerance = rtol * (rtol / COARSE).min(1.0).powf(power - 1.0);
        let a0 = accelerations(system, state).map_or(0.0, |a| norm(&a));
        let spread = spread(&state.positions);
        // Within the run, or within the extent where there is one.
        let gained = if spread > 0.0 { (a0 * duration).min((a0 * spread).sqrt()) } else { a0 * duration };
        let speed = norm(&state.velocities).max(0.3 * gained).max(LEAST_SPEED * spread / duration);
        (Self { tolerance, rtol, power, duration, speed, spread }, 1)
    }

    /// After an accepted step.
    pub fn see(&mut self, state: &State) {
        self.speed = self.speed.max(norm(&state.velocities));
        self.spread = self.spread.max(spread(&state.positions));
    }

    /// e of a step.
    pub fn error(&self, estimate: &ErrorEstimate, state: &State) -> f64 {
        let error = self.norm(estimate.positions, estimate.velocities, state);
        if error.is_nan() { f64::INFINITY } else { error }
    }

    /// `√(‖e_x‖² + (X/V)² ‖e_v‖²)/(r X) · w^((p + 1)/q)`; nothing out of nothing is nothing.
    fn norm(&self, positions: &[Vector3<f64>], velocities: &[Vector3<f64>], state: &State) -> f64 {
        let length = self.length(state);
        let part = |error: f64, whole: f64| if error == 0.0 { 0.0 } else { error / whole };
        part(norm(positions), length).hypot(part(norm(velocities), self.speed)) / self.tolerance
            * far(self.speed * self.duration / length).powf(self.power)
    }

    /// The error of a step of h seconds that takes a share of the kinetic energy from the motion, see [`AdaptiveStepper::rotational_damping`]: when all
    /// steps of the run do, velocities are lower by half of what they take together at the end and by a quarter in the mean, and
    /// positions lag by as much of the way TV.
    ///
    /// [`AdaptiveStepper::rotational_damping`]: super::AdaptiveStepper::rotational_damping
    pub fn lag(&self, share: f64, h: f64, state: &State) -> f64 {
        if share == 0.0 {
            return 0.0;
        }
        let ways = self.speed * self.duration / self.length(state);
        let error = 0.25 * share * (self.duration / h) * ways / self.rtol;
        if error.is_nan() { f64::INFINITY } else { error }
    }

    /// X.
    fn length(&self, state: &State) -> f64 {
        let length = spread(&state.positions).max(LEAST_EXTENT * self.spread);
        if length > 0.0 { length } else { self.speed * self.duration }
    }

    /// A first step for a method whose estimate falls as h^(p + 1), after Hairer, Nørsett and Wanner (Solving Ordinary Differential Equations I,
    /// II.4), and the number of force evaluations that took.
    ///
    /// With `‖·‖` the norm of e and `y' = F(y)`: an Euler step of `h₀ = 0.01/(r ‖F‖)` seconds probes how fast F changes,
    /// `F' = ‖F(y + h₀ F) − F(y)‖/h₀`, and `h₁ = (0.01/max(‖F‖, F'))^{1/(p + 1)}` would leave an error of about a hundredth. The step
    /// is `min(100 h₀, h₁)`.
    pub fn first_step(&self, system: &System, state: &State, how: &AdaptiveOptions, p: u32) -> (f64, u64) {
        let Some(a) = accelerations(system, state) else { return (how.duration, 1) };
        let rate = self.norm(&state.velocities, &a, state);
        if rate == 0.0 || !rate.is_finite() {
            return (how.duration, 1);
        }
        let h0 = (0.01 / (self.tolerance * rate)).min(how.duration);
        let mut probe = state.clone();
        for ((x, v), a) in probe.positions.iter_mut().zip(&mut probe.velocities).zip(&a) {
            *x += *v * h0;
            *v += a * h0;
        }
        probe.time += h0;
        probe.prescribe(system);
        let Some(b) = accelerations(system, &probe) else { return (h0, 2) };
        let changes = |after: &[Vector3<f64>], before: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
            after.iter().zip(before).map(|(b, a)| (b - a) / h0).collect()
        };
        let change = self.norm(&changes(&probe.velocities, &state.velocities), &changes(&b, &a), state);
        let h1 = (0.01 / rate.max(change)).powf(1.0 / f64::from(p + 1));
        // NaN where the probe has left all numbers.
        let step = if h1 > 0.0 { h1.min(100.0 * h0) } else { h0 };
        (step.min(how.duration), 2)
    }
}

/// w, for particles that travel so many times the extent.
fn far(ways: f64) -> f64 {
    ways.min(FAR).max(ways / FAR).max(1.0)
}

/// What a fine and a coarse estimate are together.
pub(in crate::integrate) fn joint(fine: f64, coarse: f64) -> f64 {
    let both = fine.hypot(0.1 * coarse);
    if fine == 0.0 || !both.is_finite() { fine } else { fine * (fine / both) }
}

/// Of all forces; `None` where the ends of a spring coincide.
fn accelerations(system: &System, state: &State) -> Option<Vec<Vector3<f64>>> {
    let extensions = SpringGeometry::at(system, state).ok()?;
    let mut accelerations = vec![Vector3::zeros(); system.particles()];
    set_accelerations(system, &extensions, &state.moment(), &mut accelerations);
    Some(accelerations)
}

/// `‖x − centroid‖`, zero where it is within rounding of the coordinates.
fn spread(positions: &[Vector3<f64>]) -> f64 {
    let centroid = positions.iter().sum::<Vector3<f64>>() / positions.len().max(1) as f64;
    let (spread, reach) = positions
        .iter()
        .fold((0.0, 0.0f64), |(sum, reach), x| (sum + (x - centroid).norm_squared(), reach.max(x.norm_squared())));
    if spread > 1e-24 * reach { spread.sqrt() } else { 0.0 }
}

/// Euclidean, over the particles of all parts of a system.
pub(in crate::integrate) fn norm_of_all(system: &System, vectors: &[Vector3<f64>]) -> f64 {
    let own = vectors.iter().take(system.own_particles()).map(|v| v.norm_squared()).sum::<f64>();
    let [squared] = system.total([own]);
    squared.sqrt()
}

/// Euclidean, over all components.
pub(super) fn norm(vectors: &[Vector3<f64>]) -> f64 {
    vectors.iter().map(|v| v.norm_squared()).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests;
