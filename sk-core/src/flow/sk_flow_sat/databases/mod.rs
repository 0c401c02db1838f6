//! A hub's databases for a satellite: the object that stands for one, and what is under way with the hub.

pub(super) mod clerk;
pub(super) mod database;

pub use database::{FlowDatabase, Variable};
