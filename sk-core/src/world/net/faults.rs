//! What is wrong with the ways between simulated machines.

use super::wire::Delivery;
use crate::world::{Rng, SimulatedRng};
use std::collections::BTreeMap;
use std::time::Duration;

/// How one way between two simulated machines misbehaves. The default is a way without fault.
///
/// Streams keep their order and lose nothing whatever stands here; they are late, in other pieces than they
/// were written in, refused or cut off. Datagrams are lost, doubled and overtaken as well.
///
/// ```
/// use sk_core::world::{LinkFaults, SimulatedWorld};
/// use std::time::Duration;
///
/// let hub = SimulatedWorld::new(1);
/// let satellite = hub.machine();
/// let slow = LinkFaults { delay: Duration::from_millis(80), ..LinkFaults::default() };
/// hub.set_link(hub.machine_number(), satellite.machine_number(), slow);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkFaults {
    /// Added to the latency of everything.
    pub delay: Duration,
    /// Up to this much is added besides, drawn anew each time. Datagrams may overtake each other by it.
    pub jitter_max: Duration,
    /// How many datagrams of 1024 are lost.
    pub loss: u16,
    /// How many datagrams of 1024 come twice.
    pub duplication: u16,
    /// No piece of a stream that is written or arrives at once is longer, and each is cut at a place drawn
    /// anew; 0 leaves them whole. Of one write only the first pieces are cut, to bound the work.
    pub piece_bytes_max: usize,
    /// Wishes to connect are refused, as by a listener that has no room.
    pub refuse: bool,
}

/// One thing that a partition holds back.
#[derive(Debug)]
pub(super) struct Held {
    /// The stream's end that sent it: what it sends later must not overtake.
    pub(super) from: Option<super::wire::SocketId>,
    pub(super) what: Delivery,
}

#[derive(Debug, Default)]
struct Way {
    faults: LinkFaults,
    held: Option<Vec<Held>>,
}

/// The ways that are not in order, by the machines at their ends.
#[derive(Debug, Default)]
pub(super) struct Ways {
    ways: BTreeMap<(usize, usize), Way>,
}

/// How many pieces of one write are cut by chance; what is left goes in one.
const PIECES_MAX: usize = 8;

impl Ways {
    /// Whether every way is in order, so that nobody needs to look.
    pub(super) fn are_fine(&self) -> bool {
        self.ways.is_empty()
    }

    pub(super) fn faults(&self, from: usize, to: usize) -> LinkFaults {
        self.ways.get(&(from, to)).map(|way| way.faults).unwrap_or_default()
    }

    pub(super) fn set(&mut self, from: usize, to: usize, faults: LinkFaults) {
        self.ways.entry((from, to)).or_default().faults = faults;
        self.forget_if_fine(from, to);
    }

    pub(super) fn part(&mut self, from: usize, to: usize) {
        self.ways.entry((from, to)).or_default().held.get_or_insert_with(Vec::new);
    }

    /// Ends a partition; what it held back is the caller's to send on.
    pub(super) fn heal(&mut self, from: usize, to: usize) -> Vec<Held> {
        let held = self.ways.get_mut(&(from, to)).and_then(|way| way.held.take());
        self.forget_if_fine(from, to);
        held.unwrap_or_default()
    }

    /// Holds something back if there is a partition; else it is the caller's to send.
    pub(super) fn hold(&mut self, from: usize, to: usize, thing: Held) -> Option<Held> {
        match self.ways.get_mut(&(from, to)).and_then(|way| way.held.as_mut()) {
            // A datagram that finds no way is lost.
            Some(_) if matches!(thing.what, Delivery::Datagram { .. }) => None,
            Some(held) => {
                held.push(thing);
                None
            }
            None => Some(thing),
        }
    }

    /// Drops what is held back and fulfils `gone`.
    pub(super) fn forget(&mut self, gone: impl Fn(&Delivery) -> bool) {
        for held in self.ways.values_mut().filter_map(|way| way.held.as_mut()) {
            held.retain(|held| !gone(&held.what));
        }
    }

    fn forget_if_fine(&mut self, from: usize, to: usize) {
        let fine = |way: &Way| way.held.is_none() && way.faults == LinkFaults::default();
        if self.ways.get(&(from, to)).is_some_and(fine) {
            self.ways.remove(&(from, to));
        }
    }
}

impl LinkFaults {
    /// How much longer the next passage takes.
    pub(super) fn lateness(&self, rng: &mut SimulatedRng) -> Duration {
        let jitter_ns = u64::try_from(self.jitter_max.as_nanos()).unwrap_or(u64::MAX);
        let jitter = if jitter_ns == 0 { 0 } else { rng.below(jitter_ns.saturating_add(1)) };
        self.delay + Duration::from_nanos(jitter)
    }

    /// How many copies of a datagram arrive.
    pub(super) fn copies(&self, rng: &mut SimulatedRng) -> usize {
        if chance(rng, self.loss) {
            return 0;
        }
        1 + usize::from(chance(rng, self.duplication))
    }

    /// How many of `wanted` bytes one write takes.
    pub(super) fn write_limit(&self, wanted: usize, rng: &mut SimulatedRng) -> usize {
        if self.piece_bytes_max == 0 || chance(rng, 256) {
            return wanted;
        }
        // Large writes are not cut to shreds: a 64th of them is the least.
        let most = self.piece_bytes_max.max(wanted / 64) as u64;
        wanted.min(1 + rng.below(most) as usize)
    }

    /// Cuts what was written at once into what arrives at once.
    pub(super) fn cut(&self, mut bytes: Vec<u8>, rng: &mut SimulatedRng) -> Vec<Vec<u8>> {
        let mut pieces = Vec::new();
        while self.piece_bytes_max > 0 && pieces.len() < PIECES_MAX && bytes.len() > 1 {
            let length = 1 + rng.below(self.piece_bytes_max.min(bytes.len() - 1) as u64) as usize;
            let rest = bytes.split_off(length);
            pieces.push(std::mem::replace(&mut bytes, rest));
        }
        pieces.push(bytes);
        pieces
    }
}

fn chance(rng: &mut SimulatedRng, of_1024: u16) -> bool {
    of_1024 > 0 && rng.next_u64() % 1024 < u64::from(of_1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_join_to_what_was_written_and_are_cut_at_any_byte() {
        let faults = LinkFaults { piece_bytes_max: 5, ..LinkFaults::default() };
        let mut rng = SimulatedRng::new(1, 0);
        let whole: Vec<u8> = (0..40).collect();
        let mut firsts = std::collections::BTreeSet::new();
        for _ in 0..200 {
            let pieces = faults.cut(whole.clone(), &mut rng);
            assert_eq!(pieces.concat(), whole);
            assert!(pieces.len() <= PIECES_MAX + 1 && pieces.iter().all(|piece| !piece.is_empty()));
            firsts.insert(pieces[0].len());
        }
        assert_eq!(firsts, (1..=5).collect());
    }

    #[test]
    fn a_way_that_is_in_order_again_is_forgotten() {
        let mut ways = Ways::default();
        ways.set(0, 1, LinkFaults { refuse: true, ..LinkFaults::default() });
        ways.part(0, 1);
        ways.set(0, 1, LinkFaults::default());
        assert!(!ways.are_fine());
        assert!(ways.heal(0, 1).is_empty() && ways.are_fine());
    }
}
