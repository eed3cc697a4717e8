//! Makes `verification/manufactured.md`: every method towards prescribed motions.
//!
//! ```sh
//! cargo xtask manufactured --write
//! ```

#[path = "mod.rs"]
mod manufactured;

use manufactured::{Approach, Variant, scenes};
use std::fmt::Write;
use std::path::Path;

/// Halvings of the step.
const HALVINGS: u32 = 8;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut page = String::from(
        "# Manufactured motions\n\nMade by `cargo xtask manufactured --write`.\n\n\
         A motion that turns and stretches is prescribed for every particle of a scene. The external force that makes it the exact solution,\n\
         `M ẍ + c ẋ − f − M g(t) − Σ T n` along it, is written from tensions and their rates, without the library's forces, and added from\n\
         outside as a function of time. Every method must then approach the motion. Steps are halved up to eight times, or until errors are\n\
         1e-11 of the motion. *Observed* orders are those between the two shortest steps, *at zero* the order of the worst coordinate\n\
         extrapolated to steps of zero, *limit* the distance of the extrapolated positions and velocities from the prescribed ones, over the\n\
         size of the motion. Stiffness options that depend on the sign of a spring's strain have no expansion in powers of the step: of them\n\
         orders are measured only.\n",
    );
    for scene in scenes::all() {
        write!(page, "\n## {}\n\n{}.\n\n", scene.name, scene.holds)?;
        page.push_str(
            "| method | order | observed, positions | velocities | at zero | steps | error, of the motion | limit, positions | velocities |\n\
             |---|---|---|---|---|---|---|---|---|\n",
        );
        for variant in Variant::all() {
            let halvings = if variant.is_smooth() { HALVINGS } else { HALVINGS - 2 };
            let found = Approach::of(&scene, variant, halvings)?;
            let [x, v] = found.observed();
            let (step, errors) = found.errors[found.errors.len() - 1];
            let [at_zero, places, velocities] = match variant.is_smooth() {
                true => [
                    format!("{:.6}", found.order),
                    format!("{:.1e}", found.limit[0]),
                    format!("{:.1e}", found.limit[1]),
                ],
                false => ["–"; 3].map(String::from),
            };
            let row = format!(
                "| {} | {} | {x:.3} | {v:.3} | {at_zero} | {:.0} | {:.1e} | {places} | {velocities} |\n",
                variant.name(),
                variant.method.order(),
                scene.duration / step,
                errors[0] / found.size[0],
            );
            page.push_str(&row);
        }
    }
    println!("{page}");
    if std::env::args().any(|argument| argument == "--write") {
        std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join("manufactured.md"), page)?;
    }
    Ok(())
}
