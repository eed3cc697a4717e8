//! Makes `verification/manufactured.md`: every method towards prescribed motions.
//!
//! ```sh
//! cargo xtask manufactured --write
//! ```

#[path = "mod.rs"]
mod manufactured;

use manufactured::{Approach, Variant, scenes};
use sprung::integrate::Method;
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
    let (mut sections, mut all) = (String::new(), Vec::new());
    for scene in scenes::all() {
        write!(sections, "\n## {}\n\n{}.\n\n", scene.name, scene.holds)?;
        sections.push_str(
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
                    // None where the error changes its sign on the way.
                    if found.order.is_nan() { "–".into() } else { format!("{:.6}", found.order) },
                    format!("{:.1e}", found.limit[0]),
                    format!("{:.1e}", found.limit[1]),
                ],
                false => ["–"; 3].map(String::from),
            };
            writeln!(
                sections,
                "| {} | {} | {x:.3} | {v:.3} | {at_zero} | {:.0} | {:.1e} | {places} | {velocities} |",
                variant.name(),
                variant.method.order(),
                scene.duration / step,
                errors[0] / found.size[0],
            )?;
            all.push((variant, found));
        }
    }
    page.push_str("\n| method | order | observed on all scenes | worst limit |\n|---|---|---|---|\n");
    for method in Method::ALL {
        let of = || all.iter().filter(|(variant, _)| variant.method == method);
        let orders = || of().flat_map(|(_, found)| found.observed());
        let (least, most) = (orders().fold(f64::INFINITY, f64::min), orders().fold(0.0, f64::max));
        let limits = of().filter(|(variant, _)| variant.is_smooth()).flat_map(|(_, found)| found.limit);
        let worst = limits.fold(0.0, f64::max);
        writeln!(page, "| {} | {} | {least:.3} to {most:.3} | {worst:.1e} |", method.name(), method.order())?;
    }
    page.push_str(&sections);
    println!("{page}");
    if std::env::args().any(|argument| argument == "--write") {
        std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join("manufactured.md"), page)?;
    }
    Ok(())
}
