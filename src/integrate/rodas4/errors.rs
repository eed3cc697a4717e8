//! How wrong a step is, by u_6: the header of `rodas4.rs` derives it.

use crate::integrate::adaptive::norm_of_all;
use crate::integrate::linear_tolerance::mass_norm;
use crate::system::System;
use nalgebra::Vector3;

/// The method's error over z times that of the embedded formula.
const TRUE_SHARE: f64 = 0.15;

/// One over what the error of a stage is magnified by in the step: the new state takes up to thirteen times a stage.
const MAGNIFIED: f64 = 0.1;

/// `min(‖u_6x‖, 0.15 h ‖u_6v‖)`, in m.
pub(super) fn of_positions(system: &System, x: &[Vector3<f64>], v: &[Vector3<f64>], h: f64) -> f64 {
    norm_of_all(system, x).min(TRUE_SHARE * h * norm_of_all(system, v))
}

/// What the error of a step may be expected to be after one of another length: that of the embedded formula goes with the fourth power. Longer
/// steps are not trusted to follow that.
pub(super) fn of_step(h: f64, last: f64, error: f64) -> f64 {
    error * (h / last).min(1.0).powi(4)
}

/// The error that a stage may be compared with: that of the step by the same rule, in the norm of M, over what stages are magnified by,
/// in m √kg.
pub(super) fn of_stages(system: &System, x: &[Vector3<f64>], v: &[Vector3<f64>], h: f64) -> f64 {
    if x.is_empty() {
        return 0.0;
    }
    MAGNIFIED * mass_norm(system, |p| x[p]).min(TRUE_SHARE * h * mass_norm(system, |p| v[p]))
}
