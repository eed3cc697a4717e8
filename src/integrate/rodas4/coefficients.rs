//! The coefficients of RODAS4 in Hairer and Wanner's transformed form, as in rodas.f (METH = 1), and the sums that they stand in.

use nalgebra::Vector3;

/// Number of stages.
pub(super) const STAGES: usize = 6;

/// A list of stages' coefficients.
pub(super) type Row = [f64; STAGES];

/// γ.
pub(super) const GAMMA: f64 = 0.25;

/// What the point of each stage takes of the stages before.
#[rustfmt::skip]
pub(super) const A: [Row; STAGES] = [
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [1.544, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.9466785280815826, 0.2557011698983284, 0.0, 0.0, 0.0, 0.0],
    [3.314825187068521, 2.896124015972201, 0.9986419139977817, 0.0, 0.0, 0.0],
    [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 0.0, 0.0],
    [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 1.0, 0.0],
];

/// What its right-hand side takes of them, over h.
#[rustfmt::skip]
pub(super) const C: [Row; STAGES] = [
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-5.6688, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-2.430093356833875, -0.2063599157091915, 0.0, 0.0, 0.0, 0.0],
    [-0.1073529058151375, -9.594562251023355, -20.47028614809616, 0.0, 0.0, 0.0],
    [7.496443313967647, -10.24680431464352, -33.99990352819905, 11.7089089320616, 0.0, 0.0],
    [8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054, 0.0],
];

/// When the point of each stage is, and what its right-hand side takes of the forces' rate of change: both parts of h.
pub(super) const TIMES: Row = [0.0, 0.386, 0.21, 0.63, 1.0, 1.0];
pub(super) const RATES: Row = [0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0];

/// The new state: the point of the last stage and the last stage.
pub(super) const B: Row = [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 1.0, 1.0];

/// Adds `factor Σ row_j u_j`.
pub(super) fn add_multiples(row: &Row, factor: f64, stages: &[Vec<Vector3<f64>>], to: &mut [Vector3<f64>]) {
    for (stage, &coefficient) in stages.iter().zip(row).filter(|(_, coefficient)| **coefficient != 0.0) {
        let coefficient = coefficient * factor;
        for (to, u) in to.iter_mut().zip(stage) {
            *to += u * coefficient;
        }
    }
}
