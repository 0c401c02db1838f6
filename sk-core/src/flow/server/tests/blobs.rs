//! Blob channels at the hub: the owner changes, others read, and a slow disk or a slow reader costs nobody else.

use super::*;
use crate::flow::Path;
use crate::flow::blob::BlobStore;
use crate::world::{DiskFaults, SimulatedRng, SimulatedStorage};
use std::sync::Arc;

fn path(text: &str) -> Path {
    Path(text.to_owned())
}

fn content(length: usize) -> Bytes {
    (0..length)
        .map(|index| (index * 7 + index / 251) as u8)
        .collect::<Vec<u8>>()
        .into()
}

fn refused(code: RefusalCode) -> Vec<Event> {
    vec![Event::Refused { code: code.code(), text: code.to_string() }]
}

/// A hub with its files on a simulated disk.
struct Robot {
    hub: ServerCore,
    store: BlobStore,
    disk: Arc<SimulatedStorage>,
}

impl Robot {
    fn new() -> Robot {
        Robot::start(Arc::new(SimulatedStorage::new()))
    }

    fn start(disk: Arc<SimulatedStorage>) -> Robot {
        let store = BlobStore::open(disk.clone(), "/state/blobs".into()).expect("the disk works");
        let mut hub = hub();
        hub.keep_blobs();
        Robot { hub, store, disk }
    }

    /// What a worker would do with all that waits. Answers how much that was.
    fn work(&mut self) -> usize {
        let mut count = 0;
        while let Some(request) = self.hub.next_blob_request() {
            self.store.take(request);
        }
        while let Some(answer) = self.store.step() {
            self.hub.blob_done(answer, at(0));
            count += 1;
        }
        while self.hub.work(at(0)) {}
        count
    }

    /// Sends a command and answers what came with its tag, when disk and peer have done all they can.
    fn ask(&mut self, raw: &mut Raw, command: &Command) -> Vec<Event> {
        raw.send(&mut self.hub, 79, command);
        tagged(&self.settle(raw), 79)
    }

    fn settle(&mut self, raw: &mut Raw) -> Vec<Tagged<Event>> {
        let mut events = raw.read(&mut self.hub);
        loop {
            let worked = self.work();
            let more = raw.read(&mut self.hub);
            if worked == 0 && more.is_empty() {
                return events;
            }
            events.extend(more);
        }
    }

    fn create(&mut self, raw: &mut Raw, name: &str) -> ChannelRef {
        let create = Command::CreateBlob { name: name.to_owned(), properties: no_properties() };
        match self.ask(raw, &create).as_slice() {
            [Event::ChannelAdded { channel, kind: ChannelKind::Blob, .. }] => *channel,
            other => panic!("no channel, but {other:?}"),
        }
    }

    fn upload(&mut self, raw: &mut Raw, channel: ChannelRef, at: &str, content: &Bytes) {
        let (bytes, checksum) = (content.len() as u64, crc32fast::hash(content));
        let begin = Command::BlobBegin { channel, path: path(at), bytes, checksum };
        assert_eq!(self.ask(raw, &begin), [Event::BlobResume { offset: 0 }]);
        send_piece(raw, &mut self.hub, 80, channel, at, 0, content);
        assert_eq!(tagged(&self.settle(raw), 80), [Event::Done {}]);
        assert_eq!(self.ask(raw, &Command::BlobCommit { channel, path: path(at) }), [Event::Saved {}]);
    }

    fn read(&mut self, raw: &mut Raw, channel: ChannelRef, at: &str, offset: u64, bytes: u32) -> Vec<u8> {
        let read = Command::BlobRead { channel, path: path(at), offset, bytes };
        raw.send(&mut self.hub, 81, &read);
        let events = self.settle(raw);
        whole(&events, 81)
    }
}

fn send_piece(
    raw: &Raw,
    hub: &mut ServerCore,
    tag: u32,
    channel: ChannelRef,
    at: &str,
    offset: u64,
    content: &Bytes,
) {
    for (flags, payload) in super::super::super::fragment::cut(content.clone(), FRAGMENT_BYTES_MAX) {
        raw.send_flagged(hub, tag, flags, &Command::BlobWrite { channel, path: path(at), offset, payload });
    }
}

/// The bytes of a download; the flags say where it begins and ends.
fn whole(events: &[Tagged<Event>], tag: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let fragments: Vec<_> = events.iter().filter(|event| event.tag == tag).collect();
    for (index, event) in fragments.iter().enumerate() {
        let Event::BlobData { payload } = &event.message else { panic!("no data, but {event:?}") };
        assert_eq!(event.flags.has(Flags::FIRST), index == 0, "fragment {index}");
        assert_eq!(event.flags.has(Flags::LAST), index + 1 == fragments.len(), "fragment {index}");
        bytes.extend_from_slice(payload);
    }
    bytes
}

#[test]
fn what_the_owner_uploads_everybody_reads() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    let file = content(900_000);
    robot.upload(&mut owner, channel, "floor.png", &file);
    robot.upload(&mut owner, channel, "empty", &Bytes::new());
    for mut reader in [Raw::flow(&mut robot.hub, OWNER), Raw::synchronous(&mut robot.hub, OWNER)] {
        assert_eq!(robot.read(&mut reader, channel, "floor.png", 0, u32::MAX), file);
        assert_eq!(robot.read(&mut reader, channel, "floor.png", 0, 262_144), file[..262_144]);
        assert_eq!(robot.read(&mut reader, channel, "floor.png", 899_990, 100), file[899_990..]);
        assert_eq!(robot.read(&mut reader, channel, "floor.png", 900_000, 100), [0; 0]);
        assert_eq!(robot.read(&mut reader, channel, "floor.png", u64::MAX, 100), [0; 0]);
        assert_eq!(robot.read(&mut reader, channel, "empty", 0, u32::MAX), [0; 0]);
        let stat = Command::BlobStat { channel, path: path("floor.png") };
        let entry = Event::BlobEntry { directory: 0, bytes: 900_000, checksum: crc32fast::hash(&file) };
        assert_eq!(robot.ask(&mut reader, &stat), [entry]);
        let list = robot.ask(&mut reader, &Command::BlobList { channel, path: path("") });
        let [
            Event::BlobListed { name: first, bytes: 0, .. },
            Event::BlobListed { name: second, .. },
            Event::ListEnd { count: 2 },
        ] = list.as_slice()
        else {
            panic!("another list: {list:?}");
        };
        assert_eq!((first.as_str(), second.as_str()), ("empty", "floor.png"));
    }
}

#[test]
fn nobody_but_the_owner_changes_anything() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    robot.upload(&mut owner, channel, "a", &content(10));
    let mut other = Raw::flow(&mut robot.hub, OWNER);
    let payload = content(10);
    for command in [
        Command::BlobBegin { channel, path: path("b"), bytes: 10, checksum: 1 },
        Command::BlobCommit { channel, path: path("a") },
        Command::BlobAbort { channel, path: path("a") },
        Command::BlobMkdir { channel, path: path("d") },
        Command::BlobMove { channel, from: path("a"), to: path("b") },
        Command::BlobRemove { channel, path: path("a") },
    ] {
        assert_eq!(robot.ask(&mut other, &command), refused(RefusalCode::NotOwner), "{command:?}");
    }
    let write = Command::BlobWrite { channel, path: path("a"), offset: 0, payload };
    other.send_flagged(&mut robot.hub, 79, Flags::WHOLE, &write);
    assert_eq!(tagged(&robot.settle(&mut other), 79), refused(RefusalCode::NotOwner));
    assert_eq!(robot.hub.unanswered_blob_requests(), 0, "the disk never heard of it");
    assert_eq!(robot.read(&mut other, channel, "a", 0, 99), content(10));
}

#[test]
fn without_the_right_a_command_is_refused() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    robot.upload(&mut owner, channel, "a", &content(10));
    let reads = Rights::NONE.with(Right::BlobRead);
    let mut reader = Raw::flow(&mut robot.hub, Origin::Inside { rights: reads });
    let create = Command::CreateBlob { name: "mine".into(), properties: no_properties() };
    assert_eq!(robot.ask(&mut reader, &create), refused(RefusalCode::Denied));
    assert_eq!(robot.read(&mut reader, channel, "a", 0, 99), content(10));
    let mut stranger = Raw::flow(&mut robot.hub, Origin::Inside { rights: Rights::NONE });
    let read = Command::BlobRead { channel, path: path("a"), offset: 0, bytes: 99 };
    assert_eq!(robot.ask(&mut stranger, &read), refused(RefusalCode::Denied));
}

#[test]
fn what_cannot_be_is_refused_with_its_code() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    let stream = owner.create(&mut robot.hub, "stream");
    robot.upload(&mut owner, channel, "a", &content(10));
    let gone = ChannelRef { epoch: channel.epoch.wrapping_add(1), ..channel };
    let stat = |channel, at: &str| Command::BlobStat { channel, path: path(at) };
    for (command, code) in [
        (stat(gone, "a"), RefusalCode::Gone),
        (stat(stream, "a"), RefusalCode::WrongKind),
        (stat(channel, "../a"), RefusalCode::BadPath),
        (stat(channel, "/etc/passwd"), RefusalCode::BadPath),
        (stat(channel, "none"), RefusalCode::NoSuchPath),
        (stat(channel, "a/b"), RefusalCode::WrongPath),
        (Command::BlobList { channel, path: path("a") }, RefusalCode::WrongPath),
        (Command::BlobList { channel, path: path("none") }, RefusalCode::NoSuchPath),
        (
            Command::BlobRead { channel, path: path("none"), offset: 0, bytes: 1 },
            RefusalCode::NoSuchPath,
        ),
        (Command::BlobRead { channel, path: path(""), offset: 0, bytes: 1 }, RefusalCode::BadPath),
        (
            Command::BlobBegin { channel, path: path("b"), bytes: u64::MAX, checksum: 0 },
            RefusalCode::Quota,
        ),
        (Command::BlobCommit { channel, path: path("b") }, RefusalCode::BadOffset),
        (subscribe(channel, 0), RefusalCode::WrongKind),
    ] {
        assert_eq!(robot.ask(&mut owner, &command), refused(code), "{command:?}");
    }
    let mut bare = hub();
    let mut flow = Raw::flow(&mut bare, OWNER);
    let create = Command::CreateBlob { name: "maps".into(), properties: no_properties() };
    assert_eq!(flow.ask(&mut bare, &create), refused(RefusalCode::NotOffered), "a hub without a disk");
}

#[test]
fn an_upload_goes_on_after_the_connection_was_lost() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    let file = content(800_000);
    let (bytes, checksum) = (file.len() as u64, crc32fast::hash(&file));
    let begin = |channel| Command::BlobBegin { channel, path: path("f"), bytes, checksum };
    robot.ask(&mut owner, &begin(channel));
    send_piece(&owner, &mut robot.hub, 80, channel, "f", 0, &file.slice(..500_000));
    // Half of a piece comes, the connection is lost, and then the disk does what it was asked.
    owner.send_flagged(
        &mut robot.hub,
        81,
        Flags::FIRST,
        &Command::BlobWrite {
            channel,
            path: path("f"),
            offset: 500_000,
            payload: file.slice(500_000..510_000),
        },
    );
    robot.hub.left(owner.id, at(0));
    robot.work();
    let mut back = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut back, "maps");
    assert_eq!(robot.ask(&mut back, &begin(channel)), [Event::BlobResume { offset: 500_000 }]);
    assert_eq!(
        robot.ask(&mut back, &Command::BlobList { channel, path: path("") }).len(),
        1,
        "nothing is seen"
    );
    send_piece(&back, &mut robot.hub, 80, channel, "f", 500_000, &file.slice(500_000..));
    assert_eq!(tagged(&robot.settle(&mut back), 80), [Event::Done {}]);
    assert_eq!(robot.ask(&mut back, &Command::BlobCommit { channel, path: path("f") }), [Event::Saved {}]);
    assert_eq!(robot.read(&mut back, channel, "f", 0, u32::MAX), file);
}

#[test]
fn files_are_there_again_when_the_channel_and_the_hub_return() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    robot.upload(&mut owner, channel, "f", &content(5000));
    robot.ask(&mut owner, &Command::RemoveChannel { channel });
    let channel = robot.create(&mut owner, "maps");
    assert_eq!(robot.read(&mut owner, channel, "f", 0, u32::MAX), content(5000));
    let disk = robot.disk.clone();
    drop(robot);
    disk.power_cut();
    let mut robot = Robot::start(disk);
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    assert_eq!(robot.read(&mut owner, channel, "f", 0, u32::MAX), content(5000));
}

#[test]
fn a_removed_channel_ends_what_was_under_way_there() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    robot.upload(&mut owner, channel, "f", &content(3_000_000));
    for index in 0..300 {
        robot.ask(&mut owner, &Command::BlobMkdir { channel, path: path(&format!("d{index}")) });
    }
    let mut reader = Raw::flow(&mut robot.hub, OWNER);
    let mut lister = Raw::flow(&mut robot.hub, OWNER);
    let read = Command::BlobRead { channel, path: path("f"), offset: 0, bytes: u32::MAX };
    reader.send(&mut robot.hub, 81, &read);
    robot.work();
    assert!(matches!(messages(reader.read_one(&mut robot.hub))[..], [Event::BlobData { .. }]));
    lister.send(&mut robot.hub, 82, &Command::BlobList { channel, path: path("") });
    robot.ask(&mut owner, &Command::RemoveChannel { channel });
    let of_read = tagged(&robot.settle(&mut reader), 81);
    assert_eq!(of_read.last(), refused(RefusalCode::Gone).last(), "after {} fragments", of_read.len());
    let of_list = tagged(&robot.settle(&mut lister), 82);
    assert_eq!(of_list.last(), refused(RefusalCode::Gone).last(), "after {} lines", of_list.len());
    assert!(messages(lister.read(&mut robot.hub)).is_empty());
    lister.send(&mut robot.hub, 83, &Command::Ping {});
    assert_eq!(tagged(&robot.settle(&mut lister), 83), [Event::Pong {}], "the connection goes on");
}

#[test]
fn a_long_list_comes_in_order_and_waits_for_a_slow_reader() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    for index in 0..1000 {
        robot.ask(&mut owner, &Command::BlobMkdir { channel, path: path(&format!("d{index:04}")) });
    }
    for mut reader in [Raw::flow(&mut robot.hub, OWNER), Raw::synchronous(&mut robot.hub, OWNER)] {
        reader.send(&mut robot.hub, 82, &Command::BlobList { channel, path: path("") });
        reader.send(&mut robot.hub, 83, &Command::Ping {});
        let events = robot.settle(&mut reader);
        let names: Vec<&str> = events
            .iter()
            .filter_map(|event| match &event.message {
                Event::BlobListed { name, directory: 1, .. } => Some(name.as_str()),
                _ => None,
            })
            .collect();
        assert_eq!(names.len(), 1000);
        assert!(names.is_sorted());
        let last = events.iter().rev().take(2).map(|event| event.tag).collect::<Vec<_>>();
        assert_eq!(last, [83, 82], "the ping is answered after the list");
    }
}

#[test]
fn downloads_take_turns_with_messages_and_hold_little_for_who_does_not_read() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    let stream = owner.create(&mut robot.hub, "stream");
    robot.upload(&mut owner, channel, "f", &content(8_000_000));
    let mut reader = Raw::flow(&mut robot.hub, OWNER);
    reader.subscribe(&mut robot.hub, stream);
    let read = Command::BlobRead { channel, path: path("f"), offset: 0, bytes: u32::MAX };
    reader.send(&mut robot.hub, 81, &read);
    while robot.work() > 0 {}
    assert_eq!(robot.hub.unanswered_blob_requests(), 0, "the disk is not asked for more than is read");
    owner.publish(&mut robot.hub, stream, Bytes::from_static(b"light"));
    let mut before = 0;
    loop {
        let event = messages(reader.read_one(&mut robot.hub)).pop().expect("something comes");
        match event {
            Event::Data { .. } => break,
            Event::BlobData { payload } => before += payload.len(),
            _ => {}
        }
    }
    assert!(before <= 4 * FRAGMENT_BYTES_MAX, "{before} bytes of the download came first");
    let rest = robot.settle(&mut reader);
    let bytes: usize = rest
        .iter()
        .map(|event| match &event.message {
            Event::BlobData { payload } => payload.len(),
            _ => 0,
        })
        .sum();
    assert_eq!(before + bytes, 8_000_000);
}

#[test]
fn a_connection_is_not_read_while_the_disk_is_behind_with_its_uploads() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    let piece = content(1024 * 1024);
    let total = 6 * piece.len();
    let begin = Command::BlobBegin { channel, path: path("f"), bytes: total as u64, checksum: 0 };
    robot.ask(&mut owner, &begin);
    let mut wanted = Vec::new();
    for index in 0..5 {
        send_piece(
            &owner,
            &mut robot.hub,
            90 + index,
            channel,
            "f",
            (index as usize * piece.len()) as u64,
            &piece,
        );
        while robot.hub.work(at(0)) {}
        wanted.push(robot.hub.wants_input(owner.id));
    }
    assert_eq!(wanted, [true, true, true, false, false], "{BLOB_BYTES_AHEAD_MAX} bytes wait");
    let done = robot.settle(&mut owner);
    let done = done.iter().filter(|event| event.message == Event::Done {}).count();
    assert_eq!(done, 5);
    assert!(robot.hub.wants_input(owner.id));
}

#[test]
fn more_downloads_at_once_than_may_be_are_refused() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    robot.upload(&mut owner, channel, "f", &content(10));
    for tag in 0..BLOB_READS_PER_CONNECTION_MAX as u32 + 1 {
        let read = Command::BlobRead { channel, path: path("f"), offset: 0, bytes: 10 };
        owner.send(&mut robot.hub, 100 + tag, &read);
    }
    while robot.hub.work(at(0)) {}
    let events = robot.settle(&mut owner);
    for tag in 0..BLOB_READS_PER_CONNECTION_MAX as u32 {
        assert_eq!(whole(&events, 100 + tag), content(10));
    }
    let last = 100 + BLOB_READS_PER_CONNECTION_MAX as u32;
    assert_eq!(refusal(&events, last), Some(RefusalCode::TooManyRequests));
}

#[test]
fn a_failing_disk_is_said_and_nothing_half_is_seen() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    robot.upload(&mut owner, channel, "f", &content(1000));
    let full = DiskFaults { bytes_max: Some(2000), ..DiskFaults::default() };
    robot.disk.set_faults(full, SimulatedRng::new(1, 1));
    let file = content(50_000);
    let (bytes, checksum) = (file.len() as u64, crc32fast::hash(&file));
    let begin = Command::BlobBegin { channel, path: path("f"), bytes, checksum };
    assert_eq!(robot.ask(&mut owner, &begin), [Event::BlobResume { offset: 0 }]);
    send_piece(&owner, &mut robot.hub, 80, channel, "f", 0, &file);
    assert_eq!(refusal(&robot.settle(&mut owner), 80), Some(RefusalCode::Storage));
    assert_eq!(robot.read(&mut owner, channel, "f", 0, u32::MAX), content(1000), "the old one stands");
    robot.disk.set_faults(DiskFaults::default(), SimulatedRng::new(1, 1));
    send_piece(&owner, &mut robot.hub, 80, channel, "f", 0, &file);
    assert_eq!(tagged(&robot.settle(&mut owner), 80), [Event::Done {}], "there is room again");
    assert_eq!(
        robot.ask(&mut owner, &Command::BlobCommit { channel, path: path("f") }),
        [Event::Saved {}]
    );
    assert_eq!(robot.read(&mut owner, channel, "f", 0, u32::MAX), file);
}

#[test]
fn a_tag_that_begins_twice_is_dishonest_and_late_fragments_are_dropped() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    let write = |payload: &'static [u8]| {
        let payload = Bytes::from_static(payload);
        Command::BlobWrite { channel, path: path("f"), offset: 0, payload }
    };
    owner.send_flagged(&mut robot.hub, 5, Flags::LAST, &write(b"rest"));
    assert_eq!(robot.hub.late_fragments(), 1, "of a piece that was refused");
    owner.send_flagged(&mut robot.hub, 5, Flags::FIRST, &write(b"a"));
    owner.send_flagged(&mut robot.hub, 5, Flags::ABORT, &write(b""));
    assert_eq!(robot.settle(&mut owner).len(), 0, "a piece that was given up has no answer");
    owner.send_flagged(&mut robot.hub, 5, Flags::FIRST, &write(b"a"));
    owner.send_flagged(&mut robot.hub, 5, Flags::FIRST, &write(b"a"));
    assert!(matches!(ending(&mut robot.hub, owner.id), Some(Ending::Spurious(_))));
}

#[test]
fn so_many_pieces_may_be_begun_at_once_and_no_more() {
    let mut robot = Robot::new();
    let mut owner = Raw::flow(&mut robot.hub, OWNER);
    let channel = robot.create(&mut owner, "maps");
    let write = |offset| Command::BlobWrite { channel, path: path("a"), offset, payload: content(1) };
    let begin = |robot: &mut Robot, owner: &mut Raw, tag| {
        owner.send_flagged(&mut robot.hub, tag, Flags::FIRST, &write(0));
        refusal(&owner.read(&mut robot.hub), tag)
    };
    let many = BLOB_REQUESTS_PER_CONNECTION_MAX as u32;
    for tag in 1..=many {
        assert_eq!(begin(&mut robot, &mut owner, tag), None, "{tag}");
    }
    assert_eq!(begin(&mut robot, &mut owner, many + 1), Some(RefusalCode::TooManyRequests));
    owner.send_flagged(&mut robot.hub, 1, Flags::LAST, &write(0));
    assert_eq!(begin(&mut robot, &mut owner, many + 2), None, "one has ended");
    assert_eq!(robot.hub.spurious(), 0);
}
