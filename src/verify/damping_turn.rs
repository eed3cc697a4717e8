//! How damping forces change when springs turn: the derivative that Newton's method adds to A.

use super::check::{Check, worst};
use super::claim::Claim;
use super::force_error::U;
use super::reduced::random_vector;
use crate::force::{Extensions, add_damping_differential};
use crate::spring::Spring;
use crate::system::{State, System};
use nalgebra::Vector3;
use num_dual::{Dual64, DualNum};

/// `f_d = −b (d·v) d/(d·d)` on end i for `d = x_i − x_j`, `v = v_i − v_j`.
fn damping_force<D: DualNum<Primitive = f64> + Copy>(spring: &Spring, [x, y, z]: [D; 3], v: &Vector3<f64>) -> [D; 3] {
    let rate = (x * v.x + y * v.y + z * v.z) / (x * x + y * y + z * z) * -spring.damping;
    [x * rate, y * rate, z * rate]
}

/// Compares [`add_damping_differential`], `δf_d = (∂f_d/∂x) δx` at fixed velocities, with dual numbers, for random
/// velocities and displacements.
///
/// Value: the largest error of a component as a multiple of rounding. Sees every fault of a term above 1e-14 of the
/// dampers at its particle; is blind to a damping law that is wrong here and there alike.
pub fn damping_turns(system: &System, state: &State, scene: &str) -> Check {
    let why = "1 is rounding: 80 u b ‖δv‖‖δx‖/l for every damper of a particle and u of each sum, as dual numbers leave no \
        truncation";
    let check =
        |value, why: &str| Check::new(Claim::Consistency, "change of f_d by turning springs", scene, value, 1.0, why);
    let extensions = match Extensions::at(system, &state.positions) {
        Ok(extensions) => extensions,
        Err(degenerate) => return check(f64::NAN, &degenerate.to_string()),
    };
    let random = |seed| -> Vec<Vector3<f64>> {
        random_vector(3 * system.particles(), seed).chunks_exact(3).map(Vector3::from_column_slice).collect()
    };
    let (velocities, displacement) = (random(1), random(2));
    let mut change = vec![Vector3::zeros(); system.particles()];
    add_damping_differential(system, &extensions, &velocities, &displacement, &mut change);

    let mut expected = vec![Vector3::zeros(); system.particles()];
    let mut sizes = vec![(0.0, 0.0); system.particles()];
    for (_, [i, j], spring) in system.active() {
        let (d, v, moved) =
            (state.positions[i] - state.positions[j], velocities[i] - velocities[j], displacement[i] - displacement[j]);
        let dual = [0, 1, 2].map(|axis| Dual64::new(d[axis], moved[axis]));
        let f = Vector3::from(damping_force(spring, dual, &v).map(|f| f.eps));
        expected[i] += f;
        expected[j] -= f;
        for end in [i, j] {
            sizes[end].0 += spring.damping * v.norm() * moved.norm() / d.norm();
            sizes[end].1 += 2.0;
        }
    }
    let errors = change.iter().zip(&expected).zip(&sizes).map(|((change, expected), &(size, springs))| {
        let error = (change - expected).amax();
        if error == 0.0 { 0.0 } else { error / (U * (80.0 + springs) * size) }
    });
    check(worst(errors.collect::<Vec<_>>()), why)
}
