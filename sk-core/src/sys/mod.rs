//! The only place with system calls beyond those of std and mio, and the only place with `unsafe`.
//!
//! Each file wraps one subject in safe functions. Everything that nix offers safely is taken from there;
//! the blocks that remain stand in [`random`] and [`sched`]. Beside them stand the two shapes of memory that safe
//! Rust cannot say and every slot call goes through: [`lease`] and [`role`].

pub(crate) mod beneath;
pub(crate) mod descriptors;
pub(crate) mod heap;
pub(crate) mod latency;
pub(crate) mod lease;
pub(crate) mod memory;
pub(crate) mod random;
pub(crate) mod role;
pub(crate) mod sched;
pub(crate) mod signal;
pub(crate) mod timer;
pub(crate) mod tty;
pub(crate) mod unix;
