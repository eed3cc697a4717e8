//! The programs that renew what is recorded: each is built where it stands, as Cargo builds it, and given the words that follow.

use anyhow::{Context, Result, ensure};
use clap::ValueEnum;
use std::path::Path;
use std::process::Command;

/// Which program.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum Tool {
    /// Plant every fault and see which check catches it: verification/faults.json, faults.md; a quarter of an hour
    Faults,
    /// Make every mutant and see what becomes of it: verification/mutants.md; half an hour
    Mutants,
    /// A thousand random scenes against an independent reference: verification/study.md; ten minutes
    Study,
    /// Speed against accuracy, and maps of stability: verification/charts; minutes
    Charts,
    /// What the cost model is held to: verification/costs.json; minutes
    Costs,
    /// Random bytes, killed runs, odd matrices; see CONTRIBUTING
    Stress,
    /// The counts of work that tests hold steps to: tests/work_locks.txt; seconds once built
    Locks,
    /// Known answers from the Python programs in verification/answers/derive; minutes
    Answers,
    /// Tables and pictures of speed: docs/performance; half an hour
    Performance,
    /// The README's first picture: docs/lost-definiteness.svg; seconds
    Picture,
}

impl Tool {
    /// Program, words, and a variable of the environment to set.
    fn command(self) -> (&'static str, Vec<&'static str>, Option<&'static str>) {
        let example = |name| ("cargo", vec!["run", "--release", "--example", name, "--"], None);
        match self {
            Self::Faults => ("cargo", vec!["run", "--example", "faults", "--"], None),
            Self::Mutants => example("mutants"),
            Self::Study => example("study"),
            Self::Charts => example("charts"),
            Self::Costs => example("costs"),
            Self::Stress => example("stress"),
            Self::Picture => example("lost_definiteness"),
            Self::Locks => ("cargo", vec!["test", "--release", "--test", "work_locks", "--"], Some("SPRUNG_RENEW")),
            Self::Answers => ("python3", vec!["verification/answers/derive/all.py"], None),
            Self::Performance => ("python3", vec!["benches/compare/run.py"], None),
        }
    }
}

/// Runs a program to its end.
pub fn run(root: &Path, tool: Tool, words: &[String]) -> Result<()> {
    let (program, arguments, variable) = tool.command();
    let mut command = Command::new(program);
    command.current_dir(root).args(arguments).args(words);
    if let Some(variable) = variable {
        command.env(variable, "1");
    }
    let status = command.status().with_context(|| format!("{program} could not be started"))?;
    ensure!(status.success(), "{program} ended with {status}");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::Tool;
    use clap::ValueEnum;

    /// What a tool runs is there.
    #[test]
    fn every_tool_has_its_program() {
        let root = crate::root().unwrap();
        let manifest = std::fs::read_to_string(root.join("Cargo.toml")).unwrap();
        for tool in Tool::value_variants() {
            let (_, words, _) = tool.command();
            let known = match words.as_slice() {
                [script] => root.join(script).exists(),
                [.., "--test", name, "--"] => root.join(format!("tests/{name}.rs")).exists(),
                [.., "--example", name, "--"] => {
                    manifest.contains(&format!("name = \"{name}\""))
                        || root.join(format!("examples/{name}.rs")).exists()
                }
                _ => false,
            };
            assert!(known, "{tool:?}: {words:?}");
        }
    }
}
