//! Forces on particles that a scene describes: constant loads, drag, and gravity that changes in time.

use super::curve::check_times;
use super::{Curve, State, StateView};
use crate::error::Invalid;
use nalgebra::Vector3;

/// Forces on particles beside weight and springs; see [`System::with_loads`](crate::System::with_loads).
///
/// The force on a particle is `f − c v + m (g(t) − g(0))`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Loads {
    /// f, constant, in N; one for every particle, or none at all.
    pub forces: Vec<Vector3<f64>>,
    /// c, in N·s/m, not negative; one for every particle, or none at all.
    pub drag: Vec<f64>,
    /// Gravity that changes in time, in m/s², in place of the system's own.
    pub gravity: Option<Curve<Vector3<f64>>>,
}

impl Loads {
    /// Whether there is nothing.
    pub fn is_empty(&self) -> bool {
        self.forces.is_empty() && self.drag.is_empty() && self.gravity.is_none()
    }

    /// Whether any particle is slowed down.
    pub fn has_drag(&self) -> bool {
        self.drag.iter().any(|&c| c > 0.0)
    }

    /// The potential `−Σ f·x` of the constant loads, in J, zero at the origin.
    pub fn potential(&self, positions: &[Vector3<f64>]) -> f64 {
        0.0 - self.forces.iter().zip(positions).map(|(f, x)| f.dot(x)).sum::<f64>()
    }

    /// The power `Σ c v²` that drag takes away, in W.
    pub fn dissipation(&self, velocities: &[Vector3<f64>]) -> f64 {
        self.drag.iter().zip(velocities).map(|(c, v)| c * v.norm_squared()).sum()
    }

    /// Adds the forces; the weight at time zero is not among them.
    pub(crate) fn add(&self, masses: &[f64], at: &StateView<'_>, force: &mut [Vector3<f64>]) {
        force.iter_mut().zip(&self.forces).for_each(|(total, f)| *total += f);
        for ((total, c), v) in force.iter_mut().zip(&self.drag).zip(at.velocities) {
            *total -= v * *c;
        }
        if let Some(gravity) = &self.gravity {
            let more = gravity.at(at.time) - gravity.at(0.0);
            force.iter_mut().zip(masses).for_each(|(total, mass)| *total += more * *mass);
        }
    }

    /// Adds their derivatives by time, in N/s.
    pub(crate) fn add_rate(&self, masses: &[f64], time: f64, rate: &mut [Vector3<f64>]) {
        if let Some(gravity) = &self.gravity {
            let slope = gravity.rate(time);
            rate.iter_mut().zip(masses).for_each(|(total, mass)| *total += slope * *mass);
        }
    }

    pub(super) fn check(&self, particles: usize, dimension: usize) -> Result<(), Invalid> {
        for (key, count) in [("forces", self.forces.len()), ("drag.coefficient", self.drag.len())] {
            if count > 0 {
                super::curve::check_length(key, count, particles, "particles")?;
            }
        }
        let vector = |key: &str, at: usize, v: &Vector3<f64>| {
            let is_good = State::is_finite_vector(v) && v.iter().skip(dimension).all(|&c| c == 0.0);
            let rule = "must be finite, at most 1e150 in size, and zero along axes that are not modelled";
            if is_good { Ok(()) } else { Err(Invalid::new(key, format!("{:?}", v.as_slice()), rule).at(at)) }
        };
        self.forces.iter().enumerate().try_for_each(|(at, f)| vector("forces", at, f))?;
        for (at, &c) in self.drag.iter().enumerate() {
            if !(c.is_finite() && c >= 0.0) {
                return Err(Invalid::new("drag.coefficient", c, "must be finite and not negative").at(at));
            }
        }
        if let Some(Curve { times, values }) = &self.gravity {
            check_times("gravity", times, ("values", values.len()))?;
            values.iter().enumerate().try_for_each(|(at, g)| vector("gravity.values", at, g))?;
        }
        Ok(())
    }
}
