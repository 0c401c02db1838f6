//! Go-back-N: numbered envelopes go again, all from the first that is missing, until they are acknowledged.

use super::envelope::Kind;
use sk_flat::Instant;
use std::collections::VecDeque;

/// How many numbered envelopes may be under way.
pub(super) const WINDOW: usize = 7;

/// A numbered envelope that was not acknowledged yet.
#[derive(Debug)]
pub(super) struct Numbered {
    pub(super) kind: Kind,
    pub(super) stream: u8,
    pub(super) payload: Vec<u8>,
}

/// Both directions' counters of one life of the line.
#[derive(Debug)]
pub(super) struct Window {
    /// The number of the first in `sent`.
    base: u8,
    sent: VecDeque<Numbered>,
    bytes: usize,
    /// How many of `sent` have gone out since the last time of going back.
    gone: usize,
    /// The number that comes next from the peer.
    expected: u8,
    /// When something was last acknowledged, or the first of `sent` was put there.
    pub(super) moved: Instant,
    /// When sending last began anew.
    pub(super) tried: Instant,
    /// How far ahead of `expected` the last one stood that came out of turn, 0 for none.
    ahead: u8,
}

/// What a number from the peer is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turn {
    /// The one that was expected.
    Next,
    /// Known already: its acknowledgement was lost.
    Old,
    /// One before it is missing. New unless it only follows others that came out of turn: when sending has
    /// begun anew and the missing one was lost again, that is new too.
    Gap { new: bool },
}

impl Window {
    pub(super) fn new(now: Instant) -> Window {
        Window {
            base: 0,
            sent: VecDeque::new(),
            bytes: 0,
            gone: 0,
            expected: 0,
            moved: now,
            tried: now,
            ahead: 0,
        }
    }

    pub(super) fn expected(&self) -> u8 {
        self.expected
    }

    pub(super) fn is_empty(&self) -> bool {
        self.sent.is_empty()
    }

    pub(super) fn has_room(&self, bytes_max: usize) -> bool {
        self.sent.len() < WINDOW && (self.bytes < bytes_max || self.sent.is_empty())
    }

    pub(super) fn push(&mut self, numbered: Numbered, now: Instant) {
        if self.sent.is_empty() {
            (self.moved, self.tried) = (now, now);
        }
        self.bytes += numbered.payload.len();
        self.sent.push_back(numbered);
    }

    /// The next one to go out, with its number.
    pub(super) fn next(&mut self) -> Option<(u8, &Numbered)> {
        let numbered = self.sent.get(self.gone)?;
        let number = self.base.wrapping_add(self.gone as u8);
        self.gone += 1;
        Some((number, numbered))
    }

    /// Whether one waits to go out.
    pub(super) fn has_next(&self) -> bool {
        self.gone < self.sent.len()
    }

    /// The peer expects `ack` next. Whether that is news.
    pub(super) fn acknowledged(&mut self, ack: u8, now: Instant) -> bool {
        let count = usize::from(ack.wrapping_sub(self.base));
        if count == 0 || count > self.sent.len() {
            // An old one, delayed or repeated by the line.
            return false;
        }
        let done: usize = self.sent.drain(..count).map(|numbered| numbered.payload.len()).sum();
        self.bytes -= done;
        self.base = ack;
        self.gone = self.gone.saturating_sub(count);
        (self.moved, self.tried) = (now, now);
        true
    }

    /// The peer misses what comes at `ack`: all from there go again. Whether there was anything.
    pub(super) fn again(&mut self, ack: u8, now: Instant) -> bool {
        let is_missing = ack == self.base && self.gone > 0;
        if is_missing {
            self.go_back(now);
        }
        is_missing
    }

    pub(super) fn go_back(&mut self, now: Instant) {
        self.gone = 0;
        self.tried = now;
    }

    /// What a number from the peer means; the expected one is counted.
    pub(super) fn arrived(&mut self, number: u8) -> Turn {
        match number.wrapping_sub(self.expected) {
            0 => {
                self.expected = self.expected.wrapping_add(1);
                self.ahead = 0;
                Turn::Next
            }
            ahead if usize::from(ahead) < WINDOW => {
                let before = std::mem::replace(&mut self.ahead, ahead);
                Turn::Gap { new: before == 0 || ahead <= before }
            }
            _ => Turn::Old,
        }
    }
}
