//! Which life of which node somebody is, and whose guest.

/// Which life of which node an actor is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Identity {
    pub(crate) node: u16,
    pub(crate) life: u16,
    /// The hub that it calls.
    pub(crate) hub: u16,
    /// The hub that it belongs to.
    pub(crate) home: u16,
    /// Whether the hub that it calls may let it in: who mistakes an address has the credentials of another hub.
    pub(crate) invited: bool,
}
