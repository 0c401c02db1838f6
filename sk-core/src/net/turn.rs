//! How much of a source is taken before the next one has its turn.

/// The turn of one source: what it may still take, and what is known of the rest.
#[derive(Debug)]
pub(super) struct Turn {
    size: usize,
    left: usize,
    /// Something was taken.
    used: bool,
    /// The system had nothing more.
    dry: bool,
    /// The source is being served; otherwise somebody takes from it by himself.
    served: bool,
    round: u64,
}

impl Turn {
    pub(super) const fn of(size: usize) -> Turn {
        Turn { size, left: size, used: false, dry: false, served: false, round: 0 }
    }

    /// The source is served: a new turn.
    pub(super) fn begin(&mut self, round: u64) {
        *self = Turn { served: true, round, ..Turn::of(self.size) };
    }

    /// The service is over. Whether the source is ready still: nobody who took nothing is asked again, else
    /// a source that nobody wants would keep the loop awake.
    pub(super) fn end(&mut self) -> bool {
        self.served = false;
        self.used && !self.dry
    }

    /// How much may be taken now. Outside its service a source has one turn per round.
    pub(super) fn left(&mut self, round: u64) -> usize {
        if !self.served && self.round != round {
            *self = Turn { round, ..Turn::of(self.size) };
        }
        self.left
    }

    pub(super) fn took(&mut self, amount: usize) {
        self.used = true;
        self.left = self.left.saturating_sub(amount);
    }

    pub(super) fn ran_dry(&mut self) {
        self.dry = true;
    }

    pub(super) fn was_used(&self) -> bool {
        self.used
    }

    pub(super) fn is_dry(&self) -> bool {
        self.dry
    }

    /// Whether nobody but the taker knows that he was stopped, so that the source has to be offered again.
    pub(super) fn is_served(&self) -> bool {
        self.served
    }
}
