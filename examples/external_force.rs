//! Hands a force from outside to the methods: here wind in gusts, against which a cloth's threads have a drag.

use sprung::integrate::{ImplicitOptions, Method, Monitor, MonitorOptions, Schedule, Status, run_monitored};
use sprung::nalgebra::Vector3;
use sprung::scene::builtin;
use sprung::system::{ExternalForce, StateView};
use std::ops::ControlFlow;

#[derive(Debug)]
struct Wind {
    /// Velocity of the air, in m/s.
    speed: f64,
    /// Drag coefficient of a particle, in N·s/m.
    drag: f64,
}

impl ExternalForce for Wind {
    fn add(&self, at: &StateView<'_>, force: &mut [Vector3<f64>]) {
        let air = Vector3::z() * (self.speed * (1.0 + (5.0 * at.time).sin()));
        for (f, v) in force.iter_mut().zip(at.velocities) {
            *f += (air - v) * self.drag;
        }
    }
}

pub(crate) fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (system, start) = builtin::cloth(8)?.build()?;
    let system = system.with_external_force(Wind { speed: 3.0, drag: 0.002 });
    let mut ends = Vec::new();
    for (method, dt) in [(Method::Verlet, 1e-4), (Method::Bdf2, 1e-3), (Method::W2, 1e-3)] {
        let mut state = start.clone();
        let mut stepper = method.stepper(&system, &state, &ImplicitOptions::default())?;
        let mut monitor = Monitor::new(&system, &state, MonitorOptions::default())?;
        let schedule = Schedule::duration(dt, 0.3);
        let outcome =
            run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, |_, _, _| ControlFlow::Continue(()));
        if outcome.status() != Status::Completed {
            return Err(outcome.status().name().into());
        }
        let blown = state.positions.iter().map(|x| x.z).sum::<f64>() / system.particles() as f64;
        println!("{}: blown by {blown:.4} m, the wind's work is {:.3e} J", method.name(), monitor.balance().work);
        ends.push(blown);
    }
    assert!(ends.iter().all(|end| (end / ends[0] - 1.0).abs() < 0.01), "{ends:?}");
    Ok(())
}
