//! Loads, external forces and springs that change in time.

use super::{State, StateView};
use crate::error::{Invalid, each};
use crate::spring::Spring;
use nalgebra::{Matrix3, Vector3};
use std::fmt::Debug;
use std::ops::{Add, Mul, Sub};

/// The relative difference below which two times are the same: rounding of about 10⁴ added steps.
pub(crate) const SAME_TIME: f64 = 1e-12;

/// A piecewise linear function of time, constant before its first time and after its last.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Curve<T> {
    /// Increasing, in s.
    pub times: Vec<f64>,
    /// One for each time.
    pub values: Vec<T>,
}

impl<T: Copy + Default + Add<Output = T> + Sub<Output = T> + Mul<f64, Output = T>> Curve<T> {
    /// The value at time t; zero for a curve without values.
    pub fn at(&self, t: f64) -> T {
        interpolate(&self.times, &self.values, t, |&value| value)
    }

    /// The derivative just after time t, per second. A time within rounding of a kink counts as the kink.
    pub fn rate(&self, t: f64) -> T {
        let change = |[from, to]: [usize; 2]| {
            let (from, to) = ((self.times[from], self.values.get(from)?), (self.times[to], self.values.get(to)?));
            Some((*to.1 - *from.1) * (1.0 / (to.0 - from.0)))
        };
        segment_after(&self.times, t).and_then(change).unwrap_or_default()
    }

    /// The curve from time t on, with t as time zero.
    pub fn after(&self, t: f64) -> Self {
        let current = self.times.partition_point(|&time| time <= t).saturating_sub(1);
        let mut rest = Self { times: Vec::new(), values: Vec::new() };
        for (time, &value) in self.times.iter().zip(&self.values).skip(current) {
            // Rounding may make times equal: the first of them stays.
            if rest.times.last().is_none_or(|&last| time - t > last) {
                rest.times.push(time - t);
                rest.values.push(value);
            }
        }
        rest
    }
}

/// The value at time t of a piecewise linear function, clamped at both ends; `component` selects a part of each value.
pub(super) fn interpolate<V, T>(times: &[f64], values: &[V], t: f64, component: impl Fn(&V) -> T) -> T
where
    T: Default + Copy + Add<Output = T> + Sub<Output = T> + Mul<f64, Output = T>,
{
    let next = times.partition_point(|&time| time <= t);
    let value = |k: usize| values.get(k).or(values.last()).map(&component).unwrap_or_default();
    match (next.checked_sub(1), times.get(next)) {
        (Some(k), Some(t1)) => value(k) + (value(next) - value(k)) * ((t - times[k]) / (t1 - times[k])),
        _ => value(next.saturating_sub(1)),
    }
}

/// The indices of the ends of the segment just after time t. A time within rounding of a kink counts as the kink: the sum of seven steps of 0.01 s is
/// slightly less than 0.07 s.
pub(super) fn segment_after(times: &[f64], t: f64) -> Option<[usize; 2]> {
    let next = times.partition_point(|&time| time <= t + SAME_TIME * t.abs());
    (next > 0 && next < times.len()).then(|| [next - 1, next])
}

/// Constant loads, drag and gravity that changes in time; see [`System::with_loads`](crate::System::with_loads).
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
    /// True if there are no loads.
    pub fn is_empty(&self) -> bool {
        self.forces.is_empty() && self.drag.is_empty() && self.gravity.is_none()
    }

    /// True if any particle has drag.
    pub fn has_drag(&self) -> bool {
        self.drag.iter().any(|&c| c > 0.0)
    }

    /// The potential `−Σ f·x` of the constant loads, in J, zero at the origin.
    pub fn potential(&self, positions: &[Vector3<f64>]) -> f64 {
        0.0 - self.forces.iter().zip(positions).map(|(f, x)| f.dot(x)).sum::<f64>()
    }

    /// The power `Σ c v²` dissipated by drag, in W.
    pub fn dissipation(&self, velocities: &[Vector3<f64>]) -> f64 {
        self.drag.iter().zip(velocities).map(|(c, v)| c * v.norm_squared()).sum()
    }

    /// Adds the forces, without the weight at time zero.
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

    /// Adds the derivatives of the forces by time, in N/s.
    pub(crate) fn add_rate(&self, masses: &[f64], time: f64, rate: &mut [Vector3<f64>]) {
        if let Some(gravity) = &self.gravity {
            let slope = gravity.rate(time);
            rate.iter_mut().zip(masses).for_each(|(total, mass)| *total += slope * *mass);
        }
    }

    pub(super) fn check(&self, particles: usize, dimension: usize) -> Result<(), Invalid> {
        for (key, count) in [("forces", self.forces.len()), ("drag.coefficient", self.drag.len())] {
            if count > 0 {
                check_length(key, count, particles, "particles")?;
            }
        }
        let vector = |key: &str, at: usize, v: &Vector3<f64>| {
            if State::is_finite_vector(v) && v.iter().skip(dimension).all(|&c| c == 0.0) {
                return Ok(());
            }
            let rule = "must be finite, at most 1e150 in size, and zero along axes that are not modelled";
            Err(Invalid::new(key, format!("{:?}", v.as_slice()), rule).at(at))
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

/// The derivatives of the force on one particle by its own position and velocity.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Derivatives {
    /// ∂f/∂x, in N/m.
    pub stiffness: Matrix3<f64>,
    /// ∂f/∂v, in N·s/m.
    pub damping: Matrix3<f64>,
}

/// A force on particles that the library does not model, such as wind or a floor; see
/// [`System::with_external_force`](crate::System::with_external_force).
///
/// It may depend on time, positions and velocities. If it provides its [derivatives](Self::add_derivatives), their symmetric parts enter the matrices, and a
/// stiff force does not restrict the step: ∂f/∂x is added to K (under `tension` and `axial` its negative semidefinite part) and ∂f/∂v to G.
/// Otherwise it is treated explicitly, which restricts the step but not the order of a method. Only `rodas4`, whose order requires the exact
/// Jacobian, rejects a force without derivatives. The energy balance counts its work as work from outside.
///
/// # Examples
/// A floor with a stiffness of 1 kN/m:
///
/// ```
/// use sprung::nalgebra::Vector3;
/// use sprung::system::{Derivatives, ExternalForce, StateView};
///
/// #[derive(Debug)]
/// struct Floor;
///
/// impl ExternalForce for Floor {
///     fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
///         for (f, x) in force.iter_mut().zip(at.positions) {
///             f.y -= 1e3 * x.y.min(0.0);
///         }
///     }
///
///     fn has_derivatives(&self) -> bool {
///         true
///     }
///
///     fn add_derivatives(&self, at: &StateView<'_>, derivatives: &mut [Derivatives]) {
///         for (derivatives, x) in derivatives.iter_mut().zip(at.positions) {
///             if x.y < 0.0 {
///                 derivatives.stiffness[(1, 1)] -= 1e3;
///             }
///         }
///     }
/// }
/// ```
pub trait ExternalForce: Debug + Send + Sync {
    /// Adds the force on every particle, in N. `force` and the slices of `at` have one entry for each.
    fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]);

    /// True if [`add_derivatives`](Self::add_derivatives) and [`add_rate`](Self::add_rate) are complete. A force that couples particles must return
    /// false.
    fn has_derivatives(&self) -> bool {
        false
    }

    /// Adds ∂f/∂x and ∂f/∂v of every particle. If they are not symmetric, as in a magnetic field, `rodas4` loses its order.
    fn add_derivatives(&self, _: &StateView<'_>, _: &mut [Derivatives]) {}

    /// Adds ∂f/∂t at fixed positions and velocities, in N/s. The default suits forces that do not depend on time explicitly.
    fn add_rate(&self, _: &StateView<'_>, _: &mut [Vector3<f64>]) {}
}

/// Deviations of springs from the law `T = k (l/l0 − 1)` with constant parameters; see
/// [`System::with_behaviour`](crate::System::with_behaviour).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Behaviour {
    /// True for springs that exert neither elastic nor damping force while shorter than at rest; one for every spring, or none at all. It does not
    /// apply to a custom spring law.
    pub tension_only: Vec<bool>,
    /// Rest lengths that change in time; later entries override earlier ones.
    pub actuation: Vec<Actuation>,
}

/// Springs whose rest length is `l0 s(t)`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Actuation {
    /// The springs.
    pub springs: Vec<usize>,
    /// s(t), positive.
    pub factors: Curve<f64>,
}

impl Behaviour {
    /// True if no spring deviates.
    pub fn is_empty(&self) -> bool {
        !self.tension_only.contains(&true) && self.actuation.is_empty()
    }

    /// True if a spring exerts no force under compression.
    #[inline]
    pub fn is_tension_only(&self, spring: usize) -> bool {
        self.tension_only.get(spring).copied().unwrap_or(false)
    }

    /// The index of the actuation of every spring, out of range if it has none; empty without actuation.
    pub(super) fn actuation_indices(&self, springs: usize) -> Vec<u32> {
        if self.actuation.is_empty() {
            return Vec::new();
        }
        let mut indices = vec![u32::MAX; springs];
        for (number, entry) in (0u32..).zip(&self.actuation) {
            entry.springs.iter().for_each(|&spring| indices[spring] = number);
        }
        indices
    }

    pub(super) fn check(&self, springs: &[Spring]) -> Result<(), Invalid> {
        if !self.tension_only.is_empty() {
            check_length("springs.tension_only", self.tension_only.len(), springs.len(), "springs")?;
        }
        for (index, Actuation { springs: numbers, factors }) in self.actuation.iter().enumerate() {
            let key = format!("springs.actuation[{index}]");
            for (at, &spring) in numbers.iter().enumerate() {
                let wrong = |rule: String| Err(Invalid::new(format!("{key}.springs"), spring, rule).at(at));
                match springs.get(spring) {
                    None => return wrong(format!("names a spring that does not exist (there are {})", springs.len())),
                    Some(named) if named.rest_length == 0.0 => return wrong("has no rest length to change".into()),
                    Some(_) => {}
                }
            }
            let path = format!("{key}.path");
            check_times(&path, &factors.times, ("factors", factors.values.len()))?;
            for (at, &factor) in factors.values.iter().enumerate() {
                let is_good = numbers.iter().all(|&spring| {
                    let length = springs[spring].rest_length * factor;
                    length.is_finite() && length > 0.0
                });
                if !(factor.is_finite() && factor > 0.0 && is_good) {
                    let rule = "must be finite and positive, and so must the rest lengths that it makes";
                    return Err(Invalid::new(format!("{path}.factors"), factor, rule).at(at));
                }
            }
        }
        Ok(())
    }

    /// True if any spring is not one of the built-in law with a constant rest length.
    pub(super) fn has_special(&self, springs: &[Spring]) -> bool {
        !self.is_empty() || springs.iter().any(|spring| spring.rest_length == 0.0)
    }

    /// The behaviour of the springs `numbers`, ascending, which are renumbered from zero.
    pub(super) fn renumbered(&self, numbers: &[usize]) -> Self {
        let flags = numbers.iter().map(|&s| self.is_tension_only(s));
        let tension_only = if self.tension_only.is_empty() { Vec::new() } else { flags.collect() };
        let mut actuation = self.actuation.clone();
        for entry in &mut actuation {
            entry.springs = entry.springs.iter().filter_map(|spring| numbers.binary_search(spring).ok()).collect();
        }
        Self { tension_only, actuation }
    }
}

/// An error unless times are finite, increase, and have one value each.
pub(super) fn check_times(key: &str, times: &[f64], values: (&str, usize)) -> Result<(), Invalid> {
    let times_key = format!("{key}.times");
    if times.is_empty() {
        return Err(Invalid::new(times_key, "[]", "must have at least one entry"));
    }
    check_length(&format!("{key}.{}", values.0), values.1, times.len(), "times")?;
    for (at, &time) in times.iter().enumerate() {
        if !time.is_finite() {
            return Err(Invalid::new(times_key, time, "must be finite").at(at));
        }
        if at > 0 && time <= times[at - 1] {
            return Err(Invalid::new(times_key, time, "times must increase").at(at));
        }
    }
    Ok(())
}

pub(crate) fn check_length(key: &str, found: usize, expected: usize, of: &str) -> Result<(), Invalid> {
    if found == expected {
        return Ok(());
    }
    Err(Invalid::new(key, format!("a list of {found}"), format!("must have one entry for {}", each(expected, of))))
}
