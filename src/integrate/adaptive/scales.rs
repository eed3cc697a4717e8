//! The scales of errors, and the first step.

use super::{AdaptiveOptions, ErrorEstimate};
use crate::force::{SpringGeometry, set_accelerations};
use crate::system::{State, System};
use nalgebra::Vector3;

/// X, V and the length of the run.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scales {
    /// r.
    tolerance: f64,
    rtol: f64,
    /// (p + 1)/q.
    power: f64,
    duration: f64,
    /// V.
    speed: f64,
    /// The largest spread of the particles so far.
    spread: f64,
}

impl Scales {
    /// At the start of a run by a method of order q whose estimate falls as h^(p + 1), by one force evaluation. Undefined forces count as zero here;
    /// the first step fails.
    pub fn at_start(system: &System, state: &State, options: &AdaptiveOptions, [q, p]: [u32; 2]) -> Self {
        let (rtol, duration) = (options.rtol, options.part_of.unwrap_or(options.duration));
        let power = f64::from(p + 1) / f64::from(q);
        let tolerance = rtol * (rtol / 0.5).min(1.0).powf(power - 1.0);
        let a0 = accelerations(system, state).map_or(0.0, |a| norm(&a));
        let spread = spread(&state.positions);
        let gained = if spread > 0.0 { (a0 * duration).min((a0 * spread).sqrt()) } else { a0 * duration };
        // Where nothing moves nor is pulled the speed is not zero either.
        let speed = norm(&state.velocities).max(0.3 * gained).max(1e-3 * spread / duration);
        Self { tolerance, rtol, power, duration, speed, spread }
    }

    pub fn see(&mut self, state: &State) {
        self.speed = self.speed.max(norm(&state.velocities));
        self.spread = self.spread.max(spread(&state.positions));
    }

    pub fn error(&self, estimate: &ErrorEstimate, state: &State) -> f64 {
        let error = self.norm(estimate.positions, estimate.velocities, state);
        if error.is_nan() { f64::INFINITY } else { error }
    }

    /// `√(‖e_x‖² + (X/V)² ‖e_v‖²)/(r X) · w^((p + 1)/q)`, with 0/0 = 0.
    fn norm(&self, positions: &[Vector3<f64>], velocities: &[Vector3<f64>], state: &State) -> f64 {
        let length = self.length(state);
        let part = |error: f64, whole: f64| if error == 0.0 { 0.0 } else { error / whole };
        let path_length = self.speed * self.duration / length;
        let w = path_length.min(10.0).max(path_length / 10.0).max(1.0);
        part(norm(positions), length).hypot(part(norm(velocities), self.speed)) / self.tolerance * w.powf(self.power)
    }

    /// The error of a step of h seconds that takes a share of the kinetic energy from the motion: when all steps of the run do, velocities are lower
    /// by a quarter of the sum in the mean, and positions lag by that part of the path length TV.
    pub fn lag(&self, share: f64, h: f64, state: &State) -> f64 {
        if share == 0.0 {
            return 0.0;
        }
        let path_length = self.speed * self.duration / self.length(state);
        let error = 0.25 * share * (self.duration / h) * path_length / self.rtol;
        if error.is_nan() { f64::INFINITY } else { error }
    }

    /// X.
    fn length(&self, state: &State) -> f64 {
        let length = spread(&state.positions).max(1e-2 * self.spread);
        if length > 0.0 { length } else { self.speed * self.duration }
    }

    /// A first step for a method whose estimate falls as h^(p + 1), after Hairer, Nørsett and Wanner (Solving Ordinary Differential Equations I,
    /// II.4), with the number of force evaluations.
    ///
    /// With `‖·‖` the norm of e and `y' = F(y)`: an Euler step of `h₀ = 0.01/(r ‖F‖)` seconds probes how fast F changes,
    /// `F' = ‖F(y + h₀ F) − F(y)‖/h₀`, and `h₁ = (0.01/max(‖F‖, F'))^{1/(p + 1)}` would leave an error of about a hundredth. The step
    /// is `min(100 h₀, h₁)`.
    pub fn first_step(&self, system: &System, state: &State, options: &AdaptiveOptions, p: u32) -> (f64, u64) {
        let Some(a) = accelerations(system, state) else { return (options.duration, 1) };
        let rate = self.norm(&state.velocities, &a, state);
        if rate == 0.0 || !rate.is_finite() {
            return (options.duration, 1);
        }
        let h0 = (0.01 / (self.tolerance * rate)).min(options.duration);
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
        // NaN where the probe has overflowed.
        let step = if h1 > 0.0 { h1.min(100.0 * h0) } else { h0 };
        (step.min(options.duration), 2)
    }
}

/// A fine and a coarse estimate combined, see [`AdaptiveStepper::coarser_estimate`](super::AdaptiveStepper::coarser_estimate).
pub(in crate::integrate) fn joint(fine: f64, coarse: f64) -> f64 {
    let both = fine.hypot(0.1 * coarse);
    if fine == 0.0 || !both.is_finite() { fine } else { fine * (fine / both) }
}

/// Accelerations by all forces; `None` where the ends of a spring coincide.
fn accelerations(system: &System, state: &State) -> Option<Vec<Vector3<f64>>> {
    let extensions = SpringGeometry::at(system, state).ok()?;
    let mut accelerations = vec![Vector3::zeros(); system.particles()];
    set_accelerations(system, &extensions, &state.moment(), &mut accelerations);
    Some(accelerations)
}

/// `‖x − centroid‖`, zero where it is within rounding of the coordinates.
fn spread(positions: &[Vector3<f64>]) -> f64 {
    let centroid = positions.iter().sum::<Vector3<f64>>() / positions.len().max(1) as f64;
    let spread: f64 = positions.iter().map(|x| (x - centroid).norm_squared()).sum();
    let largest = positions.iter().map(|x| x.norm_squared()).fold(0.0, f64::max);
    if spread > 1e-24 * largest { spread.sqrt() } else { 0.0 }
}

fn norm(vectors: &[Vector3<f64>]) -> f64 {
    vectors.iter().map(|v| v.norm_squared()).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::fixtures::scene;

    /// Particles of 1 kg at these places on the first axis, under a gravity along it.
    fn particles(places: [f64; 2], gravity: f64) -> (System, State) {
        scene(&places.map(|x| ([x, 0.0, 0.0], 1.0)), &[]).gravity(gravity, 0.0, 0.0).clone().build().unwrap()
    }

    /// X = 3√2 m and V = 5 m/s.
    fn moving() -> (System, State) {
        let (system, mut state) = particles([1.0, 7.0], 0.0);
        state.velocities[1] = Vector3::new(3.0, 0.0, 4.0);
        (system, state)
    }

    fn how(duration: f64) -> AdaptiveOptions {
        AdaptiveOptions::new(duration, 1e-3).unwrap()
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-12 * b.abs()
    }

    /// With a way of less than X.
    #[test]
    fn errors_of_positions_and_velocities_are_relative_to_spread_and_speed() {
        let (system, state) = moving();
        let scales = Scales::at_start(&system, &state, &how(0.8), [1, 0]);
        let error = |x: [f64; 2], v: f64| {
            let (positions, velocities) = (&x.map(|x| Vector3::x() * x), &[Vector3::repeat(v); 2]);
            scales.error(&ErrorEstimate { positions, velocities }, &state)
        };
        let (none, some) = ([0.0; 2], [3e-4, 0.0]);
        assert!(close(error(some, 0.0), 3e-4 / (18f64.sqrt() * 1e-3)));
        assert!(close(error(none, 1e-4), 6f64.sqrt() * 1e-4 / (5.0 * 1e-3)));
        assert!(close(error(some, 1e-4), error(some, 0.0).hypot(error(none, 1e-4))));
        assert_eq!(
            [error([f64::NAN; 2], 0.0), error(none, f64::NAN), error(none, 0.0)],
            [f64::INFINITY, f64::INFINITY, 0.0]
        );
    }

    /// Orders q and p decide how much less than rtol = 1e-3 every step may do, and so does a way of more than X, as its power (p + 1)/q: up
    /// to ten times X, and beyond where a tenth of it is more.
    #[test]
    fn steps_may_do_less_where_errors_add_up() {
        let (system, state) = moving();
        let error = |duration: f64, orders: [u32; 2]| {
            let scales = Scales::at_start(&system, &state, &how(duration), orders);
            let positions = [Vector3::new(3e-4, 0.0, 0.0), Vector3::zeros()];
            scales.error(&ErrorEstimate { positions: &positions, velocities: &[] }, &state)
        };
        let plain = 3e-4 / (18f64.sqrt() * 1e-3);
        for (orders, factor, power) in
            [([2, 2], 500f64.sqrt(), 1.5), ([1, 1], 500.0, 2.0), ([4, 3], 1.0, 1.0), ([8, 7], 1.0, 1.0)]
        {
            for (ways, counts) in [(0.5, 1.0), (3.0, 3.0), (10.0, 10.0), (60.0, 10.0), (300.0, 30.0f64)] {
                let found = error(18f64.sqrt() / 5.0 * ways, orders);
                assert!(close(found, factor * counts.powf(power) * plain), "{orders:?} {ways}: {found}");
            }
        }
        let coarse = AdaptiveOptions { rtol: 0.5, ..how(1.0) };
        assert!(close(Scales::at_start(&system, &state, &coarse, [2, 2]).tolerance, 0.5));
    }

    /// Speeds: of the particles, of what they are about to get from their accelerations of 2 m/s² each within the run or within
    /// their spread of √2 m, whichever is less, and a least one.
    #[test]
    fn the_speed_is_the_largest_so_far_or_to_come() {
        let speed = |velocity: f64, gravity: f64, duration: f64| {
            let (system, mut state) = particles([0.0, 2.0], gravity);
            state.velocities[0].y = velocity;
            Scales::at_start(&system, &state, &how(duration), [1, 0]).speed
        };
        assert!(close(speed(7.0, 2.0, 5.0), 7.0));
        assert!(close(speed(0.0, 2.0, 0.1), 0.3 * 8f64.sqrt() * 0.1));
        assert!(close(speed(0.0, 2.0, 5.0), 0.6));
        assert!(close(speed(0.0, 0.0, 5.0), 1e-3 * 2f64.sqrt() / 5.0));
        let (system, mut state) = particles([0.0, 2.0], 0.0);
        let mut scales = Scales::at_start(&system, &state, &how(1.0), [1, 0]);
        for (speed, largest) in [(3.0, 3.0), (2.0, 3.0), (5.0, 5.0)] {
            state.velocities[1] = Vector3::new(0.0, speed, 0.0);
            scales.see(&state);
            assert_eq!(scales.speed, largest);
        }
    }

    /// Without motion and forces the whole run is tried.
    #[test]
    fn first_steps_exist_everywhere() {
        let first = |gravity: f64, p: u32| {
            let (system, state) = particles([0.0, 2.0], gravity);
            let scales = Scales::at_start(&system, &state, &how(7.0), [1, 0]);
            (scales.first_step(&system, &state, &how(7.0), p), scales, state)
        };
        assert_eq!(first(0.0, 2).0, (7.0, 1));
        let ((step, _), ..) = first(1e150, 2);
        assert!(step > 0.0 && step <= 7.0, "{step}");
        // From rest F is (0, a), and changes by (a, 0) in a second.
        let ((step, forces), scales, state) = first(50.0, 1);
        let (none, a) = ([Vector3::zeros(); 2], [Vector3::x() * 50.0; 2]);
        let rate = scales.norm(&none, &a, &state).max(scales.norm(&a, &none, &state));
        assert!(close(step, (0.01 / rate).sqrt()) && forces == 2, "{step}");
    }

    #[test]
    fn two_estimates_make_one() {
        assert!(close(joint(3.0, 40.0), 9.0 / 5.0) && close(joint(2.0, 0.0), 2.0));
        assert_eq!((joint(0.0, 1.0), joint(0.0, 0.0)), (0.0, 0.0));
        assert_eq!([1.0, f64::INFINITY].map(|coarse| joint(f64::INFINITY, coarse)), [f64::INFINITY; 2]);
    }

    /// `¼ B (T/h) TV/X` over rtol = 1e-3, here with X = 3√2 m, V = 5 m/s and T = 0.8 s.
    #[test]
    fn what_turning_springs_take_makes_the_motion_lag() {
        let (system, state) = moving();
        let scales = Scales::at_start(&system, &state, &how(0.8), [1, 0]);
        assert!(close(scales.lag(0.02, 0.1, &state), 0.25 * 0.02 * 8.0 * 4.0 / 18f64.sqrt() / 1e-3));
        assert_eq!((scales.lag(0.0, 0.1, &state), scales.lag(f64::NAN, 0.1, &state)), (0.0, f64::INFINITY));
    }

    /// A spread by rounding is none.
    #[test]
    fn particles_at_one_place_have_no_spread() {
        let at = |places: [f64; 2]| spread(&places.map(|x| Vector3::new(x, 0.0, 0.0)));
        assert_eq!((at([1e6, 1e6 + 1e-8]), at([1e6; 2]), at([0.0; 2])), (0.0, 0.0, 0.0));
        assert!(close(at([1e6, 1e6 + 0.5]), 0.125f64.sqrt()) && close(at([1e-9, 3e-9]), 2e-18f64.sqrt()));
    }
}
