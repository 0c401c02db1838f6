//! Publishing by datagrams: who may, what is taken, and what becomes of the rest.

use super::*;
use crate::flow::fragment::cut;
use crate::flow::transport::datagram::{DatagramKey, DatagramWriter};
use proptest::prelude::*;

fn hub_with_udp() -> ServerCore {
    let mut hub = hub();
    hub.offer_udp(7110, [5; 32]);
    hub
}

fn open(hub: &mut ServerCore, flow: &mut Raw) -> DatagramWriter {
    match flow.ask(hub, &Command::UdpOpen {}).as_slice() {
        [Event::UdpOpened { session, key, port: 7110 }] => {
            DatagramWriter::new(*session, DatagramKey::new(*key))
        }
        other => panic!("no session, but {other:?}"),
    }
}

/// The datagrams of a message.
fn datagrams(
    by: &mut DatagramWriter,
    to: ChannelRef,
    message: u32,
    payload: Bytes,
    most: usize,
) -> Vec<Vec<u8>> {
    let frames = cut(payload, most)
        .map(|(flags, payload)| Command::Publish { channel: to, message, payload }.encode(9, flags).to_vec());
    frames.map(|frame| by.seal(&frame).expect("short")).collect()
}

fn send(hub: &mut ServerCore, datagrams: &[Vec<u8>]) {
    datagrams.iter().for_each(|datagram| hub.receive_datagram(datagram, hub.now));
}

fn aborted(hub: &ServerCore) -> u64 {
    let totals = hub.totals();
    assert!(totals.balance(), "{totals:?}");
    totals.dropped[DropReason::Aborted as usize]
}

#[test]
fn s71_messages_come_by_datagram_whole_or_not_at_all() {
    let mut hub = hub_with_udp();
    let [mut owner, mut listener] = [(); 2].map(|()| Raw::flow(&mut hub, OWNER));
    let channel = owner.create(&mut hub, "pose");
    listener.subscribe(&mut hub, channel);
    let mut writer = open(&mut hub, &mut owner);
    send(&mut hub, &datagrams(&mut writer, channel, 0, Bytes::from_static(b"small"), 1000));
    let large = Bytes::from((0..5000_u32).map(|index| index as u8).collect::<Vec<u8>>());
    let pieces = datagrams(&mut writer, channel, 1, large.clone(), 1000);
    assert_eq!(pieces.len(), 5);
    send(&mut hub, &pieces);
    assert_eq!(listener.heard(&mut hub, channel), [b"small".to_vec(), large.to_vec()]);
    for lost in 0..5 {
        let mut pieces = datagrams(&mut writer, channel, 2 + lost, large.clone(), 1000);
        pieces.remove(lost as usize);
        send(&mut hub, &pieces);
    }
    send(&mut hub, &datagrams(&mut writer, channel, 7, Bytes::from_static(b"after"), 1000));
    assert_eq!(listener.heard(&mut hub, channel), [b"after".to_vec()]);
    assert_eq!(aborted(&hub), 5);
    assert_eq!(hub.datagram_counts(), DatagramCounts { taken: 27, ..DatagramCounts::default() });
}

#[test]
fn t15_what_is_not_proven_and_new_changes_nothing_and_is_answered_by_nothing() {
    let mut hub = hub_with_udp();
    let [mut owner, mut listener] = [(); 2].map(|()| Raw::flow(&mut hub, OWNER));
    let channel = owner.create(&mut hub, "pose");
    listener.subscribe(&mut hub, channel);
    let mut writer = open(&mut hub, &mut owner);
    let good = datagrams(&mut writer, channel, 0, Bytes::from_static(b"x"), 1000).remove(0);
    owner.read(&mut hub);
    listener.read(&mut hub);
    drop(hub.take_dirty());
    let before = hub.totals();
    let mut stranger = DatagramWriter::new(1, DatagramKey::new([0; 32]));
    let unknown = datagrams(&mut stranger, channel, 0, Bytes::from_static(b"x"), 1000).remove(0);
    for length in 0..=unknown.len() {
        hub.receive_datagram(&unknown[..length], hub.now);
    }
    hub.receive_datagram(&[0; 1201], hub.now);
    for bit in 64..good.len() * 8 {
        let mut forged = good.clone();
        forged[bit / 8] ^= 1 << (bit % 8);
        hub.receive_datagram(&forged, hub.now);
    }
    assert!(
        !hub.has_dirty() && !hub.has_output(owner.id) && !hub.has_output(listener.id),
        "nothing goes out"
    );
    assert_eq!(hub.totals(), before);
    hub.receive_datagram(&good, hub.now);
    for _ in 0..100 {
        hub.receive_datagram(&good, hub.now);
    }
    assert_eq!(listener.heard(&mut hub, channel), [b"x"]);
    assert!(owner.read(&mut hub).is_empty());
    let expected = DatagramCounts {
        taken: 1,
        unknown: unknown.len() as u64 + 2,
        forged: (good.len() as u64 - 8) * 8,
        replayed: 100,
        malformed: 0,
    };
    assert_eq!(hub.datagram_counts(), expected);
}

#[test]
fn a_hub_without_udp_and_a_flow_without_the_right_open_no_session() {
    let mut hub = hub();
    let mut flow = Raw::flow(&mut hub, OWNER);
    flow.send(&mut hub, 4, &Command::UdpOpen {});
    assert_eq!(refusal(&flow.read(&mut hub), 4), Some(RefusalCode::NotOffered));
    hub.offer_udp(7110, [5; 32]);
    open(&mut hub, &mut flow);
    let rights = Rights::NONE.with(crate::flow::Right::Subscribe);
    let mut guest = Raw::flow(&mut hub, Origin::Inside { rights });
    guest.send(&mut hub, 5, &Command::UdpOpen {});
    assert_eq!(refusal(&guest.read(&mut hub), 5), Some(RefusalCode::Denied));
    hub.withdraw_udp();
    flow.send(&mut hub, 6, &Command::UdpOpen {});
    assert_eq!(refusal(&flow.read(&mut hub), 6), Some(RefusalCode::NotOffered));
}

#[test]
fn a_datagram_is_refused_where_its_fragment_would_be_and_told_so_on_the_flow() {
    let mut hub = hub_with_udp();
    let [mut owner, mut other] = [(); 2].map(|()| Raw::flow(&mut hub, OWNER));
    let own = owner.create(&mut hub, "own");
    let service = owner.serve(&mut hub, "service");
    let reliable = owner.create_with(&mut hub, "log", with_properties([("delivery", "reliable".into())]));
    let others = other.create(&mut hub, "others");
    let gone = owner.create(&mut hub, "gone");
    owner.send(&mut hub, 3, &Command::RemoveChannel { channel: gone });
    other.subscribe(&mut hub, own);
    owner.read(&mut hub);
    other.read(&mut hub);
    let mut writer = open(&mut hub, &mut owner);
    let cases = [
        (service, RefusalCode::WrongKind),
        (reliable, RefusalCode::NotOffered),
        (others, RefusalCode::NotOwner),
        (gone, RefusalCode::Gone),
    ];
    for (channel, code) in cases {
        send(&mut hub, &datagrams(&mut writer, channel, 0, Bytes::from_static(b"abc"), 1));
        let refused = owner.read(&mut hub);
        assert_eq!((refused.len(), refusal(&refused, 9)), (1, Some(code)), "once, at its first fragment");
    }
    assert!(other.read(&mut hub).is_empty());
    send(&mut hub, &datagrams(&mut writer, own, 0, Bytes::from_static(b"abc"), 1));
    assert_eq!(other.heard(&mut hub, own), [b"abc"]);
}

#[test]
fn a_session_ends_with_its_flow_and_with_the_next_one() {
    let mut hub = hub_with_udp();
    let [mut owner, mut listener] = [(); 2].map(|()| Raw::flow(&mut hub, OWNER));
    let channel = owner.create(&mut hub, "pose");
    listener.subscribe(&mut hub, channel);
    let mut former = open(&mut hub, &mut owner);
    let begun = datagrams(&mut former, channel, 0, Bytes::from_static(b"ab"), 1);
    send(&mut hub, &begun[..1]);
    let mut present = open(&mut hub, &mut owner);
    assert_eq!(aborted(&hub), 1, "what was begun will not be whole");
    send(&mut hub, &begun[1..]);
    send(&mut hub, &datagrams(&mut present, channel, 1, Bytes::from_static(b"x"), 1));
    assert_eq!(listener.heard(&mut hub, channel), [b"x"]);
    assert_eq!(hub.datagram_counts().unknown, 1);
    hub.left(owner.id, hub.now);
    send(&mut hub, &datagrams(&mut present, channel, 2, Bytes::from_static(b"y"), 1));
    assert_eq!(hub.datagram_counts().unknown, 2);
    assert!(listener.heard(&mut hub, channel).is_empty());
}

#[test]
fn a_proven_datagram_that_holds_something_else_is_dropped_and_ends_nothing() {
    let mut hub = hub_with_udp();
    let [mut owner, mut listener] = [(); 2].map(|()| Raw::flow(&mut hub, OWNER));
    let channel = owner.create(&mut hub, "pose");
    listener.subscribe(&mut hub, channel);
    owner.read(&mut hub);
    let mut writer = open(&mut hub, &mut owner);
    let publish = Command::Publish { channel, message: 0, payload: Bytes::from_static(b"x") };
    let good = publish.encode(9, Flags::WHOLE).to_vec();
    let mut frames = vec![
        Command::Ping {}.encode(9, Flags::NONE).to_vec(),
        Command::RemoveChannel { channel }.encode(9, Flags::NONE).to_vec(),
        [&good[..], b"more"].concat(),
        good[..good.len() - 1].to_vec(),
        vec![0xff],
        // An empty fragment that is not the last one, and one with contradicting flags.
        Command::Publish { channel, message: 0, payload: Bytes::new() }
            .encode(9, Flags::FIRST)
            .to_vec(),
    ];
    let mut flags = good.clone();
    flags[1] = 7;
    frames.push(flags);
    for frame in &frames {
        let sealed = writer.seal(frame).expect("short");
        hub.receive_datagram(&sealed, hub.now);
    }
    assert_eq!(hub.datagram_counts().malformed, frames.len() as u64);
    assert!(owner.read(&mut hub).is_empty() && hub.spurious() == 0);
    send(&mut hub, &[writer.seal(&good).expect("short")]);
    assert_eq!(listener.heard(&mut hub, channel), [b"x"]);
}

/// What the network does to one datagram.
#[derive(Clone, Copy, Debug)]
enum Fate {
    Arrives,
    Lost,
    Twice,
    /// Comes after so many that were sent later.
    Late(usize),
}

fn fate() -> impl Strategy<Value = Fate> {
    prop_oneof![
        6 => Just(Fate::Arrives),
        1 => Just(Fate::Lost),
        1 => Just(Fate::Twice),
        1 => (1_usize..6).prop_map(Fate::Late),
    ]
}

proptest! {
    #[test]
    fn whatever_the_network_does_messages_are_whole_once_in_order_and_the_books_balance(
        messages in prop::collection::vec((0_usize..2, 0_usize..40), 1..30),
        fates in prop::collection::vec(fate(), 1..200),
    ) {
        let mut hub = hub_with_udp();
        let [mut owner, mut listener] = [(); 2].map(|()| Raw::flow(&mut hub, OWNER));
        let channels = ["a", "b"].map(|name| owner.create(&mut hub, name));
        for channel in channels {
            listener.subscribe_as(&mut hub, channel, Policy::All, 100);
        }
        let mut writer = open(&mut hub, &mut owner);
        let mut sent = [Vec::new(), Vec::new()];
        let mut arrivals = Vec::new();
        for (number, (on, length)) in messages.iter().enumerate() {
            let payload = vec![number as u8; *length];
            sent[*on].push(payload.clone());
            for datagram in datagrams(&mut writer, channels[*on], number as u32, payload.into(), 10) {
                let place = arrivals.len();
                match fates[place % fates.len()] {
                    Fate::Arrives => arrivals.push((place, datagram)),
                    Fate::Lost => arrivals.push((place, Vec::new())),
                    Fate::Twice => arrivals.extend([(place, datagram.clone()), (place + 2, datagram)]),
                    Fate::Late(by) => arrivals.push((place + by, datagram)),
                }
            }
        }
        let is_fine = fates.iter().all(|fate| matches!(fate, Fate::Arrives | Fate::Twice));
        arrivals.sort_by_key(|(place, _)| *place);
        let arriving: Vec<Vec<u8>> = arrivals.into_iter().map(|(_, datagram)| datagram).collect();
        send(&mut hub, &arriving);
        let mut heard: [Vec<Vec<u8>>; 2] = [Vec::new(), Vec::new()];
        for event in listener.read(&mut hub) {
            if let Event::Data { channel, payload, .. } = event.message {
                let on = &mut heard[usize::from(channel == channels[1])];
                if event.flags.has(Flags::FIRST) {
                    on.push(Vec::new());
                }
                on.last_mut().expect("a message begins before it goes on").extend_from_slice(&payload);
            }
        }
        for on in 0..2 {
            let mut rest = sent[on].iter();
            for message in &heard[on] {
                prop_assert!(rest.any(|sent| sent == message), "{message:?} is not whole, or out of order");
            }
            if is_fine {
                prop_assert_eq!(&heard[on], &sent[on]);
            }
        }
        aborted(&hub);
    }
}

#[test]
fn a_message_that_a_newer_one_overtook_on_the_other_way_is_given_up() {
    let mut hub = hub_with_udp();
    let [mut owner, mut listener] = [(); 2].map(|()| Raw::flow(&mut hub, OWNER));
    let channel = owner.create(&mut hub, "pose");
    listener.subscribe(&mut hub, channel);
    let mut writer = open(&mut hub, &mut owner);
    let by_stream = |hub: &mut ServerCore, message| {
        let payload = Bytes::from(vec![message as u8]);
        owner.send_flagged(hub, 9, Flags::WHOLE, &Command::Publish { channel, message, payload });
    };
    let mut by_datagram = |hub: &mut ServerCore, message| {
        let payload = Bytes::from(vec![message as u8]);
        send(hub, &datagrams(&mut writer, channel, message, payload, 1000));
    };
    by_stream(&mut hub, u32::MAX - 1);
    by_datagram(&mut hub, 0);
    by_stream(&mut hub, u32::MAX);
    by_stream(&mut hub, 2);
    by_datagram(&mut hub, 1);
    by_datagram(&mut hub, 3);
    assert_eq!(listener.heard(&mut hub, channel), [vec![254], vec![0], vec![2], vec![3]]);
    assert_eq!(aborted(&hub), 2, "it is in the books");
}
