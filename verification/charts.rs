//! Makes the charts of `verification/charts`: four scenes that tell a story and a cloth, and the stability map.
//!
//! `cargo xtask charts 30` gives every scene 30 s.

use sprung::chart::{StabilityMap, SweepOptions, WorkPrecision};
use sprung::interrupt::Interrupt;
use sprung::report::{plot, tiles};
use sprung::scene::{Kind, Scene, builtin};
use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::time::Duration;

/// Pictures that are kept of every scene.
const KEPT: [&str; 4] = ["work", "error", "options-euler", "options-w2"];

/// Tiles that are kept of the stability map.
const TILES: [&str; 9] = [
    "stability-linear-backward-euler-full-stretch",
    "stability-linear-backward-euler-tension-stretch",
    "stability-linear-backward-euler-axial-stretch",
    "stability-w2-axial-stretch",
    "stability-symplectic-euler-none-stretch",
    "stability-symplectic-euler-none-damping",
    "stability-linear-backward-euler-full-turning",
    "stability-linear-backward-euler-axial-turning",
    "stability-backward-euler-on-demand-turning",
];

/// The end of the page: pictures that another program makes.
const PEERS: &str = "\n## Other programs\n\nThis crate's methods beside integrators of other libraries, by time; `benches/peers` makes these and says what they show.\n\n\
    ![This crate and its peers: stiff pendulum](peers-stiff-pendulum.svg)\n\
    ![This crate and its peers: moving anchor](peers-moving-anchor.svg)\n\
    ![This crate and its peers: tetrahedron](peers-tetrahedron.svg)\n\
    ![This crate and its peers: taut string](peers-taut-string.svg)\n\
    ![This crate and its peers: column](peers-column.svg)\n\
    ![This crate and its peers: chain](peers-chain.svg)\n\
    ![This crate and its peers: cloth](peers-cloth.svg)\n\
    ![This crate and its peers: network](peers-network.svg)\n\
    ![This crate and its peers: lattice](peers-lattice.svg)\n\
    ![This crate and its peers: bunny](peers-bunny.svg)\n";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let budget: f64 = std::env::args().nth(1).map_or(Ok(30.0), |text| text.parse())?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = root.join("charts");
    fs::create_dir_all(&folder)?;
    let load = |name: &str| Scene::load(root.join("../src/verify/scenes").join(name).with_extension("toml"));
    let mut cloth = builtin(Kind::Cloth, 8)?;
    // Later its folds decide, and they depend on everything.
    cloth.time.duration = Some(0.2);
    cloth.time.dt = Some(0.01);
    let stories = [
        (
            load("stiff_pendulum")?,
            "The rod vibrates a hundred times faster than the pendulum swings. With long steps `axial` is far more accurate than `full` and `tension`, which damp the swing.",
        ),
        (
            load("taut_string")?,
            "All springs are stretched. Under `axial` the run breaks beyond ω dt = 2 of the motion across, although every matrix is positive definite.",
        ),
        (
            load("compressed_chain")?,
            "All springs are compressed. Beyond its critical step `full` is refused: the matrix is not positive definite.",
        ),
        (load("tetrahedron")?, "Soft and damped: errors fall along straight lines, and second order wins early."),
        (cloth, "A stiff cloth that starts to swing down, 8 × 8 particles for 0.2 s."),
    ];
    let mut page = String::from(
        "# Charts\n\nMade by `cargo xtask charts`, which writes this page too. Errors are relative position errors at the\n\
         end, against an independent reference; work is counted in force evaluations of the scene. `sprung chart SCENE` gives the\n\
         whole chart of any scene, with times.\n",
    );
    for (scene, story) in stories {
        let (system, start) = scene.build()?;
        let (dt, duration) = scene.time.dt.zip(scene.time.duration).ok_or("a scene without time")?;
        let options = SweepOptions {
            duration,
            dt,
            budget: Duration::from_secs_f64(budget),
            par: faer::Par::Seq,
            interrupt: Interrupt::NEVER,
        };
        eprintln!("{}", scene.name);
        let chart = WorkPrecision::measure(&scene.name, &system, &start, &options, &mut |_, _: &str| {})?
            .ok_or("no reference within the budget")?;
        writeln!(page, "\n## {}\n\n{story}\n", scene.name)?;
        writeln!(page, "Reference: {}, error about {:.0e}.\n", chart.reference.method, chart.reference.error_estimate)?;
        for sentence in chart.conclusions() {
            // Times belong to the machine that made them.
            let timeless = sentence.split(" ms)").next().filter(|_| sentence.contains(" ms)")).and_then(|head| {
                let (kept, _) = head.rsplit_once(", ")?;
                Some(format!("{kept}){}", sentence.split(" ms)").nth(1)?))
            });
            writeln!(page, "- {}", timeless.unwrap_or(sentence.clone()))?;
        }
        writeln!(page)?;
        let name = scene.name.replace(' ', "-");
        for figure in chart.figures().iter().filter(|figure| KEPT.contains(&figure.name)) {
            let file = format!("{name}-{}.svg", figure.name);
            fs::write(folder.join(&file), plot::svg(&figure.plot))?;
            writeln!(page, "![{}]({file})", figure.plot.title)?;
            let Some(full) = &figure.full else { continue };
            let all = format!("{name}-{}-all.svg", figure.name);
            fs::write(folder.join(&all), plot::svg(full))?;
            writeln!(page, "<details><summary>All curves</summary>\n\n![{}]({all})\n\n</details>\n", full.title)?;
        }
    }
    eprintln!("stability");
    let map = StabilityMap::measure(36, &mut |_, _: &str| {})?;
    let (predicted, contradictions) = map.agreement();
    writeln!(
        page,
        "\n## Stability\n\nOne particle between two springs, up to 2000 steps in every cell, coloured by what failed first; lines are limits in\n\
         closed form. Of {predicted} cells about which theory says something, {contradictions} contradict it.\n"
    )?;
    for tile in map.tiles.iter().filter(|tile| TILES.contains(&tile.file_name().as_str())) {
        let figure = tile.figure();
        let file = format!("{}.svg", tile.file_name());
        fs::write(folder.join(&file), tiles::svg(&figure))?;
        writeln!(page, "![{}]({file})", figure.title)?;
    }
    page += PEERS;
    fs::write(folder.join("README.md"), page)?;
    Ok(())
}
