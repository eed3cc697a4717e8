//! A spring law of the caller's own.
//!
//! A law says with which tension T a spring of length l pulls its ends together. All that methods need of it at a length is T
//! and `T' = dT/dl`, and these are also those of one spring of the built-in law, its *tangent*: with
//!
//! ```text
//! k = T' l − T,      l0 = k/T',
//! ```
//!
//! `k (l/l0 − 1) = T` and `k/l0 = T'`. So every formula of this module holds for the tangent at hand: force, stiffness block and its
//! options, whether a spring is compressed (whether it pushes, `T < 0`). Only energies are the law's own.
//!
//! **Edge cases.** Where tension does not rise with length there is no such tangent, and `K^s` is indefinite along the spring too. Its
//! slope counts as a billionth of the spring's own `k/l0` then: forces stay exact, and the matrix is that of a convex law. A tangent through
//! `T = 0` at `l = 0` has no rest length, and its slope counts a hundred-millionth more.

use super::Spring;
use std::fmt::Debug;

/// What a law says at a length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tension {
    /// T, in N; positive where the spring pulls its ends together.
    pub force: f64,
    /// T', in N/m.
    pub slope: f64,
}

/// The law of all springs of a system, in place of `T = k (l/l0 − 1)`; see
/// [`System::with_spring_law`](crate::System::with_spring_law). Damping along the spring remains the built-in one.
///
/// # Examples
/// Springs that stiffen with the cube of their strain:
///
/// ```
/// use sprung::Spring;
/// use sprung::spring::{SpringLaw, Tension};
///
/// #[derive(Debug)]
/// struct Cubic;
///
/// impl SpringLaw for Cubic {
///     fn tension(&self, _: usize, spring: &Spring, length: f64) -> Tension {
///         let (k, strain) = (spring.stiffness, length / spring.rest_length - 1.0);
///         Tension { force: k * (strain + strain.powi(3)), slope: k * (1.0 + 3.0 * strain * strain) / spring.rest_length }
///     }
///
///     fn energy(&self, _: usize, spring: &Spring, length: f64) -> f64 {
///         let strain = length / spring.rest_length - 1.0;
///         spring.stiffness * spring.rest_length * (strain.powi(2) / 2.0 + strain.powi(4) / 4.0)
///     }
/// }
///
/// let spring = Spring { stiffness: 8.0, rest_length: 2.0, damping: 0.0 };
/// assert_eq!(Cubic.tension(0, &spring, 4.0), Tension { force: 16.0, slope: 16.0 });
/// ```
pub trait SpringLaw: Debug + Send + Sync {
    /// The tension of the spring of a number, with its parameters, at a length in m.
    fn tension(&self, number: usize, spring: &Spring, length: f64) -> Tension;

    /// What it stores at a length, in J: `∫ T dl`. Time stepping with energies that are not those of the tension fails in line searches
    /// and by alarms of energy from nowhere.
    fn energy(&self, number: usize, spring: &Spring, length: f64) -> f64;

    /// Whether it is asked for all springs at once, by [`values`](Self::values): where that costs less than asking one by one, as of a law
    /// that an interpreter runs.
    fn is_asked_at_once(&self) -> bool {
        false
    }

    /// What it says of all springs of the system at one configuration, those between held particles too: one entry for each, in their order. By
    /// default what it says of each.
    fn values(&self, springs: &[Spring], lengths: &[f64]) -> Vec<LawValue> {
        let each = springs.iter().zip(lengths).enumerate();
        let value = |(number, (spring, &length)): (usize, (&Spring, &f64))| LawValue {
            tension: self.tension(number, spring, length),
            energy: self.energy(number, spring, length),
        };
        each.map(value).collect()
    }
}

/// What a law says of one of all springs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawValue {
    /// T and T'.
    pub tension: Tension,
    /// What the spring stores, in J.
    pub energy: f64,
}

/// What a law that is asked for all springs at once says at one configuration; nothing of any other law, which is asked spring by spring.
#[derive(Debug, Clone, Default)]
pub(crate) struct LawValues(Vec<LawValue>);

impl LawValues {
    /// Of springs without such a law.
    pub(crate) const NONE: &'static Self = &Self(Vec::new());

    /// Of springs with these parameters at these lengths.
    pub(crate) fn of(law: &dyn SpringLaw, springs: &[Spring], lengths: &[f64]) -> Self {
        Self(law.values(springs, lengths))
    }

    /// Of the spring of a number.
    #[inline]
    pub(crate) fn get(&self, number: usize) -> Option<&LawValue> {
        self.0.get(number)
    }
}

/// The least slope, as a part of `k/l0`.
const FLAT: f64 = 1e-9;

/// How near to the origin a tangent may pass, as a part of `T' l`.
const THROUGH_ORIGIN: f64 = 1e-9;

impl Spring {
    /// The spring of the built-in law that has a tension and its slope at a length, with this spring's damping.
    pub(crate) fn tangent(&self, Tension { force, slope }: Tension, length: f64) -> Self {
        let mut slope = slope.max(FLAT * self.axial_stiffness());
        if (slope * length - force).abs() < THROUGH_ORIGIN * slope * length {
            slope *= 1.0 + 10.0 * THROUGH_ORIGIN;
        }
        let stiffness = slope * length - force;
        Self { stiffness, rest_length: stiffness / slope, damping: self.damping }
    }
}

#[cfg(test)]
mod tests {
    use super::Tension;
    use crate::spring::{Extension, Spring, Stiffness};
    use nalgebra::Vector3;

    /// Force, both coefficients of the block and the sign of the tension, of pulling and pushing springs; a slope that is not
    /// positive leaves the force as it is.
    #[test]
    fn tangents_have_the_tension_and_its_slope() {
        let own = Spring { stiffness: 5.0, rest_length: 1.0, damping: 0.5 };
        for (force, slope) in [(3.0, 4.0), (-3.0, 4.0), (50.0, 4.0), (8.0, 4.0), (0.0, 1.0), (2.0, 0.0), (-2.0, -7.0)] {
            let at = Extension { direction: Vector3::x(), length: 2.0 };
            let tangent = own.tangent(Tension { force, slope }, at.length);
            assert!((tangent.elastic_force(&at).x + force).abs() < 1e-12 * (1.0 + force.abs()), "{force} {slope}");
            let block = tangent.stiffness_block(&at, Stiffness::Full);
            assert!((block.transverse - force / 2.0).abs() < 1e-12 * (1.0 + force.abs()), "{force} {slope}");
            assert!((block.axial - slope.max(0.0)).abs() < 1e-7, "{force} {slope}: {}", block.axial);
            assert!(tangent.stiffness_block(&at, Stiffness::Tension).transverse >= 0.0);
            assert_eq!(tangent.damping, 0.5);
        }
    }

    /// Where T = T' l the tangent passes through the origin, and near it its slope is a hundred-millionth more; beside that, and with
    /// any slope that is more than a billionth of k/l0 = 2.5, it is what it is.
    #[test]
    fn slopes_are_changed_only_where_there_is_no_tangent() {
        let own = Spring { stiffness: 5.0, rest_length: 2.0, damping: 0.0 };
        let slope = |force: f64, slope: f64| {
            let tangent = own.tangent(Tension { force, slope }, 2.0);
            tangent.stiffness / tangent.rest_length
        };
        let more = 4.0 * (1.0 + 1e-8);
        for (off, expected) in [(-2e-9, 4.0), (-5e-10, more), (0.0, more), (5e-10, more), (2e-9, 4.0)] {
            let found = slope(8.0 * (1.0 + off), 4.0);
            assert!((found / expected - 1.0).abs() < 1e-14, "{off} {found}");
        }
        for (given, expected) in [(-1.0, 2.5e-9), (2e-9, 2.5e-9), (3e-9, 3e-9)] {
            assert!((slope(1.0, given) / expected - 1.0).abs() < 1e-14, "{given}");
        }
    }
}
