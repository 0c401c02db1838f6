//! A hub and its satellites without sockets: what one says is carried to the other by hand.
#![allow(dead_code, reason = "each test file uses its own part")]

use sk_core::flow::satellite::{Credentials, SatelliteCore, SatelliteEvent};
use sk_core::flow::server::{ConnectionId, Origin, ServerCore, Settings};
use sk_flat::Instant;

const UID: u32 = 1000;

/// A hub with nobody connected.
pub fn hub() -> ServerCore {
    let settings = Settings { user: "robot".parse().expect("a name"), token: None, owner_uid: Some(UID) };
    ServerCore::new(settings, Instant::ZERO)
}

/// One end of a connection at each side.
pub struct Line {
    pub at_hub: ConnectionId,
    pub core: SatelliteCore,
}

impl Line {
    pub fn new(
        hub: &mut ServerCore,
        number: u8,
        change: impl FnOnce(SatelliteCore) -> SatelliteCore,
    ) -> Line {
        let at_hub = hub
            .open(Origin::Unix { uid: UID }, [number; 32], Instant::ZERO)
            .expect("a place");
        let core = SatelliteCore::flow(Credentials::Peer, [100 + number; 32], Instant::ZERO);
        let mut line = Line { at_hub, core: change(core) };
        line.exchange(hub);
        line
    }

    /// Until neither has anything to say.
    pub fn exchange(&mut self, hub: &mut ServerCore) {
        while self.send(hub, usize::MAX) + self.read(hub) > 0 {}
    }

    /// Sends so many frames at most; answers how many there were.
    pub fn send(&mut self, hub: &mut ServerCore, frames_max: usize) -> usize {
        let mut count = 0;
        while count < frames_max
            && let Some(frame) = self.core.take()
        {
            hub.receive(self.at_hub, &frame.to_vec(), Instant::ZERO);
            count += 1;
        }
        while hub.work(Instant::ZERO) {}
        count
    }

    /// Takes what the hub has to say; answers how many frames that was.
    pub fn read(&mut self, hub: &mut ServerCore) -> usize {
        let mut count = 0;
        while let Some(frame) = hub.take(self.at_hub) {
            self.core.receive(&frame.to_vec(), Instant::ZERO).expect("an honest hub");
            count += 1;
        }
        count
    }

    pub fn events(&mut self) -> Vec<SatelliteEvent> {
        std::iter::from_fn(|| self.core.next_event()).collect()
    }
}
