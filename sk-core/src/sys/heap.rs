//! An allocator that counts for the thread that asks.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static TAKEN: Cell<u64> = const { Cell::new(0) };
    static HELD_BYTES: Cell<i64> = const { Cell::new(0) };
}

/// The system's allocator with a count for each thread: a test program makes it its global allocator to show
/// what a path takes from the heap.
///
/// ```
/// use sk_core::testing::CountingAllocator;
///
/// #[global_allocator]
/// static ALLOCATOR: CountingAllocator = CountingAllocator;
///
/// let before = CountingAllocator::taken();
/// let boxed = Box::new(5);
/// assert_eq!(CountingAllocator::taken() - before, 1);
/// drop(boxed);
/// ```
#[derive(Debug)]
pub struct CountingAllocator;

impl CountingAllocator {
    /// How many allocations this thread has made.
    pub fn taken() -> u64 {
        TAKEN.get()
    }

    /// The bytes this thread has allocated less those it has freed.
    pub fn held_bytes() -> i64 {
        HELD_BYTES.get()
    }
}

fn note(taken: u64, bytes: i64) {
    // A thread that ends frees after its counters are gone.
    let _ = TAKEN.try_with(|count| count.set(count.get() + taken));
    let _ = HELD_BYTES.try_with(|held| held.set(held.get() + bytes));
}

// SAFETY: every call goes to the system's allocator unchanged, and counting touches none of its memory: the
// counters are plain cells without a destructor, which take nothing from the heap themselves.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note(1, layout.size() as i64);
        // SAFETY: the caller keeps the contract of `alloc`, which is the same there.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        note(0, -(layout.size() as i64));
        // SAFETY: `at` came from `alloc` above, so from the system's allocator, with this layout.
        unsafe { System.dealloc(at, layout) }
    }
}
