//! Ticks of sync channels, their targets, and the reports about them.

use super::*;

fn divided(channel: ChannelRef, divisor: u8) -> Command {
    Command::Subscribe { channel, policy: Policy::Latest, depth: 0, divisor }
}

fn create(hub: &mut ServerCore, source: &mut Raw) -> ChannelRef {
    source.send(hub, 77, &Command::CreateSync { name: "clock".into(), properties: no_properties() });
    match tagged(&source.read(hub), 77).as_slice() {
        [Event::ChannelAdded { channel, kind: super::super::super::ChannelKind::Sync, .. }] => *channel,
        other => panic!("no sync channel, but {other:?}"),
    }
}

fn target(hub: &mut ServerCore, channel: ChannelRef, divisor: u8) -> Raw {
    let mut target = Raw::flow(hub, OWNER);
    target.send(hub, 78, &divided(channel, divisor));
    assert_eq!(tagged(&target.read(hub), 78), [Event::Subscribed { channel }]);
    target
}

fn ticks(events: &[Tagged<Event>]) -> Vec<u64> {
    events
        .iter()
        .filter_map(|event| match event.message {
            Event::Tick { sequence, .. } => Some(sequence),
            _ => None,
        })
        .collect()
}

fn reports(events: &[Tagged<Event>]) -> Vec<(u64, u64, u64, u64, u8)> {
    events
        .iter()
        .filter_map(|event| match event.message {
            Event::TickReport { target, lag_ns, done, missed, divisor, .. } => {
                Some((target, lag_ns / 1_000_000, done, missed, divisor))
            }
            _ => None,
        })
        .collect()
}

#[test]
fn s162_the_hub_redistributes_the_ticks_of_a_source_to_all_targets_by_their_divisors() {
    let mut hub = hub();
    let mut source = Raw::flow(&mut hub, OWNER);
    let channel = create(&mut hub, &mut source);
    let mut targets = [1, 2, 4, 0].map(|divisor| target(&mut hub, channel, divisor));
    assert_eq!(messages(source.read(&mut hub)), [Event::StartPublishing { channel }]);
    let mut heard = [const { Vec::new() }; 4];
    for sequence in 1..=9 {
        source.send(&mut hub, 0, &Command::SyncTick { channel, sequence });
        for (target, heard) in targets.iter_mut().zip(&mut heard) {
            let got = ticks(&target.read(&mut hub));
            for sequence in &got {
                target.send(&mut hub, 0, &Command::TickDone { channel, sequence: *sequence });
            }
            heard.extend(got);
        }
    }
    assert_eq!(heard, [(1..=9).collect(), vec![2, 4, 6, 8], vec![4, 8], (1..=9).collect::<Vec<u64>>()]);
    assert!(messages(source.read(&mut hub)).is_empty(), "the source hears nothing of it");
    for target in targets {
        hub.left(target.id, at(0));
    }
    assert_eq!(messages(source.read(&mut hub)), [Event::StopPublishing { channel }]);
}

#[test]
fn a_target_that_does_not_read_gets_the_newest_tick_only_and_the_books_balance() {
    let mut hub = hub();
    let mut source = Raw::flow(&mut hub, OWNER);
    let channel = create(&mut hub, &mut source);
    let mut target = target(&mut hub, channel, 1);
    for sequence in 1..=5 {
        source.send(&mut hub, 0, &Command::SyncTick { channel, sequence });
    }
    assert_eq!(hub.counts(target.id, channel).map(|counts| counts.queued), Some(1));
    assert_eq!(ticks(&target.read(&mut hub)), [5]);
    let counts = hub.counts(target.id, channel).expect("subscribed");
    assert!(counts.balance());
    assert_eq!((counts.delivered, counts.dropped[DropReason::NewestWins as usize]), (1, 4));
}

#[test]
fn a_tick_goes_before_the_streams_that_wait() {
    let mut hub = hub();
    let mut source = Raw::flow(&mut hub, OWNER);
    let channel = create(&mut hub, &mut source);
    let stream = source.create(&mut hub, "camera");
    let mut target = target(&mut hub, channel, 1);
    target.subscribe(&mut hub, stream);
    for _ in 0..20 {
        source.publish(&mut hub, stream, Bytes::from(vec![0; FRAGMENT_BYTES_MAX]));
    }
    source.send(&mut hub, 0, &Command::SyncTick { channel, sequence: 1 });
    let events = target.read(&mut hub);
    assert!(matches!(events[0].message, Event::Tick { .. }), "{:?}", events[0].message);
}

#[test]
fn s164_a_target_too_slow_is_reported_to_itself_and_the_source_and_divided_while_the_others_go_on() {
    let mut hub = hub();
    let mut source = Raw::flow(&mut hub, OWNER);
    let channel = create(&mut hub, &mut source);
    let mut good = target(&mut hub, channel, 0);
    let mut slow = target(&mut hub, channel, 0);
    source.read(&mut hub);
    let (mut owed, mut good_heard, mut to_source, mut to_slow) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for sequence in 1..=400 {
        let now = sequence * 10;
        hub.tick(at(now));
        source.send(&mut hub, 0, &Command::SyncTick { channel, sequence });
        // The slow one needs 25 ms for each tick that it takes.
        owed.retain(|(due, done)| {
            if *due <= now {
                slow.send(&mut hub, 0, &Command::TickDone { channel, sequence: *done });
            }
            *due > now
        });
        if owed.is_empty() {
            let events = slow.read(&mut hub);
            to_slow.extend(reports(&events));
            owed.extend(ticks(&events).last().map(|tick| (now + 25, *tick)));
        }
        for tick in ticks(&good.read(&mut hub)) {
            good_heard.push(tick);
            good.send(&mut hub, 0, &Command::TickDone { channel, sequence: tick });
        }
        to_source.extend(reports(&source.read(&mut hub)));
    }
    assert_eq!(good_heard, (1..=400).collect::<Vec<u64>>());
    let of = |who: &Raw| {
        let wire = who.id.wire();
        to_source
            .iter()
            .copied()
            .filter(move |(target, ..)| *target == wire)
            .collect::<Vec<_>>()
    };
    let (about_good, about_slow) = (of(&good), of(&slow));
    assert!((2..=4).contains(&about_slow.len()), "at most once a second: {about_slow:?}");
    assert!(
        about_good
            .iter()
            .all(|(_, lag, _, missed, divisor)| (*lag, *missed, *divisor) == (0, 0, 1))
    );
    let (_, lag, done, missed, divisor) = *about_slow.last().expect("reported");
    assert!(lag >= 25 && missed > 0 && done > 0 && divisor == 4, "{about_slow:?}");
    assert!(!to_slow.is_empty() && to_slow.iter().all(|report| about_slow.contains(report)));
}

#[test]
fn only_the_source_ticks_and_only_forward() {
    let mut hub = hub();
    let mut source = Raw::flow(&mut hub, OWNER);
    let channel = create(&mut hub, &mut source);
    let stream = source.create(&mut hub, "imu");
    let mut other = target(&mut hub, channel, 1);
    other.send(&mut hub, 5, &Command::SyncTick { channel, sequence: 1 });
    assert_eq!(refusal(&other.read(&mut hub), 5), Some(RefusalCode::NotOwner));
    source.send(&mut hub, 6, &Command::SyncTick { channel: stream, sequence: 1 });
    assert_eq!(refusal(&source.read(&mut hub), 6), Some(RefusalCode::WrongKind));
    source.publish(&mut hub, channel, Bytes::from_static(b"x"));
    assert_eq!(refusal(&source.read(&mut hub), 9), Some(RefusalCode::WrongKind), "a tick has no content");
    let gone = ChannelRef { id: channel.id, epoch: channel.epoch + 1 };
    source.send(&mut hub, 7, &Command::SyncTick { channel: gone, sequence: 1 });
    assert_eq!(refusal(&source.read(&mut hub), 7), Some(RefusalCode::Gone));
    for (sequence, honest) in [(3, true), (4, true), (4, false)] {
        source.send(&mut hub, 0, &Command::SyncTick { channel, sequence });
        assert_eq!(hub.connection(source.id).is_some(), honest);
    }
    assert!(messages(other.read(&mut hub)).contains(&Event::ChannelRemoved { channel }));
}

#[test]
fn a_done_of_a_tick_that_never_was_is_dishonest_and_one_that_raced_is_not() {
    let mut hub = hub();
    let mut source = Raw::flow(&mut hub, OWNER);
    let channel = create(&mut hub, &mut source);
    let target = target(&mut hub, channel, 1);
    source.send(&mut hub, 0, &Command::SyncTick { channel, sequence: 7 });
    target.send(&mut hub, 1, &Command::Unsubscribe { channel });
    target.send(&mut hub, 0, &Command::TickDone { channel, sequence: 7 });
    let gone = ChannelRef { id: channel.id, epoch: channel.epoch + 1 };
    target.send(&mut hub, 0, &Command::TickDone { channel: gone, sequence: 70 });
    assert!(hub.connection(target.id).is_some());
    target.send(&mut hub, 0, &Command::TickDone { channel, sequence: 8 });
    assert!(matches!(
        ending(&mut hub, target.id),
        Some(Ending::Spurious(ProtocolError::BadValue { .. }))
    ));
}

#[test]
fn divisors_are_one_two_four_or_the_hubs_choice() {
    for (divisor, fits) in [(0, true), (1, true), (2, true), (3, false), (4, true), (5, false)] {
        let mut hub = hub();
        let mut source = Raw::flow(&mut hub, OWNER);
        let channel = create(&mut hub, &mut source);
        let mut target = Raw::flow(&mut hub, OWNER);
        target.send(&mut hub, 1, &divided(channel, divisor));
        assert_eq!(hub.connection(target.id).is_some(), fits, "{divisor}");
        if fits {
            let stream = source.create(&mut hub, "imu");
            target.send(&mut hub, 2, &divided(stream, divisor));
            let refused = (divisor != 1).then_some(RefusalCode::WrongKind);
            assert_eq!(refusal(&target.read(&mut hub), 2), refused);
        }
    }
}
