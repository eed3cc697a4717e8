//! Gives springs a law of your own: here rubber that stiffens with the cube of its strain.
//!
//! A law says which tension a length has, how fast it rises, and what it stores; every method, solver and stiffness option then works
//! with it. Whether the matrix is the derivative of the force is checked first, as one should.

use sprung::force::{Energy, SpringGeometry, add_elastic_force};
use sprung::integrate::{ImplicitOptions, Method, StepMatrices};
use sprung::nalgebra::Vector3;
use sprung::spring::{SpringLaw, Tension};
use sprung::verify::{JacobianOptions, check_jacobian};
use sprung::{Spring, Stiffness, SystemBuilder};

/// `T = k (ε + ε³)` with the strain `ε = l/l0 − 1`.
#[derive(Debug)]
struct Rubber;

impl SpringLaw for Rubber {
    fn tension(&self, _: usize, spring: &Spring, length: f64) -> Tension {
        let strain = length / spring.rest_length - 1.0;
        Tension {
            force: spring.stiffness * (strain + strain.powi(3)),
            slope: spring.stiffness * (1.0 + 3.0 * strain * strain) / spring.rest_length,
        }
    }

    fn energy(&self, _: usize, spring: &Spring, length: f64) -> f64 {
        let strain = length / spring.rest_length - 1.0;
        spring.stiffness * spring.rest_length * (strain.powi(2) / 2.0 + strain.powi(4) / 4.0)
    }
}

pub(crate) fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut builder = SystemBuilder::new();
    for p in 0..5 {
        builder.particle([1.5 * f64::from(p), 0.2 * f64::from(p * p), 0.0], 1.0);
        if p > 0 {
            builder.spring(p as usize - 1, p as usize, Spring { stiffness: 20.0, rest_length: 1.0, damping: 0.0 });
        }
    }
    builder.hold(0);
    let (system, start) = builder.build()?;
    let system = system.with_spring_law(Rubber);

    // The derivative of the force against the matrix.
    let dofs = system.dofs();
    let force = |x: &[f64], f: &mut [f64]| {
        let mut positions = start.positions.clone();
        dofs.scatter(x, &mut positions);
        let mut full = vec![Vector3::zeros(); system.particles()];
        match SpringGeometry::at(&system, &positions) {
            Ok(extensions) => add_elastic_force(&system, &extensions, &mut full),
            Err(_) => full.fill(Vector3::repeat(f64::NAN)),
        }
        dofs.gather(&full, f);
    };
    let mut x = vec![0.0; dofs.len()];
    dofs.gather(&start.positions, &mut x);
    let k = StepMatrices::assemble(&system, &start, Stiffness::Full, 0.01)?.k;
    let report = check_jacobian(force, &k, &x, &JacobianOptions::default())?;
    println!("{report}");
    assert!(report.passed());

    // Energy is kept, to the square of the step.
    let energy = Energy::of(&system, &start).total();
    for method in [Method::ImplicitMidpoint, Method::Bdf2, Method::Verlet] {
        let mut stepper = method.stepper(&system, &start, &ImplicitOptions::default())?;
        let mut state = start.clone();
        for _ in 0..500 {
            stepper.step(&mut state, 0.001)?;
        }
        let change = Energy::of(&system, &state).total() / energy - 1.0;
        println!("{}: energy changed by {change:.1e} of {energy:.1} J", method.name());
        assert!(change.abs() < 1e-3);
    }
    Ok(())
}
