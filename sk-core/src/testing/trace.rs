//! The record by which two runs are told apart.

use sk_flat::Instant;
use std::cell::Cell;
use std::rc::Rc;

/// A folded record of everything the loops of a simulation did.
#[derive(Clone)]
pub(crate) struct Trace {
    pub(super) hash: Rc<Cell<u64>>,
    pub(super) ordinal: u64,
}

impl Trace {
    fn note(&self, parts: [u64; 4]) {
        // FNV-1a over words: it need only tell two runs apart.
        let mut hash = self.hash.get() ^ self.ordinal;
        for part in parts {
            hash = (hash ^ part).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23);
        }
        self.hash.set(hash);
    }

    pub(crate) fn round(&self, now: Instant, round: u64, tick: u64) {
        self.note([1, now.as_nanos(), round, tick]);
    }

    pub(crate) fn call(&self, object: u64, slot: u64, calls: u64) {
        self.note([2, object, slot, calls]);
    }
}
