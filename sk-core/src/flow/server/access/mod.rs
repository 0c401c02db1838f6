//! Who is let in, and what each may do: logging in, accounts, sessions, permission and what ends without it.

pub(super) mod accounts;
pub(super) mod login;
pub(super) mod permission;
mod revocation;
pub(super) mod sessions;
