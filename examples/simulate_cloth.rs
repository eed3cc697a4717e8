//! Simulates a cloth that swings down from two corners and draws it, coloured by strain.
//!
//! `cargo run --release --example simulate_cloth` writes `out/cloth.svg`.

use sprung::figure::Drawing;
use sprung::force::Energy;
use sprung::integrate::{ImplicitOptions, LinearBackwardEuler, TimeStepper};
use sprung::report::drawing;
use sprung::scene::builtin;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (system, mut state) = builtin::cloth(24)?.build()?;
    let mut stepper = LinearBackwardEuler::new(&system, &state, &ImplicitOptions::default())?;
    for step in 0..=80 {
        if step % 20 == 0 {
            println!("t = {:.2} s, total energy {:.6} J", state.time, Energy::of(&system, &state).total());
        }
        stepper.step(&mut state, 0.01)?;
    }
    let work = stepper.statistics().work;
    println!("{} solves, {} symbolic analysis", work.solves, work.symbolic_factorizations);

    std::fs::create_dir_all("out")?;
    std::fs::write("out/cloth.svg", drawing::svg(&Drawing::strains("strain", &system, &state)))?;
    Ok(())
}
