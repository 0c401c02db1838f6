//! What a flow that does nothing costs the hub, counted by the allocator.

use sk_core::flow::server::{ConnectionId, Origin, ServerCore, Settings};
use sk_core::flow::{Command, Flags, Form, Message, Rights, Value};
use sk_core::testing::CountingAllocator;
use sk_flat::{Instant, SkVariant};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

const FLOWS: usize = 1000;
/// For a flow's database and its entries in the registries.
const DATABASE_BYTES_MAX: i64 = 2 * 1024;

fn send(hub: &mut ServerCore, connection: ConnectionId, command: &Command) {
    hub.receive(connection, &command.encode(1, Flags::NONE).to_vec(), Instant::ZERO);
    while hub.work(Instant::ZERO) {}
    while hub.take(connection).is_some() {}
    while hub.next_notice().is_some() {}
}

fn logged_in(hub: &mut ServerCore) -> ConnectionId {
    let connection = hub
        .open(Origin::Inside { rights: Rights::ALL }, [1; 32], Instant::ZERO)
        .expect("a place");
    let hello = Command::Hello {
        magic: *b"SpecialK",
        version: 1,
        version_oldest: 1,
        fragment_bytes: 65_536,
        message_bytes: 1 << 24,
        nonce: [2; 32],
    };
    send(hub, connection, &hello);
    send(hub, connection, &Command::LoginPeer {});
    connection
}

/// What a satellite says of its pulse once a second.
fn statistics() -> SkVariant {
    let figures = || {
        let span = || SkVariant::from(0.000_125);
        SkVariant::map([("p50", span()), ("p99", span()), ("max", span())])
    };
    let counts = ["ticks", "missed", "overruns", "sync_lost"].map(|name| (name, 1_000_000_u64.into()));
    let spans = [("interval", 0.01.into()), ("mean_interval", 0.01.into())];
    let maps = [("wake_error", figures()), ("job_time", figures())];
    SkVariant::map(counts.into_iter().chain(spans).chain(maps))
}

#[test]
fn an_idle_flows_database_and_entries_take_less_than_two_kilobytes() {
    let user = "robot".parse().expect("a name");
    let mut hub = ServerCore::new(Settings { user, token: None, owner_uid: None }, Instant::ZERO);
    let connections: Vec<ConnectionId> = (0..FLOWS).map(|_| logged_in(&mut hub)).collect();
    let before = CountingAllocator::held_bytes();
    for connection in &connections {
        let set_async = Command::SetAsync { name: String::new(), session: [0; 16], form: Form::Binary };
        send(&mut hub, *connection, &set_async);
    }
    let entries = (CountingAllocator::held_bytes() - before) / FLOWS as i64;
    for connection in &connections {
        let database = format!("flow:robot.flow-{}", connection.wire());
        send(&mut hub, *connection, &Command::DbSelect { database });
        let told = [
            ("pulse.interval_ms", 5.0.into()),
            ("pulse.mode", "SelectIo".into()),
            ("pulse.statistics", statistics()),
        ];
        for (key, variant) in told {
            let value = Value::new(&variant).expect("small");
            send(&mut hub, *connection, &Command::VarSet { key: key.into(), value });
        }
    }
    let with_values = (CountingAllocator::held_bytes() - before) / FLOWS as i64;
    println!("{entries} bytes of entries for a flow, {with_values} with what its satellite says of itself");
    assert!(entries > 0 && with_values > entries, "nothing was counted");
    assert!(with_values <= DATABASE_BYTES_MAX, "{with_values} bytes");
}
