//! The network in a box: the same hub and satellites as everywhere, any number of them in one process, under one
//! virtual clock and one seed, over a network, disks and machines that fail.
//!
//! - [`generate`] makes a [`Script`](script::Script) from a seed: who takes part, and what happens when;
//! - [`run`](run::run) runs a script and judges it by the [rules](rule::Rule);
//! - [`shrink`](shrink::shrink) deletes from a script that breaks a rule what is not needed for it.
//!
//! ```
//! use sk_sim::{generate, run::run};
//!
//! let script = generate::script(1);
//! let outcome = run(&script);
//! assert_eq!(outcome.complaint, None);
//! assert_eq!(outcome, run(&script), "the same seed, the same run");
//! ```
#![forbid(unsafe_code)]

pub mod action;
mod actors;
mod address;
mod archive;
mod channels;
mod checks;
mod files;
pub mod generate;
mod identity;
mod latest;
mod ledger;
mod lives;
pub mod log;
mod look;
mod pace;
mod parts;
pub mod rule;
pub mod run;
pub mod script;
pub mod shrink;
pub mod stamp;
mod start;
mod wishes;
mod words;
