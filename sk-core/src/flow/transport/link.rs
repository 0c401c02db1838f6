//! One connection's way, whatever it is made of, and the core of the connection as its way sees it.

use crate::Cx;
use crate::flow::Encoded;
use crate::flow::login::Binding;
use crate::flow::wire::Slices;
use crate::world::Readiness;
use std::io;

/// Bytes taken from one source in one turn.
pub(crate) const TURN_BYTES_MAX: usize = 64 * 1024;

/// The core of a connection, of either side, as a link sees it.
pub(crate) trait Core {
    fn wants_input(&self) -> bool;
    fn bytes(&mut self, bytes: &[u8]) -> Result<(), Broken>;
    fn frame(&mut self, frame: Encoded) -> Result<(), Broken>;
    fn has_output(&self) -> bool;
    fn slices(&mut self, parts_max: usize) -> Slices<'_>;
    fn wrote(&mut self, count: usize);
    fn take(&mut self) -> Option<Encoded>;
    /// A frame that found no room, to be the next one again.
    fn put_back(&mut self, frame: Encoded);
    fn put_back_first(&mut self) -> Option<Encoded>;
}

/// The connection is over on this side: the core has seen what no honest peer sends.
pub(crate) struct Broken;

/// What became of a turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Turn {
    /// Nothing more for now; readiness will tell.
    Done,
    /// Something may be left: come again.
    More,
    /// The core does not want more now; the link is still readable.
    Held,
    /// The link is over.
    Over,
}

/// A transport: it carries what a core has to say to the core at the other end, in order, until one of them is
/// gone. The source that it was made with reports when there may be something to read or room to write.
pub(crate) trait Link {
    /// How long fragments should be at most, where that is less than usual.
    fn fragment_bytes_max(&self) -> Option<u32> {
        None
    }

    /// Whether what waits is to be written at this readiness.
    fn may_write(&self, readiness: Readiness) -> bool;

    /// Whether a link that was begun here has been made.
    ///
    /// # Errors
    /// Why it could not be.
    fn connected(&mut self) -> io::Result<bool>;

    /// Reads what a turn allows.
    fn read(&mut self, cx: &mut Cx, core: &mut dyn Core, room: &mut [u8]) -> Turn;

    /// Writes what there is. `More`: the peer would take more than one round's share.
    fn write(&mut self, cx: &mut Cx, core: &mut dyn Core) -> Turn;

    /// As [`Stream::channel_binding`](crate::world::Stream::channel_binding).
    fn channel_binding(&self) -> Option<Binding> {
        None
    }

    /// Why the link is over, if it is by a fault: `InvalidData` says that the other end answered, and cannot be
    /// talked to.
    fn fault(&mut self) -> Option<io::Error> {
        None
    }

    /// The end: nothing more will be written.
    fn close(self: Box<Self>, cx: &mut Cx);
}
