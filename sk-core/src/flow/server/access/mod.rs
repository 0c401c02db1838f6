//! Who is let in, and what each may do: logging in, accounts, sessions, permission.

pub(super) mod accounts;
pub(super) mod login;
pub(super) mod permission;
pub(super) mod sessions;
