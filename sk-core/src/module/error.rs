//! What can go wrong with a module, as its operator reads it.

use crate::module::ParameterError;
use crate::object::Access;

/// Why a module did not do what it was asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModuleError {
    /// A parameter was refused before the module saw it. Nothing has changed.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The module answered an error. After `reconfigure` and `control` it goes on as before.
    #[error("{step} failed: {message}")]
    Failed {
        /// The step: `new`, `start`, `reconfigure`, `control`.
        step: &'static str,
        /// The module's words.
        message: String,
    },
    /// The module panicked; the loop's policy says what becomes of it.
    #[error("{step} panicked: {message}")]
    Panicked {
        /// The step.
        step: &'static str,
        /// What the panic says.
        message: String,
    },
    /// The module does not run: it was not started yet, was stopped, or has failed.
    #[error("the module does not run")]
    NotRunning,
    /// The module is in the middle of something: ask again in the next round.
    #[error("the module is busy: one of its slots is running")]
    Busy,
    /// The module lives on a thread of its own, so its answer takes a while: it is told by
    /// [`ask`](crate::Handle#method.ask).
    #[error("the module lives on a thread of its own: ask it, and take the answer when it comes")]
    OnThread,
    /// There is no such module any more.
    #[error("the module is gone")]
    Gone,
}

impl From<Access> for ModuleError {
    fn from(access: Access) -> ModuleError {
        match access {
            Access::Busy => ModuleError::Busy,
            Access::Gone => ModuleError::Gone,
        }
    }
}
