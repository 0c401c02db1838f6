//! A satellite's core as its link sees it, and what breaks a link.

use crate::flow::satellite::SatelliteCore;
use crate::flow::transport::{Broken, Core, Link};
use crate::flow::wire::Slices;
use crate::flow::{Encoded, ProtocolError};
use sk_flat::Instant;
use std::io::{self, ErrorKind};

/// The core of a satellite's connection.
pub(super) struct Side<'a> {
    pub(super) core: &'a mut SatelliteCore,
    pub(super) now: Instant,
    pub(super) waiting: &'a mut Option<Encoded>,
    /// The first one counts: what comes after it is a consequence.
    pub(super) fault: &'a mut Option<Fault>,
}

/// What broke a link, other than that it ended.
pub(super) struct Fault {
    pub(super) why: String,
    /// Somebody answered, but is no hub that can be talked to.
    pub(super) is_unusable: bool,
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Fault {
        Fault { why: error.to_string(), is_unusable: error.kind() == ErrorKind::InvalidData }
    }
}

impl Side<'_> {
    fn broken(&mut self, error: &ProtocolError) -> Broken {
        tracing::error!("the hub sent what no hub sends: {error}");
        let why = format!("what answers there is no hub: {error}");
        self.fault.get_or_insert(Fault { why, is_unusable: true });
        Broken
    }
}

impl Core for Side<'_> {
    fn wants_input(&self) -> bool {
        true
    }
    fn bytes(&mut self, bytes: &[u8]) -> Result<(), Broken> {
        self.core.receive(bytes, self.now).map_err(|error| self.broken(&error))
    }
    fn frame(&mut self, frame: Encoded) -> Result<(), Broken> {
        self.core.accept(frame, self.now).map_err(|error| self.broken(&error))
    }
    fn has_output(&self) -> bool {
        self.core.has_output()
    }
    fn slices(&mut self, parts_max: usize) -> Slices<'_> {
        self.core.slices(parts_max)
    }
    fn wrote(&mut self, count: usize) {
        self.core.wrote(count);
    }
    fn take(&mut self) -> Option<Encoded> {
        self.core.take()
    }
    fn put_back(&mut self, frame: Encoded) {
        *self.waiting = Some(frame);
    }
    fn put_back_first(&mut self) -> Option<Encoded> {
        self.waiting.take()
    }
}

/// Keeps what broke a link, unless something was kept before.
pub(super) fn note_fault(fault: &mut Option<Fault>, link: &mut dyn Link) {
    if let Some(error) = link.fault() {
        fault.get_or_insert(error.into());
    }
}
