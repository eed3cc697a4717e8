//! Simulates a cloth that swings down from two corners and draws it, coloured by strain.
//!
//! `cargo run --release --example simulate_cloth` writes `out/cloth.svg`.

use sprung::figure::Drawing;
use sprung::report::drawing;
use sprung::scene::builtin;
use sprung::{Method, Simulation};
use std::ops::ControlFlow;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (system, start) = builtin::cloth(24)?.build()?;
    let simulation = Simulation::new(&system, start).method(Method::LinearBackwardEuler).dt(0.01);
    let mut steps = 0;
    let result = simulation.run_observed(0.8, |state, monitor| {
        steps += 1;
        if steps % 20 == 0 {
            println!("t = {:.2} s, total energy {:.6} J", state.time, monitor.energy().total());
        }
        ControlFlow::Continue(())
    })?;
    let work = result.statistics.work;
    println!("{}: {} solves, {} symbolic analysis", result.status.name(), work.solves, work.symbolic_factorizations);
    result.warnings.iter().for_each(|warning| println!("{warning}"));

    std::fs::create_dir_all("out")?;
    std::fs::write("out/cloth.svg", drawing::svg(&Drawing::strains("strain", &system, &result.state)))?;
    Ok(())
}
