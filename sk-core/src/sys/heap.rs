//! The heap: an allocator that counts for the thread that asks, and how much of what was freed stays with the process.
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

/// Blocks from this size on come from the system and go back to it when they are freed.
#[cfg(target_env = "gnu")]
const OWN_PAGES_BYTES_MIN: libc::c_int = 4 * 1024 * 1024;

/// From now on so much freed memory stays with the process. By default the C library gives back what is free beyond some
/// hundred KiB, and a program that fills and empties large queues has the kernel clear the same pages again and again.
#[cfg(target_env = "gnu")]
pub(crate) fn keep_freed(bytes: usize) {
    let bytes = libc::c_int::try_from(bytes).unwrap_or(libc::c_int::MAX);
    for (what, value) in [(libc::M_TRIM_THRESHOLD, bytes), (libc::M_MMAP_THRESHOLD, OWN_PAGES_BYTES_MIN)] {
        // SAFETY: the call takes numbers only, holds the lock of the first arena, and touches no block that is in use. A
        // thread that allocates meanwhile finds the old threshold or the new one; both are good.
        if unsafe { libc::mallopt(what, value) } == 0 {
            tracing::debug!("the allocator keeps its own measure of freed memory");
        }
    }
}

/// Other C libraries have no such choice.
#[cfg(not(target_env = "gnu"))]
pub(crate) fn keep_freed(_bytes: usize) {}

#[cfg(all(test, target_env = "gnu"))]
mod tests {
    use super::*;
    use nix::sys::resource::{UsageWho, getrusage};

    /// Fills and empties a queue of blocks; answers how many pages the kernel had to provide.
    fn pages_of_a_burst() -> i64 {
        let faults = || getrusage(UsageWho::RUSAGE_THREAD).unwrap().minor_page_faults();
        let before = faults();
        let blocks: Vec<Vec<u8>> = (0..16).map(|_| vec![1; 150_000]).collect();
        assert_eq!(blocks.iter().map(Vec::len).sum::<usize>(), 2_400_000);
        drop(blocks);
        faults() - before
    }

    #[test]
    fn a_burst_finds_the_pages_of_the_one_before() {
        keep_freed(16 * 1024 * 1024);
        pages_of_a_burst();
        let pages: i64 = (0..50).map(|_| pages_of_a_burst()).sum();
        // They have 29,300 pages.
        assert!(pages < 2_000, "{pages} pages in 50 bursts");
    }
}
