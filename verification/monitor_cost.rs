//! The cost of monitoring a run: the same steps without, with energies alone, and with a monitor, in turn in one process.
//!
//! ```sh
//! cargo xtask monitor-cost
//! ```

use sprung::integrate::{ImplicitOptions, Method, Monitor, MonitorOptions, Schedule, run, run_monitored};
use sprung::scene::{Kind, builtin};
use sprung::{State, System};
use std::ops::ControlFlow;
use std::time::Instant;

/// Rounds; the fastest of each kind counts.
const ROUNDS: usize = 7;

fn main() -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    println!("| scene | method | steps alone, ms | with energies | with monitor |\n|---|---|---|---|---|");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| {
        for (kind, size) in
            [(Kind::Pendulum, 1), (Kind::Chain, 20), (Kind::Cloth, 10), (Kind::Cloth, 32), (Kind::Lattice, 10)]
        {
            let (system, start) = builtin(kind, size)?.build()?;
            for method in [
                Method::LinearBackwardEuler,
                Method::BackwardEuler,
                Method::Bdf2,
                Method::W2,
                Method::Rodas4,
                Method::Dop853,
                Method::Verlet,
            ] {
                let times = measure(&system, &start, method)?;
                let [alone, energies, monitored] = times.map(|time| time * 1e3);
                let more = |time: f64| 100.0 * (time / alone - 1.0);
                println!(
                    "| {} {size} | {} | {alone:.2} | +{:.1} % | +{:.1} % |",
                    kind.name(),
                    method.name(),
                    more(energies),
                    more(monitored)
                );
            }
        }
        Ok(())
    })
}

/// The fastest of steps alone, with the energy balance, and with the propagated error too, in s.
fn measure(system: &System, start: &State, method: Method) -> sprung::Result<[f64; 3]> {
    let steps = (100_000 / (system.springs().len() + 10)).clamp(5, 1000) as u64;
    // For implicit methods a length that such scenes are run with, at which none of them breaks down; steps of others cost the same
    // whatever their length.
    let schedule = Schedule::steps(if method.is_implicit() { 0.002 } else { 1e-5 }, steps);
    let mut fastest = [f64::INFINITY; 3];
    for _ in 0..ROUNDS {
        for (kind, fastest) in fastest.iter_mut().enumerate() {
            let mut state = start.clone();
            let mut stepper = method.stepper(system, &state, &ImplicitOptions::default())?;
            let options = if kind == 1 { MonitorOptions::ENERGY } else { MonitorOptions::default() };
            let mut monitor = Monitor::new(system, &state, options)?;
            let begin = Instant::now();
            let go_on = ControlFlow::Continue(());
            match kind {
                0 => run(&mut *stepper, &mut state, &schedule, |_, _| go_on),
                _ => run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, |_, _, _| go_on),
            };
            *fastest = fastest.min(begin.elapsed().as_secs_f64());
        }
    }
    Ok(fastest)
}
