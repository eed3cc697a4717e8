//! How damping forces change when springs turn: the derivative that Newton's method adds to A.

use super::check::{Check, worst};
use super::claim::Claim;
use super::force_error::U;
use super::reduced::random_vector;
use crate::force::{SpringGeometry, add_damping_differential};
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
    let extensions = match SpringGeometry::at(system, &state.positions) {
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
    for (_, [i, j], spring) in system.active() {
        let (d, v, moved) =
            (state.positions[i] - state.positions[j], velocities[i] - velocities[j], displacement[i] - displacement[j]);
        let dual = [0, 1, 2].map(|axis| Dual64::new(d[axis], moved[axis]));
        let f = Vector3::from(damping_force(spring, dual, &v).map(|f| f.eps));
        expected[i] += f;
        expected[j] -= f;
    }
    let units = rounding(system, state, &velocities, &displacement);
    let errors = change.iter().zip(&expected).zip(&units).map(|((change, expected), unit)| {
        let error = (change - expected).amax();
        if error == 0.0 { 0.0 } else { error / unit }
    });
    check(worst(errors.collect::<Vec<_>>()), why)
}

/// `80 u b ‖δv‖‖δx‖/l` of every damper of a particle, and u of each sum.
fn rounding(system: &System, state: &State, velocities: &[Vector3<f64>], moved: &[Vector3<f64>]) -> Vec<f64> {
    let mut sizes = vec![(0.0, 0.0); system.particles()];
    for (_, [i, j], spring) in system.active() {
        let norm = |vectors: &[Vector3<f64>]| (vectors[i] - vectors[j]).norm();
        for end in [i, j] {
            sizes[end].0 += spring.damping * norm(velocities) * norm(moved) / norm(&state.positions);
            sizes[end].1 += 2.0;
        }
    }
    sizes.into_iter().map(|(size, springs)| U * (80.0 + springs) * size).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spring::Spring;
    use crate::system::SystemBuilder;

    /// Dampers of 1/2 and 3 N·s/m, 2 and 4 m long, whose ends part at 3 and 2 m/s while they are moved apart by 4 and 1 m.
    #[test]
    fn units_of_rounding_by_hand() {
        let mut builder = SystemBuilder::new();
        for x in [0.0, 2.0, 6.0] {
            builder.particle([x, 0.0, 0.0], 1.0);
        }
        for (end, damping) in [(1, 0.5), (2, 3.0)] {
            builder.spring(end - 1, end, Spring { stiffness: 8.0, rest_length: 1.0, damping });
        }
        let (system, state) = builder.build().unwrap();
        let along = |x: [f64; 3]| x.map(|x| Vector3::new(0.0, x, 0.0));
        let units = rounding(&system, &state, &along([1.0, -2.0, 0.0]), &along([0.0, 4.0, 5.0]));
        assert_eq!(units, [U * 82.0 * 3.0, U * 84.0 * 4.5, U * 82.0 * 1.5]);
    }

    /// Both formulas are rounded, in another way: the share of what is allowed is small, and not nothing.
    #[test]
    fn a_bent_chain_differs_by_rounding() {
        let mut builder = SystemBuilder::new();
        for n in 0..6 {
            let t = f64::from(n);
            let end = builder.particle([1.1 * t, (0.9 * t).sin(), (0.7 * t).cos()], 1.0);
            if n > 0 {
                builder.spring(end - 1, end, Spring { stiffness: 8.0, rest_length: 1.0, damping: 0.3 + t });
            }
        }
        let (system, state) = builder.build().unwrap();
        let check = damping_turns(&system, &state, "chain");
        assert!(check.passed() && check.value > 1e-4, "{:e}", check.value);
    }
}
