//! Bugs that a simulation can switch on, to show that it would find them.
//!
//! Without the feature `planted-bugs` none of them exists: the question whether one is switched on is a constant.

/// A known mistake. Each breaks a promise of the flow network in a way of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Bug {
    /// A message that its publisher gave up is offered to the books, and never dropped from them.
    AbortUnbooked,
    /// A reference to a channel that is gone finds the next bearer of its identifier.
    StaleEpoch,
    /// A channel keeps a subscriber whose connection has ended.
    SubscriptionKept,
    /// Commands are carried out without asking for the right to them.
    RightsSkipped,
    /// While one peer takes nothing, those behind it wait.
    StuckPeerBlocks,
    /// The last of the waiting messages goes first.
    NewestFirst,
    /// Some messages are offered a second time when they go out.
    SentTwice,
    /// Publishing on a channel that has just gone is taken for dishonest.
    RaceIsSpurious,
    /// A satellite that found its hub again does not ask for its subscriptions.
    SubscriptionsForgotten,
    /// A connection whose peer has vanished is kept.
    SilenceForgiven,
    /// A fragment of a message that came in several loses a byte.
    ByteLost,
    /// A hub panics at a command that it refuses.
    PanicAtRefusal,
    /// Those who wait for a service are not told that it is gone.
    OwnerGoneUntold,
    /// A request stays open after its last answer.
    AnswerKeepsRequest,
    /// What is to be kept is acknowledged while the disk still has it to do.
    AckBeforeSync,
    /// Some changes of a variable are not told to those who watch it.
    WatchForgotten,
    /// A damaged store is thrown away, and nobody is told.
    DamageUntold,
    /// What the owner of a reliable channel publishes is dropped though there was credit for it.
    CreditBroken,
    /// A channel that opens is not told to everybody.
    ChannelUntold,
    /// Some ticks that a target misses are not counted.
    MissUncounted,
    /// A target that is divided down is told that it still gets every tick.
    DivisorUntold,
    /// Some messages are not kept for those who come later, and an older one is.
    LatchStale,
    /// Some messages are not kept for those who poll, and an older one is.
    PollStale,
    /// A file that was uploaded is put in its place before the disk has it.
    BlobUnsynced,
    /// A datagram that comes a second time is taken a second time.
    ReplayTaken,
    /// Datagrams of one message are joined though one between them is missing.
    GapJoined,
    /// What a WebSocket took and could not pass on at once is sent again.
    WebSentTwice,
    /// Neither side asks whether the other one knows the token.
    TokenUnchecked,
}

impl Bug {
    /// All of them, with their names for command lines.
    pub const ALL: [(Bug, &'static str); 28] = [
        (Bug::AbortUnbooked, "abort-unbooked"),
        (Bug::StaleEpoch, "stale-epoch"),
        (Bug::SubscriptionKept, "subscription-kept"),
        (Bug::RightsSkipped, "rights-skipped"),
        (Bug::StuckPeerBlocks, "stuck-peer-blocks"),
        (Bug::NewestFirst, "newest-first"),
        (Bug::SentTwice, "sent-twice"),
        (Bug::RaceIsSpurious, "race-is-spurious"),
        (Bug::SubscriptionsForgotten, "subscriptions-forgotten"),
        (Bug::SilenceForgiven, "silence-forgiven"),
        (Bug::ByteLost, "byte-lost"),
        (Bug::PanicAtRefusal, "panic-at-refusal"),
        (Bug::OwnerGoneUntold, "owner-gone-untold"),
        (Bug::AnswerKeepsRequest, "answer-keeps-request"),
        (Bug::AckBeforeSync, "ack-before-sync"),
        (Bug::WatchForgotten, "watch-forgotten"),
        (Bug::DamageUntold, "damage-untold"),
        (Bug::CreditBroken, "credit-broken"),
        (Bug::ChannelUntold, "channel-untold"),
        (Bug::MissUncounted, "miss-uncounted"),
        (Bug::DivisorUntold, "divisor-untold"),
        (Bug::LatchStale, "latch-stale"),
        (Bug::PollStale, "poll-stale"),
        (Bug::BlobUnsynced, "blob-unsynced"),
        (Bug::ReplayTaken, "replay-taken"),
        (Bug::GapJoined, "gap-joined"),
        (Bug::WebSentTwice, "web-sent-twice"),
        (Bug::TokenUnchecked, "token-unchecked"),
    ];
}

#[cfg(feature = "planted-bugs")]
thread_local! {
    static PLANTED: std::cell::Cell<Option<Bug>> = const { std::cell::Cell::new(None) };
}

/// Switches one bug on for what runs on this thread, or all off.
#[cfg(feature = "planted-bugs")]
pub fn plant(bug: Option<Bug>) {
    PLANTED.set(bug);
}

/// Whether that bug is switched on.
#[cfg(feature = "planted-bugs")]
pub(crate) fn is_planted(bug: Bug) -> bool {
    PLANTED.get() == Some(bug)
}

/// Whether that bug is switched on: never, in this build.
#[cfg(not(feature = "planted-bugs"))]
#[inline(always)]
pub(crate) const fn is_planted(_: Bug) -> bool {
    false
}
