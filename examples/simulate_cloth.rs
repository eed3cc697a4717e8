//! Simulates a cloth that swings down from two corners and draws it, coloured by strain.
//!
//! `cargo run --release --example simulate_cloth` writes `out/cloth.svg`.

use sprung::Simulation;
use sprung::figure::Drawing;
use sprung::report::drawing;
use sprung::scene::builtin;
use std::ops::ControlFlow;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (system, start) = builtin::cloth(24)?.build()?;
    // Without a method and a step, the run chooses both, and shows 300 states.
    let mut shown = 0;
    let result = Simulation::new(&system, start).run_observed(0.5, |state, monitor| {
        shown += 1;
        if shown % 60 == 0 {
            println!("t = {:.2} s, kinetic energy {:.4} J", state.time, monitor.energy().kinetic);
        }
        ControlFlow::Continue(())
    })?;
    println!("{} after {} steps of {}", result.status.name(), result.steps, result.method.name());
    if let Some(error) = result.error {
        println!("relative position error about {error:.0e}");
    }
    result.warnings.iter().for_each(|warning| println!("{warning}"));

    std::fs::create_dir_all("out")?;
    std::fs::write("out/cloth.svg", drawing::svg(&Drawing::strains("strain", &system, &result.state)))?;
    Ok(())
}
