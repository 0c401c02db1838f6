//! A real world whose clock can be pushed forward, so that no test waits for a deadline.

use sk_core::Instant;
use sk_core::world::{Clock, RealClock, World};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// The machine's clock plus what was pushed.
#[derive(Debug)]
pub struct PushedClock {
    real: RealClock,
    pushed_ns: AtomicU64,
}

impl PushedClock {
    pub fn push(&self, span: Duration) {
        self.pushed_ns.fetch_add(span.as_nanos() as u64, Ordering::Relaxed);
    }

    fn pushed(&self) -> Duration {
        Duration::from_nanos(self.pushed_ns.load(Ordering::Relaxed))
    }
}

impl Clock for PushedClock {
    fn now(&self) -> Instant {
        self.real.now() + self.pushed()
    }

    fn since_epoch(&self) -> Duration {
        self.real.since_epoch() + self.pushed()
    }

    fn sleep(&self, span: Duration) {
        self.real.sleep(span);
    }

    fn sleep_until(&self, until: Instant) {
        self.real.sleep(until.since(self.now()));
    }
}

/// A world with the machine's sockets and such a clock.
pub fn world() -> (World, Arc<PushedClock>) {
    let clock = Arc::new(PushedClock { real: RealClock::new(), pushed_ns: AtomicU64::new(0) });
    let mut world = World::real().expect("descriptors are left");
    world.clock = clock.clone();
    (world, clock)
}
