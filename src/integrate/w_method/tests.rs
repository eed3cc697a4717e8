use super::WMethod;
use crate::integrate::{AdaptiveStepper, ImplicitOptions, TimeStepper};
use crate::spring::{Spring, Stiffness};
use crate::system::SystemBuilder;
use nalgebra::Vector3;

/// With the exact Jacobian the estimate is what positions and velocities lack, up to a part that falls with h.
#[test]
fn the_estimate_is_the_local_error_of_short_steps() {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, 0.0, -10.0);
    for (position, mass) in [([0.0; 3], 1.0), ([1.0, 0.1, -0.2], 0.7), ([1.3, 0.9, -0.4], 0.4)] {
        builder.particle(position, mass);
    }
    builder.hold(0);
    for (i, j) in [(0, 1), (1, 2), (0, 2)] {
        builder.spring(i, j, Spring { stiffness: 40.0, rest_length: 0.9, damping: 0.0 });
    }
    let (system, mut start) = builder.build().unwrap();
    start.velocities[1] = Vector3::new(0.3, -1.0, 2.0);
    start.velocities[2] = Vector3::new(-0.4, 0.5, 1.0);
    let options = ImplicitOptions { stiffness: Stiffness::Full.into(), ..ImplicitOptions::default() };
    let mut stepper = WMethod::new(&system, &start, &options).unwrap();
    for (h, within) in [(4e-3, 0.04), (1e-3, 0.01)] {
        let mut exact = start.clone();
        (0..256).for_each(|_| stepper.step(&mut exact, h / 256.0).unwrap());
        let estimate = stepper.try_step(&start, h).unwrap();
        let [positions, velocities] = [estimate.positions, estimate.velocities].map(<[_]>::to_vec);
        let mut end = start.clone();
        stepper.accept(&mut end);
        let missing = |end: &[Vector3<f64>], exact: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
            end.iter().zip(exact).map(|(end, exact)| exact - end).collect()
        };
        for (what, estimate, missing) in [
            ("positions", positions, missing(&end.positions, &exact.positions)),
            ("velocities", velocities, missing(&end.velocities, &exact.velocities)),
        ] {
            let norm = |v: &[Vector3<f64>]| v.iter().map(Vector3::norm_squared).sum::<f64>().sqrt();
            let rest: Vec<Vector3<f64>> = estimate.iter().zip(&missing).map(|(a, b)| a - b).collect();
            let part = norm(&rest) / norm(&missing);
            assert!(part < within, "{what}, {h} s: {part}");
        }
    }
}
