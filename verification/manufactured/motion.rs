//! A motion prescribed in time, and the external force that makes it the exact solution.
//!
//! ```text
//! f_ext(t) = M ẍ + c ẋ − f − M g(t) − Σ T n,      T = T_el(l, t) + b l̇,      n = (x_j − x_i)/l
//! ```
//!
//! for chosen x(t), with the derivatives of length and direction `l̇ = n·ḋ`, `l̈ = (ḋ·ḋ − l̇²)/l + n·d̈`, `ṅ = (ḋ − n l̇)/l`. It depends on
//! time only, so no Jacobian changes. Its rate, which Rosenbrock methods use, needs the third derivative of x. Everything is written from
//! the tension and its derivatives, without the library's forces: a wrong law in f, U and K alike moves the solution away from x(t).

use super::scenes::{Law, Scene};
use nalgebra::Vector3;
use sprung::system::{Derivatives, ExternalForce, StateView};
use std::ops::{Add, Mul};
use std::sync::Arc;

/// A function of time by its value and three derivatives.
#[derive(Debug, Clone, Copy)]
pub struct Jet(pub [f64; 4]);

impl Jet {
    pub fn constant(value: f64) -> Self {
        Self([value, 0.0, 0.0, 0.0])
    }

    /// `a sin(ω t + φ)`.
    pub fn wave(amplitude: f64, rate: f64, phase: f64, t: f64) -> Self {
        let (sin, cos) = (rate * t + phase).sin_cos();
        Self([sin, rate * cos, -rate.powi(2) * sin, -rate.powi(3) * cos].map(|derivative| amplitude * derivative))
    }
}

impl Add for Jet {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|order| self.0[order] + other.0[order]))
    }
}

/// Leibniz's rule.
impl Mul for Jet {
    type Output = Self;

    fn mul(self, Self(g): Self) -> Self {
        let f = self.0;
        Self([
            f[0] * g[0],
            f[1] * g[0] + f[0] * g[1],
            f[2] * g[0] + 2.0 * f[1] * g[1] + f[0] * g[2],
            f[3] * g[0] + 3.0 * f[2] * g[1] + 3.0 * f[1] * g[2] + f[0] * g[3],
        ])
    }
}

/// Value and rate, just after t, of a piecewise linear function, constant before its first time and after its last.
pub fn piecewise<T>(times: &[f64], values: &[T], t: f64) -> (T, T)
where
    T: Copy + std::ops::Sub<Output = T> + Add<Output = T> + Mul<f64, Output = T>,
{
    // A time within rounding of a kink counts as the kink.
    let after = times.iter().filter(|&&time| time <= t * (1.0 + 1e-12)).count();
    if after == 0 || after == times.len() {
        let value = values[after.saturating_sub(1)];
        return (value, value * 0.0);
    }
    let slope = (values[after] - values[after - 1]) * (1.0 / (times[after] - times[after - 1]));
    (values[after - 1] + slope * (t - times[after - 1]), slope)
}

/// The force that makes the motion of a scene exact.
#[derive(Debug)]
pub struct Manufactured(pub Arc<Scene>);

impl Manufactured {
    /// Force on every particle, in N, and its rate, in N/s.
    pub fn at(&self, t: f64) -> Vec<[Vector3<f64>; 2]> {
        let scene = &*self.0;
        let motion = scene.motion(t);
        let (gravity, change) = piecewise(&scene.gravity.times, &scene.gravity.values, t);
        let inertia = |(p, [_, v, a, j]): (usize, &[Vector3<f64>; 4])| {
            let (m, c) = (scene.masses[p], scene.drag[p]);
            [(a - gravity) * m + v * c - scene.forces[p], (j - change) * m + a * c]
        };
        let mut force: Vec<_> = motion.iter().enumerate().map(inertia).collect();
        for (number, &[i, j]) in scene.pairs.iter().enumerate() {
            let [d, d1, d2] = [0, 1, 2].map(|order| motion[j][order] - motion[i][order]);
            let l = d.norm();
            let n = d / l;
            let l1 = n.dot(&d1);
            let l2 = (d1.dot(&d1) - l1 * l1) / l + n.dot(&d2);
            let n1 = (d1 - n * l1) / l;
            let [tension, by_length, by_time] = scene.tension(number, l, t);
            let b = scene.springs[number].damping;
            let pull = n * (tension + b * l1);
            let rate = n * (by_length * l1 + by_time + b * l2) + n1 * (tension + b * l1);
            for (p, sign) in [(i, 1.0), (j, -1.0)] {
                force[p][0] -= pull * sign;
                force[p][1] -= rate * sign;
            }
        }
        force
    }
}

impl Scene {
    /// `T_el`, `∂T/∂l` and `∂T/∂t` of a spring.
    fn tension(&self, number: usize, l: f64, t: f64) -> [f64; 3] {
        let spring = self.springs[number];
        let (k, rest) = (spring.stiffness, spring.rest_length);
        if rest == 0.0 {
            return [k * l, k, 0.0];
        }
        let actuated = self.actuation.iter().find(|entry| entry.springs.contains(&number));
        let (factor, change) =
            actuated.map_or((1.0, 0.0), |entry| piecewise(&entry.factors.times, &entry.factors.values, t));
        let l0 = rest * factor;
        let (strain, by_length, by_time) = (l / l0 - 1.0, 1.0 / l0, -l / (l0 * l0) * rest * change);
        let (law, slope) = match self.law {
            Law::Linear => (strain, 1.0),
            Law::Cubic => (strain + strain.powi(3), 1.0 + 3.0 * strain * strain),
        };
        [k * law, k * slope * by_length, k * slope * by_time]
    }
}

impl ExternalForce for Manufactured {
    fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
        force.iter_mut().zip(self.at(at.time)).for_each(|(total, [f, _])| *total += f);
    }

    fn has_derivatives(&self) -> bool {
        true
    }

    /// None: the force depends on time only.
    fn add_derivatives(&self, _: &StateView<'_>, _: &mut [Derivatives]) {}

    fn add_rate(&self, at: &StateView<'_>, rate: &mut [Vector3<f64>]) {
        rate.iter_mut().zip(self.at(at.time)).for_each(|(total, [_, change])| *total += change);
    }
}
