//! What is wrong with a configuration, and where.

use std::fmt;
use std::path::{Path, PathBuf};

/// One thing that is wrong, with its place in the file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Problem {
    /// The line, counted from 1.
    pub line: usize,
    /// The column, counted from 1.
    pub column: usize,
    /// What is wrong, and what would be right.
    pub what: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.line, self.column, self.what)
    }
}

/// Why a configuration was refused, as a whole.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigError {
    file: Option<PathBuf>,
    kind: Kind,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Kind {
    Unreadable(String),
    Problems(Vec<Problem>),
}

impl ConfigError {
    /// The problems must be at least one.
    pub(super) fn problems_of(mut problems: Vec<Problem>) -> ConfigError {
        problems.sort();
        ConfigError { file: None, kind: Kind::Problems(problems) }
    }

    pub(super) fn unreadable(file: &Path, why: impl fmt::Display) -> ConfigError {
        ConfigError { file: Some(file.to_owned()), kind: Kind::Unreadable(why.to_string()) }
    }

    pub(super) fn in_file(self, file: &Path) -> ConfigError {
        ConfigError { file: Some(file.to_owned()), ..self }
    }

    /// All that is wrong, in the order of the file; nothing if the file cannot be read at all.
    pub fn problems(&self) -> &[Problem] {
        match &self.kind {
            Kind::Problems(problems) => problems,
            Kind::Unreadable(_) => &[],
        }
    }
}

/// A line for each problem, as compilers write it: `file:line:column: what`.
impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let file = self.file.as_deref().map(|file| file.display().to_string());
        let file = file.as_deref().unwrap_or("configuration");
        match &self.kind {
            Kind::Unreadable(why) => write!(f, "cannot read the configuration {file}: {why}"),
            Kind::Problems(problems) => {
                for (index, problem) in problems.iter().enumerate() {
                    let newline = if index == 0 { "" } else { "\n" };
                    write!(f, "{newline}{file}:{problem}")?;
                }
                Ok(())
            }
        }
    }
}

impl std::error::Error for ConfigError {}
