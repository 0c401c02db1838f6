//! Where a module is in its life, and what its operator sees of it.

use crate::module::{ParameterInfo, ThreadPlace};
use sk_flat::{Instant, SkVariant};
use std::fmt;

/// Where a module is in its life.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ModuleState {
    /// It is being made or started on its thread, which has not answered yet.
    Beginning,
    /// It exists and was not started yet.
    Made,
    /// It was started.
    Running,
    /// It could not be made or started, or it died.
    Failed {
        /// Why.
        reason: String,
        /// When it is begun again; never, if there is none.
        retry_at: Option<Instant>,
    },
    /// Its thread was told to end and has not yet.
    Stopping,
    /// Its thread was told to end and did not in time: one of its slots hangs. The hub goes on without it; if
    /// the thread ends after all, the module is stopped.
    Stuck,
    /// It was stopped, or was never made.
    Stopped,
}

impl fmt::Display for ModuleState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ModuleState::Beginning => f.write_str("beginning"),
            ModuleState::Made => f.write_str("made"),
            ModuleState::Running => f.write_str("running"),
            ModuleState::Failed { reason, retry_at: Some(_) } => write!(f, "failed, tried again: {reason}"),
            ModuleState::Failed { reason, retry_at: None } => write!(f, "failed, given up: {reason}"),
            ModuleState::Stopping => f.write_str("stopping"),
            ModuleState::Stuck => f.write_str("stuck: its thread does not end"),
            ModuleState::Stopped => f.write_str("stopped"),
        }
    }
}

/// All that an operator sees of a module.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ModuleStatus {
    /// What it is called here.
    pub name: String,
    /// Where it is in its life.
    pub state: ModuleState,
    /// How its own thread keeps time; none if it lives on the loop of the hub.
    pub thread: Option<ThreadPlace>,
    /// How often it was begun again after a failure.
    pub restarts: u64,
    /// Why it failed the last time, also when it has run since.
    pub last_error: Option<String>,
    /// How often it kept its loop busy for longer than a tenth of a second.
    pub late: u64,
    /// Its thread does not answer at present.
    pub silent: bool,
    /// What it has been told, as a map.
    pub parameters: SkVariant,
    /// What it can be told.
    pub declared: &'static [ParameterInfo],
}
