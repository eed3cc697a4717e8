//! Errors: unusable inputs, with their location.
//!
//! An [`Error`] means that nothing was computed. A computation that breaks down is an outcome with a status instead, see
//! [`StepFailure`](crate::integrate::StepFailure).

use std::fmt;
use std::path::{Path, PathBuf};

/// The result of reading or checking an input.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// An input that cannot be used, and the reason.
///
/// # Examples
/// ```
/// use sprung::{Error, SystemBuilder};
///
/// let mut builder = SystemBuilder::new();
/// builder.particle([0.0; 3], -1.0);
/// match builder.build() {
///     Err(Error::Invalid(invalid)) => assert_eq!((invalid.key.as_str(), invalid.index), ("particles.masses", Some(0))),
///     other => panic!("{other:?}"),
/// }
/// ```
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A value in a scene, or given to a [`SystemBuilder`](crate::SystemBuilder), breaks a rule.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// A file does not follow its format.
    #[error("{}: {}", file.display(), shortened(message))]
    Format {
        /// The file.
        file: PathBuf,
        /// The parser's message, with key or line and column.
        message: String,
    },
    /// A file or folder cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// A spring has coincident ends, and so no direction.
    #[error(transparent)]
    DegenerateSpring(#[from] DegenerateSpring),
    /// An allocation exceeds the available memory or its limit, and was not made.
    #[error("{what} takes {}, and there is room for {}", readable(*bytes), readable(*room))]
    TooLarge {
        /// The name of the data.
        what: &'static str,
        /// The size, in bytes.
        bytes: u64,
        /// The available memory, in bytes.
        room: u64,
    },
    /// A step of a run that is kept to be differentiated broke down.
    #[error("step {step}, from t = {} s, broke down: {reason}", significant(*time, 6))]
    Breakdown {
        /// The number of the step, from 1.
        step: usize,
        /// The time at its start, in s.
        time: f64,
        /// The name of the [`Status`](crate::integrate::Status).
        status: &'static str,
        /// The failure in words.
        reason: String,
    },
    /// A scene that cannot be read or generated.
    #[error("{0}")]
    Scene(String),
    /// An unsupported combination of options.
    #[error("{0}")]
    Unsupported(String),
    /// Command-line arguments that contradict each other or the scene.
    #[error("{0}")]
    Usage(String),
}

impl Error {
    /// An error of the operating system at a path.
    pub fn io(path: impl Into<PathBuf>, source: std::io::Error) -> Self {
        Self::Io { path: path.into(), source }
    }

    /// An error of reading text, which must be UTF-8.
    pub fn reading_text(path: impl Into<PathBuf>, source: std::io::Error) -> Self {
        match source.kind() {
            std::io::ErrorKind::InvalidData => {
                Self::Format { file: path.into(), message: "is no text in UTF-8".into() }
            }
            _ => Self::io(path, source),
        }
    }

    /// Adds the file to an invalid value or a degenerate spring that has none yet. Other errors are returned unchanged.
    pub fn in_file(self, path: impl AsRef<Path>) -> Self {
        match self {
            Self::Invalid(invalid) if invalid.file.is_none() => {
                Self::Invalid(Invalid { file: Some(path.as_ref().to_path_buf()), ..invalid })
            }
            Self::DegenerateSpring(DegenerateSpring { spring, pair: [i, j] }) => {
                let invalid =
                    Invalid::new("springs.pairs", format!("[{i}, {j}]"), "is a spring of zero current length");
                Self::Invalid(invalid.at(spring)).in_file(path)
            }
            other => other,
        }
    }
}

pub(crate) fn check_length(name: &str, found: usize, expected: usize) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    Err(Invalid::new(name, format!("{found} entries"), format!("must have {expected}")).into())
}

/// A number of at most so many significant digits, in plain notation where that is short: `0.35`, `-1380.19`, `2.5e-7`.
pub(crate) fn significant(value: f64, digits: usize) -> String {
    let rounded: f64 = format!("{value:.*e}", digits.saturating_sub(1)).parse().unwrap_or(value);
    // Without the sign of zero.
    let rounded = rounded + 0.0;
    let is_plain = rounded == 0.0 || (1e-4..1e7).contains(&rounded.abs()) || !rounded.is_finite();
    if is_plain { rounded.to_string() } else { format!("{rounded:e}") }
}

/// `each of the 3 particles`, and `the only particle` of one.
pub(crate) fn each(count: usize, of: &str) -> String {
    if count != 1 {
        return format!("each of the {count} {of}");
    }
    let (noun, rest) = of.split_at(of.find(' ').unwrap_or(of.len()));
    format!("the only {}{rest}", noun.strip_suffix('s').unwrap_or(noun))
}

/// A size in kB, MB or GB.
fn readable(bytes: u64) -> String {
    let bytes = bytes as f64;
    match bytes {
        _ if bytes < 1e6 => format!("{:.1} kB", bytes / 1e3),
        _ if bytes < 1e9 => format!("{:.1} MB", bytes / 1e6),
        _ => format!("{:.1} GB", bytes / 1e9),
    }
}

/// The first and last 200 characters of a long text: a wrong value may be as long as its file, and the end has the position.
fn shortened(text: &str) -> std::borrow::Cow<'_, str> {
    const QUOTED: usize = 200;
    let count = text.chars().count();
    if count <= 3 * QUOTED {
        return text.into();
    }
    let head: String = text.chars().take(QUOTED).collect();
    let tail: String = text.chars().skip(count - QUOTED).collect();
    format!("{head} … ({} characters left out) … {tail}", count - 2 * QUOTED).into()
}

/// A value that breaks a rule: file, key, index, value and the rule.
///
/// Displays as `scene.toml: particles.masses[3] = -1: must be finite and positive`.
#[derive(Debug, Clone, PartialEq)]
pub struct Invalid {
    /// The file, where there is one.
    pub file: Option<PathBuf>,
    /// The scene's key in dotted form, for example `particles.masses`.
    pub key: String,
    /// The index in the list.
    pub index: Option<usize>,
    /// The value as text; empty where there is none.
    pub value: String,
    /// The rule that the value breaks.
    pub rule: String,
}

impl Invalid {
    /// An invalid value of `key`, to be completed by [`at`](Self::at).
    pub fn new(key: impl Into<String>, value: impl fmt::Display, rule: impl Into<String>) -> Self {
        Self { file: None, key: key.into(), index: None, value: value.to_string(), rule: rule.into() }
    }

    /// Adds the index of the value in its list.
    pub fn at(self, index: usize) -> Self {
        Self { index: Some(index), ..self }
    }
}

impl fmt::Display for Invalid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            write!(f, "{}: ", file.display())?;
        }
        write!(f, "{}", shortened(&self.key))?;
        if let Some(index) = self.index {
            write!(f, "[{index}]")?;
        }
        if self.value.is_empty() {
            return write!(f, ": {}", shortened(&self.rule));
        }
        let value = match self.value.parse::<f64>() {
            // 24 characters hold every double in plain notation that is not mostly zeros.
            Ok(number) if self.value.len() > 24 => format!("{number:e}").into(),
            _ => shortened(&self.value),
        };
        write!(f, " = {value}: {}", shortened(&self.rule))
    }
}

impl std::error::Error for Invalid {}

/// A spring whose ends coincide, so that its direction, force and stiffness are undefined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("spring {spring} has length zero: its ends, particles {} and {}, coincide", pair[0], pair[1])]
pub struct DegenerateSpring {
    /// The spring.
    pub spring: usize,
    /// Its ends.
    pub pair: [usize; 2],
}

#[cfg(test)]
mod tests {
    use super::{Error, Invalid, each, readable, significant};

    #[test]
    fn messages_fit_their_numbers() {
        for (value, text) in [(-1e-300, "-1e-300"), (1e300, "1e300"), (0.1234567890123456, "0.1234567890123456")] {
            assert_eq!(Invalid::new("k", value, "no").to_string(), format!("k = {text}: no"));
        }
        assert_eq!([999, 1_500_000, 3_400_000_000].map(readable), ["1.0 kB", "1.5 MB", "3.4 GB"]);
        let numbers = [0.1 + 0.2, 2e11, 4.1e-9, 8397.1772, 0.0, -1e-300].map(|value| significant(value, 3));
        assert_eq!(numbers, ["0.3", "2e11", "4.1e-9", "8400", "0", "-1e-300"]);
        let particles = [1, 2].map(|count| each(count, "particles of the scene"));
        assert_eq!(particles, ["the only particle of the scene", "each of the 2 particles of the scene"]);
        assert_eq!(Invalid::new("k", "", "must be given").to_string(), "k: must be given");
    }

    #[test]
    fn long_texts_are_quoted_by_their_ends() {
        let long = format!("begin{}end", "é".repeat(1 << 20));
        let invalid = Invalid::new(long.clone(), long.clone(), long.clone());
        for error in [Error::Format { file: "f".into(), message: long }, invalid.into()] {
            let message = error.to_string();
            assert!(message.len() < 5000 && message.contains("begin") && message.ends_with("end"), "{message}");
            assert!(message.contains("(1048184 characters left out)"), "{message}");
        }
        let short = "x".repeat(600);
        assert_eq!(Error::Format { file: "f".into(), message: short.clone() }.to_string(), format!("f: {short}"));
    }
}
