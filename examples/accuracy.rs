//! Makes `verification/accuracy.md`: what `--accuracy` chooses on ten scenes, what error it achieves, and what the cheapest run of a
//! full sweep would have cost.
//!
//! `cargo run --release --example accuracy -- 10` gives every sweep 10 s.

use sprung::accuracy::{Requirement, choose, reduce, relative_position_error, trial};
use sprung::chart::{SweepOptions, WorkPrecision};
use sprung::scene::{Kind, Scene, builtin};
use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let budget: f64 = std::env::args().nth(1).map_or(Ok(10.0), |text| text.parse())?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("verification");
    let load = |name: &str| Scene::load(root.join("scenes").join(name).with_extension("toml"));
    let mut chain = builtin(Kind::Chain, 10)?;
    chain.time.duration = Some(0.5);
    chain.time.dt = Some(0.005);
    let scenes = [
        load("two_springs")?,
        load("tetrahedron")?,
        load("stiff_pendulum")?,
        load("taut_string")?,
        load("compressed_chain")?,
        load("moving_anchor")?,
        load("one_dimensional")?,
        load("planar_truss")?,
        load("buckled_column")?,
        chain,
    ];
    let mut rows = String::new();
    let mut summary = String::new();
    for accuracy in [1e-2, 1e-4] {
        let (mut kept, mut near, mut all) = (0, 0, 0);
        for scene in &scenes {
            let (system, start) = scene.build()?;
            let (dt, duration) = scene.time.dt.zip(scene.time.duration).ok_or("a scene without time")?;
            eprintln!("{} {accuracy:e}", scene.name);
            let par = faer::Par::Seq;
            let options = SweepOptions { duration, dt, budget: Duration::from_secs_f64(budget), par };
            let sweep = WorkPrecision::measure(&scene.name, &system, &start, &options, &mut |_, _: &str| {})?
                .ok_or("no reference within the budget")?;
            let reduced = reduce(&system, &start).system;
            let requirement = Requirement { accuracy, duration, par, method: None, stiffness: None, solver: None };
            let choice = choose(&reduced, &start, &requirement, &|| true)?.ok_or("nothing converges")?;
            let run = trial(&reduced, &start, &choice.configuration, choice.pace, duration, &|| true)?;
            let error =
                relative_position_error(&run.state.positions, &sweep.reference.state.positions, &start.positions);
            let cheapest = sweep.decision(accuracy).cheapest;
            let ratio = cheapest.map_or(f64::NAN, |best| choice.cost / best.cost);
            all += 1;
            kept += u32::from(error <= accuracy);
            near += u32::from(ratio <= 2.0);
            let method = format!("{} {}", choice.configuration.method.name(), choice.configuration.stiffness());
            let best =
                cheapest.map_or("none".into(), |best| format!("{} {}, {:.0}", best.method, best.stiffness, best.cost));
            writeln!(
                rows,
                "| {accuracy:e} | {} | {} | {:.1e} | {error:.1e} | {:.0} | {best} | {ratio:.2} | {:.0} | {:.0} |",
                scene.name,
                method.trim_end_matches(" none").trim_end_matches(" on-demand"),
                choice.estimated_error,
                choice.cost,
                choice.pilot_cost,
                choice.pilot_cost / choice.cost,
            )?;
        }
        writeln!(
            summary,
            "- `--accuracy {accuracy:e}`: the error achieved is below it on {kept} of {all} scenes; the run costs at most twice the cheapest one \
             of the sweep on {near} of {all}."
        )?;
    }
    let page = format!(
        "# What `--accuracy` chooses\n\n\
         Made by `cargo run --release --example accuracy`, which writes this page. Errors are relative position errors at the end of the\n\
         scene's motion; the achieved one is measured against an independent reference (DOP853 to 10⁻¹²) that the choice knows nothing\n\
         of. Work is counted in force evaluations of the scene. The cheapest run is that of a sweep over all methods, options and solvers\n\
         with steps halved from run to run. Pilot work is what finding the choice costs, once.\n\n{summary}\n\
         | accuracy | scene | choice | estimated | achieved | work | cheapest run of the sweep, its work | ratio | pilot work | pilot work / work |\n\
         |---|---|---|---|---|---|---|---|---|---|\n{rows}"
    );
    std::fs::write(root.join("accuracy.md"), page)?;
    Ok(())
}
