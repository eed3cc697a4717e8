//! Long searches for what breaks the program, run once and counted; the tests keep a small part of each.
//!
//! ```sh
//! cargo xtask stress multigrid 10000000     # random systems, each with three preconditioners
//! cargo xtask stress kills 1000             # runs killed at random moments, and resumed
//! cargo xtask stress fuzz steps 1000000     # a body of fuzz/, without coverage
//! ```

#[path = "../../fuzz/bodies/mod.rs"]
mod bodies;
#[path = "../../tests/common/systems.rs"]
mod common;
mod fuzz;
mod kills;
mod multigrid;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let text = |at: usize| arguments.get(at).map(String::as_str);
    let number = |at: usize, default: u64| text(at).map_or(Some(default), |text| text.parse().ok());
    let done = match (text(0), text(1)) {
        (Some("fuzz"), Some(target)) => {
            number(2, 100_000).zip(number(3, 0)).map(|(n, seed)| fuzz::search(target, n, seed))
        }
        (Some(what), _) => number(1, 1000).zip(number(2, 0)).and_then(|(n, seed)| match what {
            "multigrid" => Some(multigrid::search(n, seed, None)),
            "kills" => Some(kills::search(n, seed)),
            "multigrid-system" => Some(multigrid::search(n + 1, seed, Some(n))),
            _ => None,
        }),
        _ => None,
    };
    let Some(done) = done else {
        eprintln!(
            "usage: stress multigrid [SYSTEMS] [SEED] | multigrid-system INDEX [SEED] | kills [COUNT] [SEED] | fuzz TARGET [COUNT] [SEED]"
        );
        std::process::exit(2)
    };
    if !done {
        std::process::exit(1);
    }
}
