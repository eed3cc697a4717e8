//! Makes `verification/zoo.md`: residuals on matrices that are hard, as ratios to what a backward stable method may leave.
//!
//! ```sh
//! cargo xtask zoo --write
//! ```

#[path = "mod.rs"]
mod zoo;

use sprung::inspect::Inertia;
use std::fmt::Write;
use std::path::Path;
use zoo::{TESTS, THRESHOLD, Tested, matrices, tests};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let results: Vec<_> = matrices::all().into_iter().map(|animal| (tests(&animal), animal)).collect();
    let mut page = format!(
        "# A zoo of matrices\n\nMade by `cargo xtask zoo --write`.\n\n\
         Residuals over what a backward stable method may leave, as the testers of LAPACK report them: `‖A − L B Lᵀ‖/(n ε ‖A‖)`,\n\
         `‖b − A x‖/(n ε ‖A‖ ‖x‖)`, `‖A φ − λ φ‖/(n ε ‖A‖)`, `‖ΦᵀΦ − I‖/(n ε)` and the distance of λ from a dense spectrum beyond the residual that\n\
         is reported with it, over `n ε ‖A‖`, of the twelve lowest pairs. Below {THRESHOLD} passes. *Italic* ratios are not judged: without pivoting\n\
         nothing keeps the errors of indefinite matrices small, which is why solvers and counts measure them, and eigenvectors are computed to a\n\
         tolerance. The column of the inertia is the band in which signs stay undecided, over n ε of the equilibrated matrix. Conjugate gradients\n\
         have a tolerance of 1e-10. Words are those of the routine itself.\n\n"
    );
    page.push_str("| test | worst ratio | on | reported by the routine | wrong |\n|---|---|---|---|---|\n");
    for (number, test) in TESTS.iter().enumerate() {
        let of = || results.iter().map(|(tested, animal)| (&tested[number], animal.name));
        let worst = of().filter_map(|(tested, name)| match tested {
            Tested::Ratio(ratio) => Some((*ratio, name)),
            Tested::Unclaimed(_) | Tested::Reported(_) | Tested::Silent(_) => None,
        });
        let (worst, on) = worst.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::NAN, "–"));
        let reported = of().filter(|(tested, _)| matches!(tested, Tested::Reported(_))).count();
        let wrong = of().filter(|(tested, _)| !tested.is_right()).count();
        match worst.is_nan() {
            true => writeln!(page, "| {test} | not judged | | | |")?,
            false => writeln!(page, "| {test} | {worst:.3} | {on} | {reported} | {wrong} |")?,
        }
    }
    write!(page, "\n| matrix | rows | λ_min | λ_max | signs of eigenvalues |")?;
    TESTS.iter().try_for_each(|test| write!(page, " {test} |"))?;
    writeln!(page, "\n|{}", "---|".repeat(5 + TESTS.len()))?;
    for (tested, animal) in &results {
        let [low, high] = [animal.eigenvalues[0], animal.eigenvalues[animal.eigenvalues.len() - 1]];
        let signs = if Inertia::of(&animal.a)?.proven { "proven" } else { "to rounding" };
        let rows = animal.eigenvalues.len();
        write!(page, "| {} | {rows} | {low:.1e} | {high:.1e} | {signs} |", animal.name)?;
        for tested in tested {
            match tested {
                Tested::Ratio(ratio) => write!(page, " {ratio:.3} |")?,
                Tested::Unclaimed(ratio) => write!(page, " *{ratio:.3}* |")?,
                Tested::Reported(words) => write!(page, " {words} |")?,
                Tested::Silent(words) => write!(page, " **{words}** |")?,
            }
        }
        page.push('\n');
    }
    println!("{page}");
    if std::env::args().any(|argument| argument == "--write") {
        std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join("zoo.md"), page)?;
    }
    Ok(())
}
