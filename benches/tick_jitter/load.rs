//! The conditions under which all sides are measured: the load, and how deeply idle CPUs sleep.

use std::fs::{File, OpenOptions};
use std::hint::black_box;
use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// How many busy threads there are for each CPU.
const THREADS_PER_CPU: usize = 2;
/// What each of them goes through again and again: more than the caches near the core hold.
const WORDS: usize = 512 * 1024;
/// How many words it writes before it asks the kernel for something.
const WORDS_PER_CALL: usize = 4_096;

/// Threads in the normal class that compute, write memory and enter the kernel, until it is dropped.
pub(crate) struct Load {
    going: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Load {
    /// Starts them.
    pub(crate) fn start() -> Load {
        let cpus = std::thread::available_parallelism().map_or(1, usize::from);
        let going = Arc::new(AtomicBool::new(true));
        let thread = |_| {
            let going = going.clone();
            std::thread::spawn(move || work(&going))
        };
        Load { threads: (0..cpus * THREADS_PER_CPU).map(thread).collect(), going }
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.going.store(false, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // A thread of the load that panicked has put no load on; the rest has.
            let _ = thread.join();
        }
    }
}

fn work(going: &AtomicBool) {
    let mut words = vec![0u64; WORDS];
    let mut at = 0;
    while going.load(Ordering::Relaxed) {
        for _ in 0..WORDS_PER_CALL {
            at = (at + 9) % WORDS;
            words[at] = words[at].wrapping_mul(31).wrapping_add(at as u64);
        }
        black_box(&mut words);
        black_box(std::fs::metadata("/proc/self").is_ok());
    }
}

/// Holds `/dev/cpu_dma_latency` at 0 as long as the process lives.
pub(crate) fn hold_latency_at_zero() -> io::Result<()> {
    let mut device: File = OpenOptions::new().write(true).open("/dev/cpu_dma_latency")?;
    device.write_all(&0_i32.to_ne_bytes())?;
    // The kernel keeps the request until the device is closed, which the end of the process does.
    std::mem::forget(device);
    Ok(())
}
