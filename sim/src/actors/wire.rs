//! What a core has to say, on its way into a socket.

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
