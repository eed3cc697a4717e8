//! Equilibria, mechanisms and modes against second methods and closed forms.
//!
//! | file | contents |
//! |---|---|
//! | `mechanics` | a second writing of forces, energy differences, stiffness and compatibility matrices, dense, which shares nothing with the library's |
//! | `scenes` | random scenes, one for each seed |
//! | `equilibria` | their equilibria, held to dense eigenvalues, to damped motions and to the sums of loads |
//! | `frameworks` | random frameworks and those of the textbooks, held to dense singular values |
//! | `vibrations` | modes of planted scenes, held to dense eigenvalues |
//! | `answers` | closed forms: catenary, two-bar truss, chain, rings, membrane |
//! | `code_aster` | published answers for a damped chain: harmonic and random response, complex modes |
//! | `published` | published frequencies of an elastic network and of a prestressed tensegrity |

pub mod answers;
pub mod code_aster;
pub mod equilibria;
pub mod frameworks;
pub mod mechanics;
pub mod published;
pub mod scenes;
pub mod vibrations;

use std::panic::{AssertUnwindSafe, catch_unwind};

/// Part of a page, and the number of failures that it shows.
pub struct Section {
    /// Markdown.
    pub text: String,
    /// Failures, shown in the text.
    pub failures: usize,
}

/// The value of a function; an error or a panic as text.
pub fn caught<T>(of: impl FnOnce() -> sprung::Result<T>) -> Result<T, String> {
    match catch_unwind(AssertUnwindSafe(of)) {
        Ok(value) => value.map_err(|error| format!("error: {error}")),
        Err(panic) => {
            let text = panic.downcast_ref::<String>().cloned();
            let text = text.or(panic.downcast_ref::<&str>().map(ToString::to_string)).unwrap_or_default();
            Err(format!("panic: {text}"))
        }
    }
}

/// Failures as a list, or a line that there is none.
pub fn list(failures: &[String]) -> String {
    if failures.is_empty() {
        return "No failures.\n\n".into();
    }
    format!(
        "{} failures:\n\n{}\n",
        failures.len(),
        failures.iter().map(|line| format!("- {line}\n")).collect::<String>()
    )
}

/// The median and the largest of some counts.
pub fn median_and_most(mut counts: Vec<usize>) -> [usize; 2] {
    counts.sort_unstable();
    [counts.get(counts.len() / 2).copied().unwrap_or(0), counts.last().copied().unwrap_or(0)]
}
