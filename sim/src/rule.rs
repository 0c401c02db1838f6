//! The rules, and what is said when one is broken.

use sk_flat::Instant;
use std::fmt;

/// What must hold, whatever happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rule {
    /// Offered = delivered + dropped + queued, and what was delivered was received.
    Books,
    /// What arrives was published on that very channel, whole.
    Delivery,
    /// It arrives in the order of publishing, and once.
    Order,
    /// The undisturbed pair loses nothing and waits for nobody.
    Bystander,
    /// Whoever has gone leaves nothing behind.
    Reaped,
    /// Whoever is honest finds his channels and subscriptions again.
    Restored,
    /// Nobody does what he has no right to.
    Rights,
    /// An honest client is never killed as spurious, and an honest hub is understood.
    Honest,
    /// Of what the hub said to be kept nothing is lost, and nothing is found that was not written so.
    Kept,
    /// Who watches a database knows what is in it.
    Watched,
    /// What is reliable is not dropped, and who must not miss any misses none.
    Policies,
    /// A file whose upload was acknowledged is there and whole, a file that is seen is one that was put there, and so
    /// are folders and whatever was moved or removed.
    Files,
    /// Who comes later gets the last message where that is kept, and who polls gets none that is older than what others
    /// had heard before.
    Latest,
    /// Every call has exactly one end, and the answer of its own request.
    Services,
    /// Of every target of a sync channel the hub tells what is so: how late it is, what it missed, and which ticks it gets.
    Ticks,
    /// Nothing panics.
    Panic,
    /// No loop goes round and round while time stands still.
    Livelock,
    /// A hub that is asked to end ends.
    Ended,
}

/// A rule that was broken: the first of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Complaint {
    /// Which.
    pub rule: Rule,
    /// How.
    pub text: String,
    /// When, in virtual time.
    pub at: Instant,
}

impl fmt::Display for Complaint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} at {:.3} ms: {}", self.rule, self.at.as_nanos() as f64 / 1e6, self.text)
    }
}
