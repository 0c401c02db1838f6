//! The only place with system calls beyond those of std and mio, and the only place with `unsafe`.
//!
//! Each file wraps one subject in safe functions. Everything that nix offers safely is taken from there;
//! the blocks that remain stand in [`random`] and [`sched`].

pub(crate) mod heap;
pub(crate) mod latency;
pub(crate) mod memory;
pub(crate) mod random;
pub(crate) mod sched;
pub(crate) mod signal;
pub(crate) mod timer;
pub(crate) mod tty;
pub(crate) mod unix;
