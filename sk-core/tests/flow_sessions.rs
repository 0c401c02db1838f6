//! A satellite that comes back and takes its own place again, as others see it.

use sk_core::SkVariant;
use sk_core::flow::satellite::{Credentials, SatelliteCore, SatelliteEvent};
use sk_core::flow::server::{ConnectionId, Origin, ServerCore, Settings};
use sk_flat::Instant;

const UID: u32 = 1000;

/// One end of a connection at each side.
struct Line {
    at_hub: ConnectionId,
    core: SatelliteCore,
}

impl Line {
    fn new(hub: &mut ServerCore, number: u8, change: impl FnOnce(SatelliteCore) -> SatelliteCore) -> Line {
        let at_hub = hub
            .open(Origin::Unix { uid: UID }, [number; 32], Instant::ZERO)
            .expect("a place");
        let core = SatelliteCore::flow(Credentials::Peer, [100 + number; 32], Instant::ZERO);
        let mut line = Line { at_hub, core: change(core) };
        line.exchange(hub);
        line
    }

    fn exchange(&mut self, hub: &mut ServerCore) {
        loop {
            let mut idle = true;
            while let Some(frame) = self.core.take() {
                hub.receive(self.at_hub, &frame.to_vec(), Instant::ZERO);
                idle = false;
            }
            while hub.work(Instant::ZERO) {}
            while let Some(frame) = hub.take(self.at_hub) {
                self.core.receive(&frame.to_vec(), Instant::ZERO).expect("an honest hub");
                idle = false;
            }
            if idle {
                return;
            }
        }
    }

    fn events(&mut self) -> Vec<SatelliteEvent> {
        std::iter::from_fn(|| self.core.next_event()).collect()
    }
}

#[test]
fn others_hear_whose_the_channels_of_a_flow_are_that_came_back() {
    let settings = Settings { user: "robot".parse().expect("a name"), token: None, owner_uid: Some(UID) };
    let mut hub = ServerCore::new(settings, Instant::ZERO);
    let mut watcher = Line::new(&mut hub, 1, |core| core);
    let mut arm = Line::new(&mut hub, 2, |core| core.named("arm"));
    arm.core
        .create("joints", &SkVariant::map([("unit", "rad".into())]))
        .expect("a flow");
    arm.exchange(&mut hub);
    watcher.exchange(&mut hub);
    let known = |watcher: &Line| watcher.core.channel("robot.joints").expect("it was told").clone();
    assert_eq!(known(&watcher).owner, arm.core.connection());
    watcher.events();

    let session = arm.core.session();
    let again = Line::new(&mut hub, 3, |core| core.named("arm").resuming(session));
    assert!(again.core.is_resumed() && again.core.connection() != arm.core.connection());
    watcher.exchange(&mut hub);
    assert_eq!(known(&watcher).owner, again.core.connection());
    let events = watcher.events();
    assert_eq!(events, [SatelliteEvent::OwnerChanged(known(&watcher))]);
}
