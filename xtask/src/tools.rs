//! The programs that examine the crate and renew what is recorded: each is built where it stands, as Cargo builds it, and given the words
//! that follow.

use anyhow::{Context, Result, ensure};
use clap::{Args, Subcommand};
use std::path::Path;
use std::process::Command;

/// Which program.
#[derive(Debug, Clone, Subcommand)]
pub enum Tool {
    /// A thousand random scenes against an independent reference: verification/study.md; ten minutes
    Study(Words),
    /// Linear systems solved as exactly as the motion needs, on the scenes of the study: verification/exactness.md; ten minutes
    LinearTolerance(Words),
    /// What --accuracy answers on random scenes, and what that costs: verification/accuracy.md; a quarter of an hour
    Accuracy(Words),
    /// What --accuracy answers on ready scenes of all sizes, against references by two methods: verification/ready.md; an hour
    Ready(Words),
    /// Cloths that swing down by several methods: the table of verification/motion.md; minutes
    Motion(Words),
    /// Speed against accuracy, and maps of stability: verification/charts; minutes
    Charts(Words),
    /// Methods beside integrators of other libraries: benches/peers/README.md, verification/charts; minutes
    Communicator(Words),
    /// `--solver auto` beside the solvers it chooses from: verification/auto.md; an hour
    Auto(Words),
    /// What accompanying a run costs; a minute
    MonitorCost(Words),
    /// Random bytes, killed runs, odd matrices; see CONTRIBUTING
    Stress(Words),
    /// Known answers from the Python programs in verification/answers/derive; minutes
    Answers(Words),
    /// Tables and pictures of speed: docs/performance; half an hour
    Performance(Words),
    /// The README's first picture: docs/lost-definiteness.svg; seconds
    Picture(Words),
}

/// What is handed to a tool.
#[derive(Debug, Clone, Default, Args)]
#[command(disable_help_flag = true)]
pub struct Words {
    /// Handed to the tool, --help too
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    words: Vec<String>,
}

/// Where the tools of `verification/` are.
const VERIFICATION: [&str; 4] = ["--package", "sprung-verification", "--features", "tools"];

impl Tool {
    /// Program and words.
    fn command(&self) -> (&'static str, Vec<&'static str>) {
        let tool = |name| {
            let mut words = vec!["run", "--release"];
            words.extend(VERIFICATION);
            words.extend(["--bin", name, "--"]);
            ("cargo", words)
        };
        match self {
            Self::Study(_) => tool("study"),
            Self::LinearTolerance(_) => tool("exactness"),
            Self::Accuracy(_) => tool("accuracy"),
            Self::Ready(_) => tool("ready"),
            Self::Motion(_) => tool("motion"),
            Self::Charts(_) => tool("charts"),
            Self::Auto(_) => tool("auto"),
            Self::MonitorCost(_) => tool("monitor_cost"),
            Self::Stress(_) => tool("stress"),
            Self::Picture(_) => ("cargo", vec!["run", "--release", "--example", "lost_definiteness", "--"]),
            Self::Communicator(_) => {
                ("cargo", vec!["run", "--release", "--manifest-path", "benches/peers/Cargo.toml", "--"])
            }
            Self::Answers(_) => ("python3", vec!["verification/answers/derive/all.py"]),
            Self::Performance(_) => ("python3", vec!["benches/compare/run.py"]),
        }
    }

    fn words(&self) -> &[String] {
        let (Self::Study(given)
        | Self::LinearTolerance(given)
        | Self::Accuracy(given)
        | Self::Ready(given)
        | Self::Motion(given)
        | Self::Charts(given)
        | Self::Communicator(given)
        | Self::Auto(given)
        | Self::MonitorCost(given)
        | Self::Stress(given)
        | Self::Answers(given)
        | Self::Performance(given)
        | Self::Picture(given)) = self;
        &given.words
    }
}

/// Runs a program to its end.
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

    /// What a tool runs is there, and words after its name reach it.
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
