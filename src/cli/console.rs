//! Output for people: results on stdout; notes, errors and progress on stderr.

use super::Stop;
use anstyle::{AnsiColor, Effects};
use clap::error::{ContextKind, ContextValue};
use clap::{ColorChoice, Command, ValueEnum};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use serde::Serialize;
use sprung::Error;
pub use sprung::report::number::{compact as number, count};
use std::fmt::{self, Display};
use std::io::{self, Write};

/// The parts in which the progress bar of a share of work counts.
pub const PARTS: u64 = 1000;

/// The amount and form of output.
#[derive(Debug, clap::Args)]
pub struct Console {
    /// Say nothing but errors and warnings
    #[arg(short, long, global = true, display_order = 100)]
    pub quiet: bool,

    /// Say everything that is known of a run: solvers, work, where the energy went
    #[arg(short, long, global = true, display_order = 100, conflicts_with_all = ["quiet", "json"])]
    pub verbose: bool,

    /// Print the result as one JSON object on stdout, and nothing else there
    #[arg(long, global = true, display_order = 101)]
    pub json: bool,

    /// When to colour what goes to the terminal; auto also follows NO_COLOR
    #[arg(long, global = true, value_name = "WHEN", default_value = "auto", display_order = 102)]
    pub color: ColorChoice,
}

impl Console {
    /// Prints a command's result on stdout: as JSON, or as text, whose longer form is its alternate one (`{:#}`).
    pub fn result(&self, result: &impl Serialize, text: impl Display) -> Result<(), Stop> {
        if self.json {
            let json = serde_json::to_string_pretty(result).map_err(|error| broken_stdout(error.into()))?;
            print(&json)
        } else if self.quiet {
            Ok(())
        } else {
            print(&if self.verbose { format!("{text:#}") } else { text.to_string() })
        }
    }

    pub fn note(&self, line: impl Display) {
        if !self.quiet {
            print_labelled("note", AnsiColor::Cyan, line);
        }
    }

    /// A progress bar on stderr, which appears only on a terminal.
    pub fn bar(&self, length: u64, template: &str) -> ProgressBar {
        let target = if self.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(length), target);
        let eta = |state: &ProgressState, text: &mut dyn fmt::Write| {
            let seconds = state.eta().as_secs();
            let _ = match state.pos() {
                0 => write!(text, "time unknown"),
                _ if seconds < 60 => write!(text, "{} s left", seconds.max(1)),
                _ => write!(text, "{} left", time_span(seconds as f64)),
            };
        };
        let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
        bar.with_style(style.with_key("eta", eta))
    }

    pub fn step_bar(&self, steps: u64) -> ProgressBar {
        self.bar(steps, "{wide_bar} step {pos} of {len}, {msg}, {eta}").with_message("at the start")
    }
}

/// The value of `--color`, before the arguments are parsed: errors in them are coloured too.
pub fn requested_color(arguments: impl Iterator<Item = String>) -> ColorChoice {
    let mut arguments = arguments.skip_while(|argument| !argument.starts_with("--color"));
    let value = arguments.next().and_then(|argument| match argument.strip_prefix("--color=") {
        Some(value) => Some(value.to_owned()),
        None => arguments.next(),
    });
    value.and_then(|value| ColorChoice::from_str(&value, true).ok()).unwrap_or(ColorChoice::Auto)
}

pub fn set_color(choice: ColorChoice) {
    let choice = match choice {
        ColorChoice::Auto => anstream::ColorChoice::Auto,
        ColorChoice::Always => anstream::ColorChoice::Always,
        ColorChoice::Never => anstream::ColorChoice::Never,
    };
    choice.write_global();
}

/// Prints text and a line break on stdout. A reader that has left (`sprung new cloth | head`) is not an error.
pub fn print(text: &str) -> Result<(), Stop> {
    let mut stdout = io::stdout().lock();
    match writeln!(stdout, "{text}").and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(broken_stdout(error)),
        _ => Ok(()),
    }
}

fn broken_stdout(source: io::Error) -> Stop {
    Stop::Broken(Error::io("standard output", source))
}

pub fn error(message: impl Display) {
    print_labelled("error", AnsiColor::Red, message);
}

/// Prints a reason to doubt a result, quiet or not.
pub fn warning(line: impl Display) {
    print_labelled("warning", AnsiColor::Yellow, line);
}

pub fn help(line: impl Display) {
    print_labelled("help", AnsiColor::Green, line);
}

/// Prints a line on stderr, whether or not anyone reads it.
fn print_labelled(label: &str, color: AnsiColor, line: impl Display) {
    let style = color.on_default().effects(Effects::BOLD);
    let _ = writeln!(anstream::stderr(), "{style}{label}:{style:#} {line}");
}

/// Adds a suggestion to an error of the arguments where clap has none: it compares letters from the front, and does not see `run` in `rnu`.
pub fn with_suggestion(mut error: clap::error::Error, program: &Command) -> clap::error::Error {
    let word = |error: &clap::error::Error, kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        _ => None,
    };
    if let Some(word) = word(&error, ContextKind::InvalidSubcommand)
        && error.get(ContextKind::SuggestedSubcommand).is_none()
        && let Some(known) = nearest(&word, program.get_subcommands().map(Command::get_name))
    {
        error.insert(ContextKind::SuggestedSubcommand, ContextValue::Strings(vec![known.to_owned()]));
    }
    if let (Some(word), Some(ContextValue::Strings(valid))) =
        (word(&error, ContextKind::InvalidValue), error.get(ContextKind::ValidValue))
        && error.get(ContextKind::SuggestedValue).is_none()
        && let Some(known) = nearest(&word, valid.iter().map(String::as_str))
    {
        let known = ContextValue::String(known.to_owned());
        error.insert(ContextKind::SuggestedValue, known);
    }
    error
}

/// The known word at the smallest edit distance, at most a third of the word's length.
fn nearest<'a>(word: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let most = word.chars().count().div_ceil(3);
    let distances = known.map(|known| (strsim::osa_distance(word, known), known));
    distances.filter(|(distance, _)| *distance <= most).min_by_key(|(distance, _)| *distance).map(|(_, known)| known)
}

/// A time span, in s: `0.35 s`, `12.4 s`, `1 min 49 s`, `2 h 5 min`.
pub fn time_span(seconds: f64) -> String {
    if seconds < 59.95 {
        return if seconds < 9.995 { format!("{seconds:.2} s") } else { format!("{seconds:.1} s") };
    }
    let whole = seconds.round() as u64;
    match (whole / 3600, whole / 60 % 60, whole % 60) {
        (0, minutes, 0) => format!("{minutes} min"),
        (0, minutes, seconds) => format!("{minutes} min {seconds} s"),
        (hours, 0, _) => format!("{hours} h"),
        (hours, minutes, _) => format!("{hours} h {minutes} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::{count, nearest, number, time_span};

    #[test]
    fn numbers_and_time_spans_are_short() {
        let numbers = [5.0 / 3.0, -1380.194123, 20.0, -0.0, 2.5e-7, 31557600.0, f64::NAN].map(number);
        assert_eq!(numbers, ["1.66667", "-1380.19", "20", "0", "2.5e-7", "3.15576e7", "NaN"]);
        assert_eq!([0, 1, 2].map(|n| count(n, "step")), ["0 steps", "1 step", "2 steps"]);
        let spans = [0.3512, 9.996, 59.9, 59.96, 108.6, 3600.0, 7523.0].map(time_span);
        assert_eq!(spans, ["0.35 s", "10.0 s", "59.9 s", "1 min", "1 min 49 s", "1 h", "2 h 5 min"]);
    }

    #[test]
    fn slips_are_understood_and_guesses_are_not() {
        let known = ["run", "matrix", "inspect", "chart", "new", "w2"];
        let slips = [("rnu", "run"), ("nwe", "new"), ("w3", "w2"), ("isnpetc", "inspect")];
        assert!(slips.iter().all(|(word, meant)| nearest(word, known.into_iter()) == Some(meant)));
        assert!(["simulate", ""].iter().all(|word| nearest(word, known.into_iter()).is_none()));
    }
}
