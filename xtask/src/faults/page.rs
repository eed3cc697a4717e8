//! The page of faults and the tests that detect them.

use super::Caught;
use std::fmt::Write;

/// A table of all faults.
pub fn page(caught: &[Caught]) -> String {
    let mut text = String::from(
        "# Planted faults, and what catches them\n\n\
         Written by `cargo xtask faults` from `faults.toml`. Every fault is put into a copy of the program, and the suite runs on it,\n\
         or the tests of the fault's module where the suite cannot see it. Numbers are tests that fail, by family: a family is a check,\n\
         its tests are the scenes or cases.\n\n\
         | fault | in | tests | caught by |\n|---|---|---|---|\n",
    );
    for row in caught {
        let _ =
            writeln!(text, "| {} | `{}` | {} | {} |", row.fault, row.function, row.tests, families(row, "**nothing**"));
    }
    text
}

/// The largest families of tests that fail.
pub fn families(row: &Caught, nothing: &str) -> String {
    let named: Vec<String> = row.by.iter().map(|(family, count)| format!("`{family}` ({count})")).collect();
    match row.families - named.len() {
        _ if named.is_empty() => nothing.into(),
        0 => named.join(", "),
        more => format!("{} and {more} more", named.join(", ")),
    }
}
