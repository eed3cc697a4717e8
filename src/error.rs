//! The crate's error: what made an input unusable, and where.
//!
//! An [`Error`] always means that nothing was computed. A computation that starts and then breaks down is not an
//! error but an outcome with a status, see [`StepFailure`](crate::integrate::StepFailure).

use std::fmt;
use std::path::{Path, PathBuf};

/// Result of everything that reads or checks an input.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Why an input cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A value in a scene, or given to a [`SystemBuilder`](crate::SystemBuilder), breaks a rule.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// A file does not follow its format (TOML, JSON, OBJ).
    #[error("{}: {message}", file.display())]
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

/// A value that breaks a rule: file, key, index, value and the rule.
///
/// Displays as `scene.toml: particles.masses[3] = -1: must be finite and positive`.
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
        write!(f, "{}", self.key)?;
        if let Some(index) = self.index {
            write!(f, "[{index}]")?;
        }
        write!(f, " = {}: {}", self.value, self.rule)
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
