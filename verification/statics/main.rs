//! Makes `verification/statics.md`: equilibria, mechanisms and modes of random scenes and of the textbooks, held to second methods.
//!
//! ```sh
//! cargo xtask statics --write               # everything, and the page
//! cargo xtask statics --first 7000          # other seeds
//! cargo xtask statics --part modes --count 20
//! ```

#[path = "mod.rs"]
mod statics;

use clap::Parser;
use statics::{Section, answers, equilibria, frameworks, vibrations};
use std::error::Error;
use std::ops::Range;
use std::path::Path;

/// Equilibria, mechanisms and modes against second methods.
#[derive(Parser)]
struct Arguments {
    /// The first seed of each part
    #[arg(long, default_value_t = 10_000)]
    first: u64,

    /// Scenes of each part; 1000 equilibria, 500 frameworks and 200 scenes with modes if not given
    #[arg(long)]
    count: Option<u64>,

    /// Only this part: equilibria, frameworks, modes or answers
    #[arg(long)]
    part: Option<String>,

    /// Writes the page
    #[arg(long)]
    write: bool,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let seeds = |usual: u64| -> Range<u64> { arguments.first..arguments.first + arguments.count.unwrap_or(usual) };
    type Part<'a> = (&'a str, Box<dyn Fn() -> Section + 'a>);
    let parts: [Part<'_>; 4] = [
        ("equilibria", Box::new(|| equilibria::section(seeds(1000)))),
        ("frameworks", Box::new(|| frameworks::section(seeds(500)))),
        ("modes", Box::new(|| vibrations::section(seeds(200)))),
        ("answers", Box::new(answers::section)),
    ];
    let mut sections = Vec::new();
    let mut counts = String::new();
    for (name, section) in &parts {
        if arguments.part.as_ref().is_none_or(|part| part == name) {
            let section = section();
            counts.push_str(&format!("| {name} | {} |\n", section.failures));
            sections.push(section);
        }
    }
    let mut command = String::from("cargo xtask statics");
    if arguments.first != 10_000 {
        command.push_str(&format!(" --first {}", arguments.first));
    }
    if let Some(count) = arguments.count {
        command.push_str(&format!(" --count {count}"));
    }
    let page = format!(
        "# Equilibria, mechanisms and modes\n\nMade by `{command} --write`.\n\n| part | failures |\n|---|---|\n{counts}\n{}",
        sections.iter().map(|section| section.text.as_str()).collect::<String>()
    );
    let page = format!("{}\n", page.trim_end());
    println!("{page}");
    if arguments.write {
        std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join("statics.md"), page)?;
    }
    Ok(())
}
