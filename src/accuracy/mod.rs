//! Runs to a required accuracy, and the method that suits a scene.
//!
//! **Confirmed** means that two runs which do not share their errors agree, and that the propagated error explains their difference: a run with the
//! [propagated error](crate::integrate::PropagatedError) of its own steps, and a run of the same method with steps at least twice as fine, which ends
//! as far from the first as that error says. The second run is the answer. With the method's order p and steps f times as fine its error is the
//! difference, or the propagated error where that is more, over f^(p/2), half of the digits that the order promises.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `accuracy`.

mod search;
mod spectral_radius;
mod trial;

pub use search::{AccuracyOptions, Answer, SolverReport, Verdict, run_to_accuracy};
pub use spectral_radius::{SpectralRadius, default_method};
pub(crate) use trial::adaptive_stepper;
pub use trial::{Configuration, StepControl, Trial, trial};

use crate::error::Result;
use crate::integrate::Monitor;
use crate::system::{State, extent as extent_of};
use nalgebra::Vector3;

/// The relative position error `‖x − x̂‖ / ‖x̂ − c‖` of x against a reference x̂.
///
/// Both norms are Euclidean over all coordinates of all particles; c is the centroid of x̂, so that the error does not depend on where the origin
/// lies. Where all particles of x̂ are at one place the denominator is the distance from where the motion `start`ed, and 1 m where that is zero too.
///
/// # Examples
/// ```
/// use nalgebra::Vector3;
/// use sprung::accuracy::relative_position_error;
///
/// let at = |x: f64| Vector3::new(x, 0.0, 0.0);
/// let (truth, start) = ([at(-1.0), at(1.0)], [at(-1.0), at(1.0)]);
/// let error = relative_position_error(&[at(-1.0), at(1.1)], &truth, &start);
/// assert!((error - 0.1 / 2.0_f64.sqrt()).abs() < 1e-15);
/// ```
pub fn relative_position_error(x: &[Vector3<f64>], reference: &[Vector3<f64>], start: &[Vector3<f64>]) -> f64 {
    let error = distance(x, reference);
    if error == 0.0 { 0.0 } else { error / extent(reference, start) }
}

/// The denominator of [`relative_position_error`], in m.
pub fn extent(reference: &[Vector3<f64>], start: &[Vector3<f64>]) -> f64 {
    extent_of(None, reference, start)
}

/// The root of the sum of squared distances, in m.
pub(crate) fn distance(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum::<f64>().sqrt()
}

/// An observer of the runs of a search, which records each until it is known whether that is the answer.
pub trait Observer {
    /// The records of one run.
    type Records;

    /// A run begins.
    ///
    /// # Errors
    /// An error ends the search.
    fn begin(&mut self, monitor: &Monitor) -> Result<Self::Records>;

    /// The run is at a multiple of the interval asked for, or at its end.
    ///
    /// # Errors
    /// An error ends the search.
    fn record(&mut self, records: &mut Self::Records, number: u64, state: &State, monitor: &Monitor) -> Result<()>;

    /// Progress of the search.
    fn progress(&mut self, _progress: &SearchProgress<'_>) {}
}
impl Observer for () {
    type Records = ();

    fn begin(&mut self, _: &Monitor) -> Result<()> {
        Ok(())
    }

    fn record(&mut self, (): &mut (), _: u64, _: &State, _: &Monitor) -> Result<()> {
        Ok(())
    }
}

/// Progress of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchProgress<'a> {
    /// The run under way, for people.
    pub run: &'a str,
    /// The part of it that is done.
    pub part: f64,
    /// Work done in the runs before, in force evaluations.
    pub spent: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_is_relative_to_the_extent_and_blind_to_the_origin() {
        let at = |shift: f64, y: f64| [Vector3::new(shift - 3.0, 0.0, 0.0), Vector3::new(shift + 3.0, y, 0.0)];
        for shift in [0.0, 1000.0] {
            let error = relative_position_error(&at(shift, 0.3), &at(shift, 0.0), &at(shift, 0.0));
            assert!((error - 0.3 / 18f64.sqrt()).abs() < 1e-12);
        }
    }

    /// An undefined position gives an undefined error.
    #[test]
    fn one_particle_is_measured_by_its_way() {
        let error = |places: [f64; 3]| {
            let [x, reference, start] = places.map(|x| [Vector3::new(x, 0.0, 0.0)]);
            relative_position_error(&x, &reference, &start)
        };
        assert_eq!([[2.5, 2.0, -2.0], [2.5, 2.0, 2.0], [2.0, 2.0, 2.0]].map(error), [0.125, 0.5, 0.0]);
        assert!(error([f64::NAN, 0.0, 0.0]).is_nan());
    }

    /// 1 m where nothing has a length; a spread by rounding is none.
    #[test]
    fn extents_that_are_rounding_are_none() {
        let pair = |x: f64, apart: f64| [Vector3::new(x, 0.0, 0.0), Vector3::new(x + apart, 0.0, 0.0)];
        assert_eq!(extent(&[Vector3::zeros()], &[Vector3::zeros()]), 1.0);
        assert_eq!(
            extent(&pair(1024.0, 1e-10), &pair(1025.0, 0.0)),
            distance(&pair(1024.0, 1e-10), &pair(1025.0, 0.0))
        );
        assert!(extent(&pair(1024.0, 1e-8), &pair(1025.0, 0.0)) < 1e-8);
    }
}
