//! The counted differences, and their page.

use super::pair::{METHODS, Pair, STRICT};
use super::study::cases::WRONG;
use super::study::rows::{number, quantile, sorted};

/// An error that grew by more than this part of itself.
const GREW: f64 = 0.1;

/// The smallest error that differences are compared with, a thousandth of a millimetre on ten metres.
const LEAST: f64 = 1e-7;

/// Whether the error of the run as needed is larger by more than a tenth, where the strict run is right at all.
fn grew(pair: &Pair) -> bool {
    let [strict, needed] = [&pair.strict, &pair.needed].map(super::study::runs::Run::error);
    strict <= WRONG && needed > (1.0 + GREW) * strict + LEAST
}

/// The page.
pub fn page(pairs: &[Pair], scenes: u64) -> String {
    let mut text = format!(
        "# Linear systems solved as exactly as the motion needs\n\n\
         Made by `cargo xtask exactness`: {scenes} random scenes of the [study](study.md), conjugate gradients with block Jacobi and with \
         multigrid, steps of fixed lengths and with error control. Every run is done twice: with residuals of {STRICT:e}, and as exactly as the \
         error in time of each step is worth (a ten-thousandth of it, `src/integrate/linear_tolerance.rs`). Differences are those of positions at the \
         end, over the true error of the strict run. Runs that are wrong by more than {:.0} % anyway are counted and not compared.\n\n\
         | method | pairs | ended otherwise | wrong anyway | difference over error: median | 90 % | 99 % | largest | errors a tenth larger | iterations |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
        100.0 * WRONG
    );
    let mut listed = Vec::new();
    for method in METHODS {
        let of_method: Vec<&Pair> = pairs.iter().filter(|pair| pair.method == method).collect();
        let other: Vec<&Pair> =
            of_method.iter().copied().filter(|pair| pair.strict.status != pair.needed.status).collect();
        let completed: Vec<&Pair> = of_method.iter().copied().filter(|pair| pair.is_completed()).collect();
        let (right, wrong): (Vec<&Pair>, Vec<&Pair>) =
            completed.into_iter().partition(|pair| pair.strict.error() <= WRONG);
        let shares = sorted(right.iter().map(|pair| pair.difference / pair.strict.error().max(LEAST)).collect());
        let grown: Vec<&Pair> = right.iter().copied().filter(|pair| grew(pair)).collect();
        let total = |i: usize| right.iter().map(|pair| pair.iterations[i]).sum::<u64>() as f64;
        text += &format!(
            "| {} | {} | {} | {} | {} | {} | {} | {} | {} | {:.2} |\n",
            method.name(),
            of_method.len(),
            other.len(),
            wrong.len(),
            number(quantile(&shares, 0.5)),
            number(quantile(&shares, 0.9)),
            number(quantile(&shares, 0.99)),
            number(quantile(&shares, 1.0)),
            grown.len(),
            total(1) / total(0),
        );
        listed.extend(other);
        listed.extend(grown);
    }
    text += "\nIterations are those of runs as needed over those of strict ones.\n";
    if !listed.is_empty() {
        text += "\n## Runs that ended otherwise, or with a larger error\n\n\
                 | scene | run | preconditioner | status: strict / as needed | error: strict / as needed | difference |\n\
                 |---|---|---|---|---|---|\n";
        for pair in listed {
            text += &pair.line();
            text.push('\n');
        }
    }
    text
}
