//! Bytes that are held for others, and how many may be.

use crate::flow::limits::HUB_BYTES_MAX;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// How many bytes are held, and how many may be. A clone is the same budget.
///
/// ```
/// use sk_core::flow::delivery::Budget;
///
/// let whole = Budget::of(1000);
/// let part = whole.part(600);
/// let held = part.charge(500);
/// assert_eq!((whole.used(), part.used()), (500, 500));
/// assert!(!part.has_room_for(101) && whole.has_room_for(500));
/// drop(held);
/// assert_eq!(whole.used(), 0);
/// ```
#[derive(Clone, Debug)]
pub struct Budget(Arc<Ledger>);

#[derive(Debug)]
struct Ledger {
    used: AtomicUsize,
    max: AtomicUsize,
    /// What is charged here is charged there too.
    whole: Option<Budget>,
}

impl Default for Budget {
    /// That of a hub.
    fn default() -> Self {
        Budget::of(HUB_BYTES_MAX)
    }
}

impl Budget {
    /// A budget of so many bytes.
    pub fn of(bytes_max: usize) -> Budget {
        Budget::with(bytes_max, None)
    }

    /// A part of this budget, with a limit of its own.
    pub fn part(&self, bytes_max: usize) -> Budget {
        Budget::with(bytes_max, Some(self.clone()))
    }

    fn with(bytes_max: usize, whole: Option<Budget>) -> Budget {
        let (used, max) = (AtomicUsize::new(0), AtomicUsize::new(bytes_max));
        Budget(Arc::new(Ledger { used, max, whole }))
    }

    /// What is charged now.
    pub fn used(&self) -> usize {
        self.0.used.load(Ordering::Relaxed)
    }

    /// What may be.
    pub fn max(&self) -> usize {
        self.0.max.load(Ordering::Relaxed)
    }

    /// Changes that; what is charged already stays.
    pub fn narrow(&self, bytes_max: usize) {
        self.0.max.store(bytes_max, Ordering::Relaxed);
    }

    /// Whether more is charged than may be.
    pub fn is_over(&self) -> bool {
        self.used() > self.max() || self.0.whole.as_ref().is_some_and(Budget::is_over)
    }

    /// Whether so much more may be charged.
    pub fn has_room_for(&self, bytes: usize) -> bool {
        self.used().saturating_add(bytes) <= self.max()
            && self.0.whole.as_ref().is_none_or(|whole| whole.has_room_for(bytes))
    }

    /// Charges bytes, whether there is room or not.
    pub fn charge(&self, bytes: usize) -> Charge {
        self.take(bytes);
        Charge { budget: self.clone(), bytes }
    }

    fn take(&self, bytes: usize) {
        self.0.used.fetch_add(bytes, Ordering::Relaxed);
        if let Some(whole) = &self.0.whole {
            whole.take(bytes);
        }
    }

    fn give_back(&self, bytes: usize) {
        self.0.used.fetch_sub(bytes, Ordering::Relaxed);
        if let Some(whole) = &self.0.whole {
            whole.give_back(bytes);
        }
    }
}

/// Bytes of a budget; given back when this is dropped.
#[derive(Debug)]
pub struct Charge {
    budget: Budget,
    bytes: usize,
}

impl Charge {
    /// How many.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Whose.
    pub fn budget(&self) -> &Budget {
        &self.budget
    }

    /// Charges more to the same.
    pub fn add(&mut self, bytes: usize) {
        self.budget.take(bytes);
        self.bytes += bytes;
    }
}

impl Drop for Charge {
    fn drop(&mut self) {
        self.budget.give_back(self.bytes);
    }
}
