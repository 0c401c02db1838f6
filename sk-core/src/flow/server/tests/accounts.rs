//! Accounts: login by password, adding, changing, removing, and what of them outlives the hub.

use super::*;
use crate::flow::Value;
use crate::flow::scram::{ClientExchange, ClientKeys, Password, ROUNDS_MIN, Verifier};
use std::sync::LazyLock;

pub(super) const STRANGER: Origin = Origin::Network(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST));

/// The keys of every account of these tests: deriving them takes its time.
static KEYS: LazyLock<ClientKeys> =
    LazyLock::new(|| ClientKeys::derive(&Password::new("pencil"), [7; 16], ROUNDS_MIN));
static OTHER_KEYS: LazyLock<ClientKeys> =
    LazyLock::new(|| ClientKeys::derive(&Password::new("eraser"), [7; 16], ROUNDS_MIN));

pub(super) fn verifier() -> Verifier {
    KEYS.verifier()
}

pub(super) fn name(text: &str) -> Name {
    text.parse().expect("a name")
}

fn user_set(user: &str, keys: &ClientKeys) -> Command {
    let (rounds, salt, stored_key, server_key) = keys.verifier().parts();
    Command::UserSet { user: user.into(), rounds, salt, stored_key, server_key }
}

fn remove(user: &str) -> Command {
    Command::UserRemove { user: user.into() }
}

fn refused(code: RefusalCode) -> Vec<Event> {
    vec![Event::Refused { code: code.code(), text: code.to_string() }]
}

fn closed(reason: ClosingReason) -> Event {
    Event::Closing { reason: reason.code(), text: reason.to_string() }
}

/// Tries to log in; answers the connection, whatever became of it, and the last event.
fn try_log_in(hub: &mut ServerCore, user: &str, keys: &ClientKeys) -> (Raw, Event) {
    let mut raw = Raw::open(hub, STRANGER);
    raw.send(hub, 1, &Raw::hello(FRAGMENT_BYTES_MAX as u32));
    raw.read(hub);
    let mut exchange = ClientExchange::new(user, &[2; 32]);
    let challenge = raw.ask(hub, &Command::LoginScram { message: exchange.first() });
    let [Event::ScramChallenge { message }] = &challenge[..] else { panic!("{challenge:?}") };
    exchange
        .challenged(message, Password::new(""))
        .expect("a challenge for this login");
    let message = exchange.last(keys).expect("the challenge was for this login");
    raw.send(hub, 79, &Command::LoginScramProof { message });
    let mut events = messages(raw.read(hub));
    if let [Event::LoggedIn { user: found, proof, .. }] = &events[..] {
        assert!(found == user && exchange.hub_is_true(proof), "the hub knows the account too");
    }
    let last = events.pop().expect("an answer");
    (raw, last)
}

/// A synchronous connection that is logged in to this account by password.
pub(super) fn log_in(hub: &mut ServerCore, user: &str) -> Raw {
    let (raw, last) = try_log_in(hub, user, &KEYS);
    assert!(matches!(last, Event::LoggedIn { .. }), "{last:?}");
    raw
}

/// A flow of this account.
pub(super) fn flow_of(hub: &mut ServerCore, user: &str) -> Raw {
    let mut raw = log_in(hub, user);
    raw.send(hub, 1, &set_async());
    raw.read(hub);
    assert_eq!(raw.inbound.state(), State::Flow);
    raw
}

#[test]
fn s89_the_right_password_logs_in_and_everything_else_is_closed_alike() {
    let mut hub = hub();
    hub.add_account(name("ada"), verifier());
    log_in(&mut hub, "ada");
    for (user, keys) in [("ada", &*OTHER_KEYS), ("bob", &*KEYS), ("robot", &*KEYS), ("A b", &*KEYS)] {
        let (raw, last) = try_log_in(&mut hub, user, keys);
        assert_eq!(last, closed(ClosingReason::LoginFailed), "{user}");
        assert_eq!(ending(&mut hub, raw.id), Some(Ending::Closed(ClosingReason::LoginFailed)));
    }
    assert_eq!(hub.spurious(), 0);
}

#[test]
fn a_connection_has_one_attempt_and_its_messages_come_in_order() {
    let first = || Command::LoginScram { message: ClientExchange::new("ada", &[2; 32]).first() };
    let last = || Command::LoginScramProof { message: "c=biws,r=x,p=AAAA".into() };
    let bad = || Command::LoginScram { message: "p=tls-unique,,n=ada,r=x".into() };
    let token = || Command::LoginToken { proof: OwnerToken::new([7; 32]).client_proof(&[2; 32], &[1; 32]) };
    let cases = [
        vec![last()],
        vec![bad()],
        vec![first(), first()],
        vec![first(), last()],
        vec![first(), Command::LoginPeer {}],
        vec![first(), token()],
    ];
    for case in cases {
        let mut hub = hub();
        hub.add_account(name("ada"), verifier());
        let mut raw = Raw::open(&mut hub, OWNER);
        raw.send(&mut hub, 1, &Raw::hello(1024));
        for command in &case {
            raw.send(&mut hub, 2, command);
        }
        let events = messages(raw.read(&mut hub));
        assert_eq!(events.last(), Some(&closed(ClosingReason::LoginFailed)), "{case:?}");
    }
}

#[test]
fn s90_an_account_that_is_not_known_never_becomes_a_flow() {
    let mut hub = hub();
    for stop_after in 0..3 {
        let mut raw = Raw::open(&mut hub, STRANGER);
        raw.send(&mut hub, 1, &Raw::hello(1024));
        let first = Command::LoginScram { message: ClientExchange::new("ada", &[2; 32]).first() };
        let last = Command::LoginScramProof { message: "c=biws,r=x,p=AAAA".into() };
        for command in [first, last].iter().take(stop_after) {
            raw.send(&mut hub, 2, command);
        }
        raw.send(&mut hub, 3, &set_async());
        raw.read(&mut hub);
        assert!(hub.connection(raw.id).is_none(), "after {stop_after} messages of a login");
    }
}

#[test]
fn s88_s91_many_flows_of_one_account_work_side_by_side_each_with_an_id_of_its_own() {
    let mut hub = hub();
    hub.add_account(name("ada"), verifier());
    let mut flows: Vec<Raw> = (0..8).map(|_| flow_of(&mut hub, "ada")).collect();
    let ids: std::collections::BTreeSet<u64> = flows.iter().map(|flow| flow.id.wire()).collect();
    assert_eq!(ids.len(), flows.len());
    for flow in &mut flows {
        assert_eq!(flow.ask(&mut hub, &Command::Ping {}), [Event::Pong {}]);
    }
    let gone = flows.remove(0);
    hub.left(gone.id, at(0));
    for flow in &mut flows {
        assert_eq!(
            flow.ask(&mut hub, &Command::Ping {}),
            [Event::Pong {}],
            "they do not depend on each other"
        );
    }
    let next = flow_of(&mut hub, "ada");
    assert!(!ids.contains(&next.id.wire()), "a former id finds nobody");
}

#[test]
fn without_a_disk_accounts_cannot_be_changed() {
    let mut hub = hub();
    let mut owner = Raw::synchronous(&mut hub, OWNER);
    assert_eq!(owner.ask(&mut hub, &user_set("ada", &KEYS)), refused(RefusalCode::NotOffered));
    hub.add_account(name("ada"), verifier());
    assert_eq!(owner.ask(&mut hub, &remove("ada")), refused(RefusalCode::NotOffered));
    log_in(&mut hub, "ada");
}

#[test]
fn who_may_change_which_account() {
    let mut robot = stored::Robot::new();
    let mut owner = Raw::synchronous(&mut robot.hub, OWNER);
    let mut module = Raw::flow(&mut robot.hub, Origin::Inside { rights: Rights::NONE });
    for user in ["ada", "bob"] {
        assert_eq!(robot.ask(&mut owner, &user_set(user, &KEYS)), [Event::Saved {}]);
    }
    for bad in ["", "Ada", "a.b", "a b", &"a".repeat(65)] {
        assert_eq!(robot.ask(&mut owner, &user_set(bad, &KEYS)), refused(RefusalCode::BadUser), "{bad:?}");
    }
    let weak = Command::UserSet {
        user: "ada".into(),
        rounds: ROUNDS_MIN - 1,
        salt: [0; 16],
        stored_key: [0; 32],
        server_key: [0; 32],
    };
    assert_eq!(robot.ask(&mut owner, &weak), refused(RefusalCode::BadUser));
    let mut ada = log_in(&mut robot.hub, "ada");
    let denied = refused(RefusalCode::Denied);
    for user in ["bob", "robot", "carl"] {
        assert_eq!(robot.ask(&mut ada, &user_set(user, &OTHER_KEYS)), denied, "{user}");
        assert_eq!(robot.ask(&mut module, &user_set(user, &OTHER_KEYS)), denied, "{user}");
    }
    for command in [remove("bob"), remove("ada"), Command::UserList {}] {
        assert_eq!(robot.ask(&mut ada, &command), denied, "{command:?}");
    }
    assert_eq!(robot.ask(&mut owner, &remove("robot")), refused(RefusalCode::BadUser));
    assert_eq!(robot.ask(&mut owner, &remove("carl")), refused(RefusalCode::NoSuchUser));
    assert_eq!(robot.ask(&mut ada, &user_set("ada", &OTHER_KEYS)), [Event::Saved {}], "its own");
    assert_eq!(try_log_in(&mut robot.hub, "ada", &KEYS).1, closed(ClosingReason::LoginFailed));
    assert!(matches!(try_log_in(&mut robot.hub, "ada", &OTHER_KEYS).1, Event::LoggedIn { .. }));
    assert_eq!(robot.ask(&mut owner, &user_set("robot", &KEYS)), [Event::Saved {}], "the owner's own");
    let mut owner_by_password = log_in(&mut robot.hub, "robot");
    let listed = |user: &str, connections| Event::UserListed { user: user.into(), connections };
    assert_eq!(
        robot.ask(&mut owner_by_password, &Command::UserList {}),
        [listed("ada", 2), listed("bob", 0), listed("robot", 3), Event::ListEnd { count: 3 }]
    );
}

#[test]
fn an_account_is_there_again_after_the_hubs_end_once_it_was_acknowledged() {
    let mut robot = stored::Robot::new();
    let mut owner = Raw::synchronous(&mut robot.hub, OWNER);
    robot.ask(&mut owner, &user_set("ada", &KEYS));
    owner.send(&mut robot.hub, 5, &user_set("bob", &KEYS));
    assert_eq!(messages(owner.read(&mut robot.hub)), [], "it is not on the disk yet");
    let mut robot = robot.die_and_return();
    log_in(&mut robot.hub, "ada");
    assert_eq!(try_log_in(&mut robot.hub, "bob", &KEYS).1, closed(ClosingReason::LoginFailed));
    let mut owner = Raw::synchronous(&mut robot.hub, OWNER);
    owner.send(&mut robot.hub, 6, &user_set("carl", &KEYS));
    robot.fail();
    assert_eq!(refusal(&owner.read(&mut robot.hub), 6), Some(RefusalCode::Storage));
    assert_eq!(
        robot.ask(&mut owner, &user_set("dora", &KEYS)),
        [Event::Saved {}],
        "the next one is whole"
    );
    let mut robot = robot.die_and_return();
    for user in ["ada", "carl", "dora"] {
        log_in(&mut robot.hub, user);
    }
}

#[test]
fn a_removed_account_ends_with_its_connections_and_leaves_no_rights_to_the_next_of_its_name() {
    let mut robot = stored::Robot::new();
    let mut owner = Raw::synchronous(&mut robot.hub, OWNER);
    robot.ask(&mut owner, &user_set("ada", &KEYS));
    robot.ask(&mut owner, &Command::DbSelect { database: "user:ada".into() });
    let everything = Value::new(&SkVariant::list(["*"])).expect("small");
    let grant = Command::VarSet { key: "right.publish".into(), value: everything };
    assert_eq!(robot.ask(&mut owner, &grant), [Event::Saved {}]);
    let mut robot = robot.die_and_return();
    let mut owner = Raw::synchronous(&mut robot.hub, OWNER);
    let mut ada = flow_of_after_loading(&mut robot);
    let channel = ada.create(&mut robot.hub, "imu");
    assert_eq!(robot.ask(&mut owner, &remove("ada")), [Event::Saved {}]);
    assert_eq!(messages(ada.read(&mut robot.hub)).last(), Some(&closed(ClosingReason::AccountRemoved)));
    assert!(robot.hub.channels().all(|(known, _)| known.reference != channel));
    assert_eq!(try_log_in(&mut robot.hub, "ada", &KEYS).1, closed(ClosingReason::LoginFailed));
    for restart in [false, true] {
        if restart {
            robot = robot.die_and_return();
        }
        let mut owner = Raw::synchronous(&mut robot.hub, OWNER);
        robot.ask(&mut owner, &user_set("ada", &KEYS));
        let mut ada = flow_of_after_loading(&mut robot);
        let create = Command::CreateStream { name: "imu".into(), properties: no_properties() };
        assert_eq!(robot.ask(&mut ada, &create), refused(RefusalCode::Denied), "restart: {restart}");
        robot.ask(&mut owner, &remove("ada"));
    }
}

/// A flow of `ada`, whose rights are on the disk: its commands wait until they have come.
fn flow_of_after_loading(robot: &mut stored::Robot) -> Raw {
    let mut raw = log_in(&mut robot.hub, "ada");
    raw.send(&mut robot.hub, 1, &set_async());
    while robot.work() > 0 {}
    raw.read(&mut robot.hub);
    assert_eq!(raw.inbound.state(), State::Flow);
    raw
}

#[test]
fn t19_one_entry_that_cannot_be_read_and_no_account_is_taken_in() {
    let good = ("ada".into(), Value::new(&verifier().variant()).expect("small"));
    let number = Value::new(&1.into()).expect("small");
    for bad in [("bob", number.clone()), ("a.b", good.1.clone()), ("Ada", good.1.clone())] {
        let mut hub = hub();
        hub.keep_databases([]);
        let contents = vec![good.clone(), (bad.0.into(), bad.1)];
        assert_eq!(hub.keep_accounts(&contents), Err(AccountsError(bad.0.into())));
        assert_eq!(try_log_in(&mut hub, "ada", &KEYS).1, closed(ClosingReason::LoginFailed));
    }
}

#[test]
fn no_command_reaches_the_database_of_the_accounts() {
    let mut robot = stored::Robot::new();
    let mut owner = Raw::synchronous(&mut robot.hub, OWNER);
    robot.ask(&mut owner, &user_set("ada", &KEYS));
    let database = "hub:accounts".to_owned();
    for command in [
        Command::DbSelect { database: database.clone() },
        Command::DbExists { database: database.clone() },
        Command::DbCreate { database: database.clone(), durable: 1 },
        Command::DbRemove { database },
    ] {
        assert_eq!(robot.ask(&mut owner, &command), refused(RefusalCode::BadName), "{command:?}");
    }
    let listed = robot.ask(&mut owner, &Command::DbList { prefix: "hub".into() });
    assert_eq!(listed, [Event::ListEnd { count: 0 }]);
}

#[test]
fn an_account_has_so_many_connections_and_no_more_and_others_still_find_a_place() {
    let mut hub = hub();
    for user in ["ada", "bob"] {
        hub.add_account(name(user), verifier());
    }
    let of_ada: Vec<Raw> = (0..CONNECTIONS_PER_ACCOUNT_MAX).map(|_| log_in(&mut hub, "ada")).collect();
    let (refused, last) = try_log_in(&mut hub, "ada", &KEYS);
    assert_eq!(last, closed(ClosingReason::Crowded));
    assert_eq!(ending(&mut hub, refused.id), Some(Ending::Closed(ClosingReason::Crowded)));
    log_in(&mut hub, "bob");
    Raw::flow(&mut hub, OWNER);
    hub.left(of_ada[0].id, at(0));
    log_in(&mut hub, "ada");
    let (_, last) = try_log_in(&mut hub, "ada", &KEYS);
    assert_eq!(last, closed(ClosingReason::Crowded));
}
