//! Scenes and runs for tests.

use super::{ImplicitOptions, Method, Monitor, MonitorOptions, Outcome, Schedule, TimeStepper, run_monitored};
use crate::spring::Spring;
use crate::system::{Actuation, Behaviour, Curve, State, System, SystemBuilder};
use std::ops::ControlFlow;

/// Particles with their masses, and springs between them with stiffness, rest length and damping.
pub fn scene(particles: &[([f64; 3], f64)], springs: &[(usize, usize, [f64; 3])]) -> SystemBuilder {
    let mut builder = SystemBuilder::new();
    for &(position, mass) in particles {
        builder.particle(position, mass);
    }
    for &(i, j, [stiffness, rest_length, damping]) in springs {
        builder.spring(i, j, Spring { stiffness, rest_length, damping });
    }
    builder
}

/// Free particles of 1 kg at these places on the first axis.
pub fn particles(places: &[f64]) -> (System, State) {
    let particles: Vec<_> = places.iter().map(|&x| ([x, 0.0, 0.0], 1.0)).collect();
    scene(&particles, &[]).build().unwrap()
}

/// Particles of 2 kg, 1 m apart in one dimension, on like springs behind one that is held; the rest length of the first spring changes to `factor` of
/// it between two times.
pub fn actuated(particles: usize, spring: [f64; 3], times: [f64; 2], factor: f64) -> (System, State) {
    let places: Vec<_> = (0..particles).map(|p| ([p as f64, 0.0, 0.0], 2.0)).collect();
    let springs: Vec<_> = (1..particles).map(|p| (p - 1, p, spring)).collect();
    let mut builder = SystemBuilder { dimension: 1, ..scene(&places, &springs) };
    let (system, start) = builder.hold(0).clone().build().unwrap();
    let factors = Curve { times: times.to_vec(), values: vec![1.0, factor] };
    let actuation = vec![Actuation { springs: vec![0], factors }];
    (system.with_behaviour(Behaviour { actuation, ..Behaviour::default() }).unwrap(), start)
}

/// A stepper with the default options.
pub fn stepper<'s>(method: Method, system: &'s System, state: &State) -> Box<dyn TimeStepper + Send + 's> {
    method.stepper(system, state, &ImplicitOptions::default()).unwrap()
}

/// The end of a run, with its monitor.
pub fn monitored<'s>(
    (system, start): &'s (System, State),
    stepper: &mut dyn TimeStepper,
    options: MonitorOptions,
    schedule: Schedule,
) -> (Outcome, State, Monitor<'s>) {
    let mut state = start.clone();
    let mut monitor = Monitor::new(system, &state, options).unwrap();
    let go_on = |_, _: &State, _: &Monitor| ControlFlow::Continue(());
    let outcome = run_monitored(stepper, &mut state, &schedule, &mut monitor, go_on);
    (outcome, state, monitor)
}
