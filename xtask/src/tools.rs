//! Programs that measure the crate and regenerate recorded files. Each receives the remaining arguments.

use anyhow::{Context, Result, ensure};
use clap::{Args, Subcommand};
use std::path::Path;
use std::process::Command;

/// A program.
#[derive(Debug, Clone, Subcommand)]
pub enum Tool {
    /// Compare a thousand random scenes with an independent reference: verification/study.md; 10 minutes
    Study(Words),
    /// Compare adaptive and strict linear tolerances on the scenes of the study: verification/exactness.md; 10 minutes
    Exactness(Words),
    /// Measure error and cost of --accuracy on random scenes: verification/accuracy.md; 15 minutes
    Accuracy(Words),
    /// Measure --accuracy on ready scenes of all sizes: verification/ready.md; an hour
    Ready(Words),
    /// Hold equilibria, mechanisms and modes to second methods and closed forms: verification/statics.md; minutes
    Statics(Words),
    /// Compare answers to indefinite matrices on random scenes: verification/definiteness.md; a minute
    Definiteness(Words),
    /// Run every method towards prescribed motions: verification/manufactured.md; a minute
    Manufactured(Words),
    /// Compare methods on a swinging cloth: the table of verification/motion.md; minutes
    Motion(Words),
    /// Draw work–precision diagrams and stability maps: verification/charts; minutes
    Charts(Words),
    /// Compare methods with integrators of other libraries: benches/peers/README.md, verification/charts; minutes
    Peers(Words),
    /// Compare `--solver auto` with each solver: verification/auto.md; an hour
    Auto(Words),
    /// Measure the cost of the energy balance and the error estimate; a minute
    MonitorCost(Words),
    /// Run stress tests: random bytes, killed runs, odd matrices; see CONTRIBUTING.md
    Stress(Words),
    /// Measure residuals on matrices that are hard: verification/zoo.md; seconds
    Zoo(Words),
    /// Derive known answers by the Python programs in verification/answers/derive; minutes
    Answers(Words),
    /// Measure performance: docs/performance; half an hour
    Performance(Words),
    /// Draw the picture of the README: docs/lost-definiteness.svg; seconds
    Picture(Words),
}

/// The arguments of a program.
#[derive(Debug, Clone, Default, Args)]
#[command(disable_help_flag = true)]
pub struct Words {
    /// Passed to the program, --help included
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    words: Vec<String>,
}

/// The arguments of Cargo that select the programs of `verification/`.
const VERIFICATION: [&str; 4] = ["--package", "sprung-verification", "--features", "tools"];

impl Tool {
    /// The program and its first arguments.
    fn command(&self) -> (&'static str, Vec<&'static str>) {
        let tool = |name| {
            let mut words = vec!["run", "--release"];
            words.extend(VERIFICATION);
            words.extend(["--bin", name, "--"]);
            ("cargo", words)
        };
        match self {
            Self::Study(_) => tool("study"),
            Self::Exactness(_) => tool("exactness"),
            Self::Accuracy(_) => tool("accuracy"),
            Self::Ready(_) => tool("ready"),
            Self::Statics(_) => tool("statics"),
            Self::Definiteness(_) => tool("definiteness"),
            Self::Manufactured(_) => tool("manufactured"),
            Self::Motion(_) => tool("motion"),
            Self::Charts(_) => tool("charts"),
            Self::Auto(_) => tool("auto"),
            Self::MonitorCost(_) => tool("monitor_cost"),
            Self::Stress(_) => tool("stress"),
            Self::Zoo(_) => tool("zoo"),
            Self::Picture(_) => ("cargo", vec!["run", "--release", "--example", "lost_definiteness", "--"]),
            Self::Peers(_) => ("cargo", vec!["run", "--release", "--manifest-path", "benches/peers/Cargo.toml", "--"]),
            Self::Answers(_) => ("python3", vec!["verification/answers/derive/all.py"]),
            Self::Performance(_) => ("python3", vec!["benches/compare/run.py"]),
        }
    }

    fn words(&self) -> &[String] {
        let (Self::Study(given)
        | Self::Exactness(given)
        | Self::Accuracy(given)
        | Self::Ready(given)
        | Self::Statics(given)
        | Self::Definiteness(given)
        | Self::Manufactured(given)
        | Self::Motion(given)
        | Self::Charts(given)
        | Self::Peers(given)
        | Self::Auto(given)
        | Self::MonitorCost(given)
        | Self::Stress(given)
        | Self::Zoo(given)
        | Self::Answers(given)
        | Self::Performance(given)
        | Self::Picture(given)) = self;
        &given.words
    }
}

/// Runs a program.
pub fn run(root: &Path, tool: &Tool) -> Result<()> {
    let (program, arguments) = tool.command();
    let mut command = Command::new(program);
    command.current_dir(root).args(arguments).args(tool.words());
    let status = command.status().with_context(|| format!("{program} could not be started"))?;
    ensure!(status.success(), "{program} ended with {status}");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::Tool;
    use clap::{FromArgMatches, Subcommand};

    /// Every program exists and receives its arguments.
    #[test]
    fn every_tool_has_its_program() {
        let root = crate::root().unwrap();
        let manifest = std::fs::read_to_string(root.join("verification/Cargo.toml")).unwrap();
        let tools = Tool::augment_subcommands(clap::Command::new("xtask"));
        let names: Vec<String> = tools.get_subcommands().map(|tool| tool.get_name().to_owned()).collect();
        assert!(names.len() >= 10, "{names:?}");
        for name in names {
            let matches = tools.clone().try_get_matches_from(["xtask", &name, "--help", "a"]).unwrap();
            let tool = Tool::from_arg_matches(&matches).unwrap();
            assert_eq!(tool.words(), ["--help", "a"]);
            let (_, words) = tool.command();
            let known = match words.as_slice() {
                [script] => root.join(script).exists(),
                [.., "--manifest-path", manifest, "--"] => root.join(manifest).exists(),
                [.., "--bin", name, "--"] => manifest.contains(&format!("name = \"{name}\"")),
                [.., "--example", name, "--"] => root.join(format!("examples/{name}.rs")).exists(),
                _ => false,
            };
            assert!(known, "{tool:?}: {words:?}");
        }
    }
}
