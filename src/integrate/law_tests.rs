//! A law that is asked for all springs at once moves a system, and is accounted for, as it does when asked one by one: to the bit.

use super::{ImplicitOptions, Method, Monitor, MonitorOptions};
use crate::force::{Energy, Reactions};
use crate::spring::{LawValue, Spring, SpringLaw, Tension};
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
use nalgebra::Vector3;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Springs that stiffen with the cube of their strain, each in its own way.
#[derive(Debug)]
struct Cubic;

impl SpringLaw for Cubic {
    fn tension(&self, number: usize, spring: &Spring, length: f64) -> Tension {
        let (k, strain, c) = (spring.stiffness, length / spring.rest_length - 1.0, 1.0 + number as f64);
        let slope = k * (1.0 + 3.0 * c * strain * strain) / spring.rest_length;
        Tension { force: k * (strain + c * strain.powi(3)), slope }
    }

    fn energy(&self, number: usize, spring: &Spring, length: f64) -> f64 {
        let (strain, c) = (length / spring.rest_length - 1.0, 1.0 + number as f64);
        spring.stiffness * spring.rest_length * (strain.powi(2) / 2.0 + c * strain.powi(4) / 4.0)
    }
}

/// The same, which is not to be asked for a single spring.
#[derive(Debug)]
struct AtOnce(Arc<AtomicUsize>);

impl SpringLaw for AtOnce {
    fn tension(&self, number: usize, _: &Spring, _: f64) -> Tension {
        unreachable!("spring {number} was asked for alone")
    }

    fn energy(&self, number: usize, _: &Spring, _: f64) -> f64 {
        unreachable!("spring {number} was asked for alone")
    }

    fn is_asked_at_once(&self) -> bool {
        true
    }

    fn values(&self, springs: &[Spring], lengths: &[f64]) -> Vec<LawValue> {
        self.0.fetch_add(1, Ordering::Relaxed);
        Cubic.values(springs, lengths)
    }
}

/// A chain with one end held and the other led on a path with a kink, damped; the last spring is between held particles.
fn chain() -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -9.81, 0.0);
    for p in 0..8 {
        let p = p as f64;
        builder.particle([p, 0.1 * p * p, 0.3 * (p % 3.0)], 1.0 + 0.2 * p);
    }
    for p in 0..7 {
        let rest_length = 0.9 + 0.05 * p as f64;
        builder.spring(p, p + 1, Spring { stiffness: 150.0 + p as f64, rest_length, damping: 0.2 * (p % 2) as f64 });
    }
    builder.hold(0);
    let offsets = [0.0, 0.02, 0.01].map(Vector3::repeat).into();
    let motion = Motion::Path { times: vec![0.0, 0.013, 0.03], offsets };
    builder.constrain(Constraint { particles: vec![6, 7], axes: Axes::first(3), motion });
    builder.build().unwrap()
}

#[test]
fn laws_that_are_asked_at_once_are_the_same_laws() {
    let calls = Arc::new(AtomicUsize::new(0));
    let (plain, start) = chain();
    let systems = [plain.clone().with_spring_law(Cubic), plain.with_spring_law(AtOnce(calls.clone()))];
    let moment = start.moment();
    let [one, all] = systems.each_ref().map(|system| {
        let reactions = Reactions::at(system, &start).unwrap().forces;
        (Energy::of(system, &start), reactions, system.springs_at(&moment))
    });
    assert_eq!(one, all);
    assert_eq!(calls.swap(0, Ordering::Relaxed), 3);
    for method in Method::ALL {
        let [one, all] = systems.each_ref().map(|system| {
            let mut state = start.clone();
            let mut stepper = method.stepper(system, &state, &ImplicitOptions::default()).unwrap();
            let mut monitor = Monitor::new(system, &state, MonitorOptions::default()).unwrap();
            for step in 1..=10 {
                stepper.step(&mut state, 2e-3).unwrap();
                monitor.enter(step, &state, 2e-3).unwrap();
            }
            let balance = monitor.balance();
            (state, monitor.energy(), [balance.work, balance.dissipated], stepper.statistics().work)
        });
        assert_eq!(one, all, "{method:?}");
        let evaluations = all.3.force_evaluations as usize;
        // For forces and their derivatives at each configuration, and for what is stored and driven where a step ends.
        let asked = calls.swap(0, Ordering::Relaxed);
        assert!(asked <= 2 * evaluations + 3 * 10 + 5, "{method:?}: {asked} times in {evaluations} evaluations");
    }
}
