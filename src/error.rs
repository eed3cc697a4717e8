//! The crate's error: what made an input unusable, and where.
//!
//! An [`Error`] always means that nothing was computed. A computation that starts and then breaks down is not an
//! error but an outcome with a status, see [`StepFailure`](crate::integrate::StepFailure).

use std::fmt;
use std::path::{Path, PathBuf};

/// Result of everything that reads or checks an input.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Why an input cannot be used.
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
    /// A file does not follow its format (TOML, JSON, OBJ).
    #[error("{}: {}", file.display(), shortened(message))]
    Format {
        /// The file.
        file: PathBuf,
        /// What the parser says, with key or line and column.
        message: String,
    },
    /// A file or folder cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// A configuration in which a spring has no direction.
    #[error(transparent)]
    DegenerateSpring(#[from] DegenerateSpring),
    /// Something does not fit the memory, limits included: nothing of it was allocated.
    #[error("{what} takes {}, and there is room for {}", readable(*bytes), readable(*room))]
    TooLarge {
        /// What.
        what: &'static str,
        /// About how many bytes it takes.
        bytes: u64,
        /// How many there are.
        room: u64,
    },
    /// A scene that there is no reader or no recipe for.
    #[error("{0}")]
    Scene(String),
    /// What was asked for does not exist in this combination.
    #[error("{0}")]
    Unsupported(String),
    /// The command's arguments do not fit together or do not fit the scene.
    #[error("{0}")]
    Usage(String),
}

impl Error {
    /// Wraps an operating-system error with the path that it is about.
    pub fn io(path: impl Into<PathBuf>, source: std::io::Error) -> Self {
        Self::Io { path: path.into(), source }
    }

    /// Names the file in which an invalid value or a degenerate spring stands, unless one is named already; leaves
    /// every other error as it is.
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

/// Refuses a vector of the wrong length.
pub(crate) fn check_length(name: &str, found: usize, expected: usize) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    Err(Invalid::new(name, format!("{found} entries"), format!("must have {expected}")).into())
}

/// Bytes as people read them.
fn readable(bytes: u64) -> String {
    let bytes = bytes as f64;
    match bytes {
        _ if bytes < 1e6 => format!("{:.1} kB", bytes / 1e3),
        _ if bytes < 1e9 => format!("{:.1} MB", bytes / 1e6),
        _ => format!("{:.1} GB", bytes / 1e9),
    }
}

/// Characters of a text that a message quotes at most at each end.
const QUOTED: usize = 200;

/// A text as a message quotes it. What is wrong with a file may be as long as the file; its beginning and its end, which has the
/// position, tell enough.
fn shortened(text: &str) -> std::borrow::Cow<'_, str> {
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
///
/// # Examples
/// ```
/// use sprung::error::Invalid;
///
/// let invalid = Invalid::new("particles.masses", -1, "must be finite and positive").at(3);
/// assert_eq!(invalid.to_string(), "particles.masses[3] = -1: must be finite and positive");
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Invalid {
    /// The file, where there is one.
    pub file: Option<PathBuf>,
    /// The scene's key in dotted form, for example `particles.masses`.
    pub key: String,
    /// Position in the list that the key names.
    pub index: Option<usize>,
    /// The offending value as text.
    pub value: String,
    /// The rule that it breaks.
    pub rule: String,
}

/// Numbers of more characters are written with an exponent.
const PLAIN: usize = 24;

impl Invalid {
    /// An invalid value of `key`, to be completed by [`at`](Self::at).
    pub fn new(key: impl Into<String>, value: impl fmt::Display, rule: impl Into<String>) -> Self {
        Self { file: None, key: key.into(), index: None, value: value.to_string(), rule: rule.into() }
    }

    /// Says at which index of the list the value stands.
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
        let value = match self.value.parse::<f64>() {
            // Of many zeros nobody counts how many.
            Ok(number) if self.value.len() > PLAIN => format!("{number:e}").into(),
            _ => shortened(&self.value),
        };
        write!(f, " = {value}: {}", shortened(&self.rule))
    }
}

impl std::error::Error for Invalid {}

/// A spring whose ends coincide: its direction, and with it force and stiffness, do not exist.
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
    use super::{Error, Invalid, readable};

    #[test]
    fn small_and_large_numbers_are_readable() {
        for (value, expected) in
            [(-1e-300, "k = -1e-300: no"), (1e300, "k = 1e300: no"), (0.1234567890123456, "k = 0.1234567890123456: no")]
        {
            assert_eq!(Invalid::new("k", value, "no").to_string(), expected);
        }
    }

    /// Texts of any length make messages of a few lines, with both ends of the text.
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

    #[test]
    fn bytes_are_readable() {
        assert_eq!([999, 1_500_000, 3_400_000_000].map(readable), ["1.0 kB", "1.5 MB", "3.4 GB"]);
    }
}
