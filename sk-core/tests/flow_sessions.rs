//! A satellite that comes back and takes its own place again, as others see it.

mod lines;

use lines::{Line, hub};
use sk_core::SkVariant;
use sk_core::flow::satellite::SatelliteEvent;

#[test]
fn others_hear_whose_the_channels_of_a_flow_are_that_came_back() {
    let mut hub = hub();
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
