//! What a core has to say, on its way into a socket, and what the hub says, on its way out of one.

use crate::ledger;
use crate::rule::Rule;
use sk_core::flow::satellite::SatelliteCore;
use sk_core::flow::wire::WRITE_PARTS_MAX;
use sk_core::prelude::*;

/// Writes what there is; what waits in the socket goes first, so that it does not gather there.
pub(super) fn flush(cx: &mut Cx, core: &mut SatelliteCore, socket: Handle<Socket>) {
    while core.has_output() && socket.queued_bytes(cx) == Ok(0) {
        let slices = core.slices(WRITE_PARTS_MAX);
        let bytes: Vec<u8> = slices.iter().flat_map(|slice| slice.iter().copied()).collect();
        let count = bytes.len();
        drop(slices);
        if count == 0 || socket.write(cx, bytes).is_err() {
            return;
        }
        core.wrote(count);
    }
}

/// The most that is read at once, in bytes.
pub(super) const ROOM: usize = 16 * 1024;

/// What there was to read.
pub(super) enum Heard {
    Nothing,
    /// The core may have events now.
    Something,
    /// The hub broke the protocol, which is noted: this link is over.
    Nonsense,
}

/// Reads once, `most` bytes at most; `node` is who listens.
pub(super) fn hear(
    cx: &mut Cx,
    core: &mut SatelliteCore,
    socket: Handle<Socket>,
    most: usize,
    node: u16,
) -> Heard {
    let mut room = [0; ROOM];
    let Ok(count @ 1..) = socket.read(cx, &mut room[..most.min(ROOM)]) else { return Heard::Nothing };
    match core.receive(&room[..count], cx.now()) {
        Ok(()) => Heard::Something,
        Err(error) => {
            let text = format!("n{node}: the hub sent what no hub sends: {error}");
            ledger::with(|ledger| ledger.complain(Rule::Honest, text));
            Heard::Nonsense
        }
    }
}
