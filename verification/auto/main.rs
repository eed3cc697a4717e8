//! Makes `verification/auto.md`: what `--solver auto` costs beside every solver that a user could have asked for.
//!
//! ```sh
//! cargo xtask auto --largest 1000 --write      # the page; minutes
//! cargo xtask auto --kind cloth --size 1000    # one scene, solver by solver
//! cargo xtask auto --kept cells.json --write   # all sizes, hours: what is in the file already is not done again
//! cargo xtask auto --kept cells.json --again   # but once more: the shorter times of both count
//! ```
//!
//! A cell of the grid is a scene, a step and a tolerance. From the same start 30 steps are done with every solver, on one thread; a
//! step's time is the shortest of two to nine rounds, in which every solver has its turn, and the processor's for this thread, so that other programs disturb little.
//! **After its first steps** compares medians of the last 15, **as a whole** sums of all 30 with what was done before the first.
//! A run over three times as long as the shortest so far is stopped.

mod race;
mod table;

use clap::Parser;
use race::{Cell, Raced};
use sprung::scene::{Kind, builtin};
use std::error::Error;
use std::path::{Path, PathBuf};

/// Particles of the grid's scenes.
const PARTICLES: [usize; 4] = [100, 1000, 10_000, 100_000];

/// Steps, in s.
const STEPS: [f64; 4] = [1e-4, 1e-3, 1e-2, 1e-1];

/// Tolerances of conjugate gradients.
const TOLERANCES: [f64; 3] = [1e-4, 1e-7, 1e-10];

/// The kinds, and the power of the number of particles that their size is.
const KINDS: [(Kind, f64); 5] = [
    (Kind::Chain, 1.0),
    (Kind::Cloth, 1.0 / 2.0),
    (Kind::Lattice, 1.0 / 3.0),
    (Kind::Network, 1.0),
    (Kind::Column, 1.0),
];

/// Compares the solver that chooses with those it chooses from.
#[derive(Parser)]
struct Arguments {
    /// Only scenes of this kind
    #[arg(long)]
    kind: Option<String>,

    /// Only scenes of about so many particles
    #[arg(long, value_name = "PARTICLES")]
    size: Option<usize>,

    /// Scenes of up to so many
    #[arg(long, value_name = "PARTICLES", default_value_t = 100_000)]
    largest: usize,

    /// Reads the cells done before from this file, and adds those done now
    #[arg(long, value_name = "FILE")]
    kept: Option<PathBuf>,

    /// Does those cells again: the shorter times count
    #[arg(long, requires = "kept")]
    again: bool,

    /// Writes the page
    #[arg(long)]
    write: bool,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let kept = arguments.kept.as_deref();
    let mut raced: Vec<Raced> = match kept {
        Some(file) if file.exists() => serde_json::from_slice(&std::fs::read(file)?)?,
        _ => Vec::new(),
    };
    let sizes = PARTICLES.into_iter().filter(|&size| size <= arguments.largest);
    for particles in sizes.filter(|size| arguments.size.is_none_or(|wanted| wanted == *size)) {
        for (kind, power) in KINDS {
            if arguments.kind.as_deref().is_some_and(|wanted| wanted != kind.name()) {
                continue;
            }
            let (system, start) = builtin(kind, (particles as f64).powf(power).round() as usize)?.build()?;
            for dt in STEPS {
                for tolerance in TOLERANCES {
                    let cell = Cell { kind: kind.name().into(), particles, dt, tolerance };
                    let before = raced.iter().position(|one| one.cell == cell);
                    if before.is_some() && !arguments.again {
                        continue;
                    }
                    let one = pool.install(|| cell.race(&system, &start).map_err(|error| error.to_string()))?;
                    match before.and_then(|place| raced.get_mut(place)) {
                        Some(before) => before.shorter(one),
                        None => raced.push(one),
                    }
                    eprintln!("{}", raced[before.unwrap_or(raced.len() - 1)].line());
                    kept.map_or(Ok(()), |file| std::fs::write(file, serde_json::to_vec_pretty(&raced)?))?;
                }
            }
        }
    }
    raced.sort_by_key(|one| one.cell.particles);
    let page = table::page(&raced)?;
    if arguments.write {
        std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join("auto.md"), &page)?;
    }
    print!("{page}");
    Ok(())
}
