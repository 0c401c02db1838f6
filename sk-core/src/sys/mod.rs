//! The only place with system calls and the only place with `unsafe`.
