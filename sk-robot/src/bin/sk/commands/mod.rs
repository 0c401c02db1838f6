//! The commands, a file or a folder each.

pub mod blob;
pub mod call;
pub mod completions;
pub mod database;
pub mod doctor;
pub mod echo;
pub mod graph;
pub mod hz;
pub mod info;
pub mod ls;
pub mod module;
pub mod publish;
pub mod user;
pub mod why;
