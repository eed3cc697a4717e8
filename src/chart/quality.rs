//! What is measured at the end of a run beside its work.

use crate::accuracy::relative_position_error;
use crate::force::{Energy, angular_momentum, linear_momentum};
use crate::system::{State, System};
use serde::Serialize;

/// Errors of a final state against the reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quality {
    /// The [relative position error](relative_position_error).
    pub error: f64,
    /// `(E − Ê)/s`: total energy above that of the reference, over the energy s that the motion exchanges.
    pub energy_drift: f64,
    /// `‖Σ m v − Σ m v̂‖ / Σ m ‖v̂‖`.
    pub linear_momentum_drift: f64,
    /// `‖Σ m x × v − Σ m x̂ × v̂‖ / Σ m ‖x̂ − c‖ ‖v̂‖`, both about the centroid c of the reference.
    pub angular_momentum_drift: f64,
}

impl Quality {
    /// Of a state against the reference at the same time. s is the kinetic and elastic energy of the reference at its end and at
    /// the start, and the gravitational energy between.
    pub fn of(system: &System, state: &State, reference: &State, start: &State) -> Self {
        let [energy, ideal, initial] = [state, reference, start].map(|state| Energy::of(system, state));
        let exchanged = [ideal, initial].map(|e| e.kinetic + e.elastic).iter().sum::<f64>()
            + (ideal.gravitational - initial.gravitational).abs();
        let count = reference.positions.len().max(1) as f64;
        let centroid = reference.positions.iter().sum::<nalgebra::Vector3<f64>>() / count;
        let about = |state: &State| {
            let positions = state.positions.iter().map(|x| x - centroid).collect();
            angular_momentum(system, &State { positions, ..state.clone() })
        };
        let moving = || system.masses().iter().zip(&reference.velocities).map(|(m, v)| m * v.norm());
        let turning: f64 = moving().zip(&reference.positions).map(|(p, x)| p * (x - centroid).norm()).sum();
        let linear = (linear_momentum(system, state) - linear_momentum(system, reference)).norm();
        let angular = (about(state) - about(reference)).norm();
        Self {
            error: relative_position_error(&state.positions, &reference.positions, &start.positions),
            energy_drift: relative(energy.total() - ideal.total(), exchanged),
            linear_momentum_drift: relative(linear, moving().sum()),
            angular_momentum_drift: relative(angular, turning),
        }
    }
}

fn relative(difference: f64, scale: f64) -> f64 {
    if difference == 0.0 { 0.0 } else { difference / scale }
}
