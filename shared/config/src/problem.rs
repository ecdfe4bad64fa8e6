//! What is wrong with a configuration, and where.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

/// Where a value was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// In a file, at this line (from 1).
    File {
        /// The file as the user named it, or `robot NAME` for a built-in robot.
        name: Arc<str>,
        /// From 1.
        line: usize,
    },
    /// On the command line: the argument as it was given.
    Argument(Arc<str>),
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File { name, line } => write!(f, "{name}:{line}"),
            Self::Argument(argument) => f.write_str(argument),
        }
    }
}

/// One thing that is wrong, in one line: where, which key, its value, what was expected.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Where the value was written; none when nothing was.
    pub origin: Option<Origin>,
    /// The key with its tables (`mapper.resolution_m`); empty when it is not about a key.
    pub key: String,
    /// What was given, as TOML; none when the value is not to blame.
    pub value: Option<String>,
    /// What is wrong and what would be right.
    pub message: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(origin) = &self.origin {
            write!(f, "{origin}: ")?;
        }
        if !self.key.is_empty() {
            f.write_str(&self.key)?;
            if let Some(value) = &self.value {
                write!(f, " = {value}")?;
            }
            f.write_str(": ")?;
        }
        f.write_str(&self.message)
    }
}

/// Why there is no configuration.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// A file can't be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file as the user named it.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The working directory, which relative paths need, is not known.
    #[error("the working directory: {0}")]
    WorkingDirectory(std::io::Error),
    /// What was written does not make sense; everything that was found, one line each.
    #[error("{}", lines(.0))]
    Invalid(Vec<Problem>),
    /// A configuration made by a program can't be written as TOML.
    #[error("the configuration can't be written: {0}")]
    Write(#[from] toml::ser::Error),
}

impl ConfigError {
    /// What was found, if what was written is to blame.
    #[must_use]
    pub fn problems(&self) -> &[Problem] {
        match self {
            Self::Invalid(problems) => problems,
            _ => &[],
        }
    }
}

fn lines(problems: &[Problem]) -> String {
    problems.iter().map(Problem::to_string).collect::<Vec<_>>().join("\n")
}
