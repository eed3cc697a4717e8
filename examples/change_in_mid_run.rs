//! Changes a system while it moves: a pin is released, a spring torn, a stiffness raised, and the motion goes on from where it was.
//!
//! A `System` never changes. Each change makes another one, with the same loads, spring law and forces from outside; the state, its time
//! included, is that of the run so far, and a new stepper goes on from it.

use sprung::force::linear_momentum;
use sprung::integrate::{ImplicitOptions, Method, Schedule, run};
use sprung::system::{Dof, Loads};
use sprung::{Spring, State, System, SystemBuilder};
use std::ops::ControlFlow;

/// Half a second of motion.
fn swing(system: &System, state: &mut State) -> Result<(), Box<dyn std::error::Error>> {
    let mut stepper = Method::Bdf2.stepper(system, state, &ImplicitOptions::default())?;
    let outcome = run(&mut *stepper, state, &Schedule::duration(0.005, 0.5), |_, _| ControlFlow::Continue(()));
    match outcome.end {
        Ok(_) => Ok(()),
        Err(failed) => Err(failed.failure.into()),
    }
}

pub(crate) fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A chain of five particles, held at both ends, in air.
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -9.81, 0.0);
    for p in 0..5 {
        builder.particle([f64::from(p), 0.0, 0.0], 1.0);
    }
    for p in 0..4 {
        builder.spring(p, p + 1, Spring { stiffness: 200.0, rest_length: 1.0, damping: 0.5 });
    }
    builder.hold(0).hold(4);
    let (system, mut state) = builder.build()?;
    let system = system.with_loads(Loads { drag: vec![0.1; 5], ..Loads::default() })?;
    swing(&system, &mut state)?;

    // ANCHOR: change
    // Release the pin at the right end: three coordinates that were prescribed are free.
    let released = system.with_released(&[0, 1, 2].map(|axis| Dof { particle: 4, axis }));
    swing(&released, &mut state)?;

    // Make the first spring ten times as stiff.
    let mut springs = released.springs().to_vec();
    springs[0].stiffness *= 10.0;
    let stiffer = released.with_springs(springs)?;
    swing(&stiffer, &mut state)?;

    // Tear the spring between particles 1 and 2: the part below falls.
    let torn = stiffer.without_springs(&[1]);
    swing(&torn, &mut state)?;

    // Catch particle 3 where it is now.
    let caught = torn.with_held(&[0, 1, 2].map(|axis| Dof { particle: 3, axis }), &state.positions);
    state.prescribe(&caught);
    // ANCHOR_END: change
    let place = state.positions[3];
    swing(&caught, &mut state)?;

    println!("t = {} s, particle 3 held at y = {:.2} m", state.time, place.y);
    assert_eq!((state.time, state.positions[3], state.positions[0].y), (2.5, place, 0.0));
    assert_eq!((caught.springs().len(), caught.springs()[0].stiffness, caught.loads().drag.len()), (3, 2000.0, 5));
    // Released and torn off, the particle fell freely but for the drag until it was caught.
    assert!(place.y < -2.0 && linear_momentum(&caught, &state).norm() > 0.0);
    Ok(())
}
