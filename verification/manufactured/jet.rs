//! Functions of time with their derivatives.

use std::ops::{Add, Mul, Sub};

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
    T: Copy + Sub<Output = T> + Add<Output = T> + Mul<f64, Output = T>,
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
