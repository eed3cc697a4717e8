//! The page.

use crate::race::Raced;
use std::fmt::Write;

/// The promise: after the first steps within the first in 95 of 100 cells and never above the second, as a whole within the third.
const NEAR: f64 = 1.15;
const FAR: f64 = 2.0;
const WHOLE: f64 = 1.3;

fn share(ratios: &[f64], most: f64) -> f64 {
    100.0 * ratios.iter().filter(|ratio| **ratio <= most).count() as f64 / ratios.len().max(1) as f64
}

fn largest(ratios: &[f64]) -> f64 {
    ratios.iter().copied().fold(0.0, f64::max)
}

/// The page of all cells: sizes one by one, and the cells that are far from the fastest.
pub fn page(raced: &[Raced]) -> Result<String, std::fmt::Error> {
    let largest_scene = raced.iter().map(|one| one.cell.particles).max().unwrap_or(0);
    let mut text = format!(
        "# What `--solver auto` costs beside the fastest solver\n\n\
         Made by `cargo xtask auto --largest {largest_scene} --write`: 30 steps of `linear-backward-euler` (one matrix and one solve a step) from the start of ready scenes, with steps of 1e-4 to 1e-1 s and \
         tolerances of 1e-4, 1e-7 and 1e-10, by `auto` and by each solver that could have been asked for (`llt`; `cg` with \
         `block-jacobi`, `multigrid` and no preconditioner), of which the fastest is 1. Times of one thread, each step's the shortest of two to nine rounds, in which every solver has its turn. \
         After its first steps: medians of the last 15. As a whole: all 30 with what is done before the first.\n\n\
         | particles | cells | after its first steps: within 1.15 | within 2 | largest | as a whole: within 1.3 | largest |\n\
         |---|---|---|---|---|---|---|\n",
    );
    let mut sizes: Vec<usize> = raced.iter().map(|one| one.cell.particles).collect();
    sizes.dedup();
    for size in sizes.into_iter().map(Some).chain([None]) {
        let these: Vec<[f64; 2]> = raced
            .iter()
            .filter(|one| size.is_none_or(|size| one.cell.particles == size))
            .map(|one| one.ratios().map(|(ratio, _)| ratio))
            .collect();
        let [steps, wholes] = [0, 1].map(|which| these.iter().map(|ratios| ratios[which]).collect::<Vec<_>>());
        writeln!(
            text,
            "| {} | {} | {:.0} % | {:.0} % | {:.2} | {:.0} % | {:.2} |",
            size.map_or("all".into(), |size| size.to_string()),
            these.len(),
            share(&steps, NEAR),
            share(&steps, FAR),
            largest(&steps),
            share(&wholes, WHOLE),
            largest(&wholes),
        )?;
    }
    text.push_str(
        "\nCells that are above 1.15 or 1.3:\n\n\
         | scene, particles | dt | tolerance | `auto` ends with | ms a step | over the fastest | which is | as a whole | fastest |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    let mut far: Vec<&Raced> = raced
        .iter()
        .filter(|one| {
            let [(step, _), (whole, _)] = one.ratios();
            step > NEAR || whole > WHOLE
        })
        .collect();
    far.sort_by(|a, b| b.ratios()[0].0.total_cmp(&a.ratios()[0].0));
    far.iter().try_for_each(|one| writeln!(text, "{}", one.line()))?;
    Ok(text)
}
