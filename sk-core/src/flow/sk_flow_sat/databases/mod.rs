//! A hub's databases for a satellite: the object that stands for one, and what is under way with the hub.

pub(super) mod clerk;
pub(super) mod commands;
mod object;

pub use object::{FlowDatabase, Variable};
