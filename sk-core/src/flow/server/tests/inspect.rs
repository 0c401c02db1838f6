//! What the hub tells of itself.

use super::*;
use crate::flow::report::{ChannelReport, FlowsReport, GraphReport, HubReport, WhyReport};
use sk_flat::FromVariant;

fn ask<T: FromVariant>(hub: &mut ServerCore, raw: &mut Raw, subject: &str) -> T {
    let answer = |hub: &mut ServerCore, raw: &mut Raw, form| {
        raw.send(hub, 30, &Command::Inspect { subject: subject.into(), form });
        match tagged(&raw.read(hub), 30).pop() {
            Some(Event::Value { value }) => value,
            other => panic!("no answer to {subject}, but {other:?}"),
        }
    };
    let json = answer(hub, raw, Form::Json);
    let binary = answer(hub, raw, Form::Binary);
    assert_eq!(json.form(), Form::Json);
    assert!(T::from_variant(&json.variant()).is_ok(), "JSON says the same");
    T::from_variant(&binary.variant()).expect("what the hub says is what the type reads")
}

/// A flow of this name, with all rights.
fn flow(hub: &mut ServerCore, name: &str) -> Raw {
    let mut raw = Raw::synchronous(hub, OWNER);
    raw.send(hub, 1, &Command::SetAsync { name: name.into(), session: [0; 16], form: Form::Binary });
    raw.read(hub);
    raw
}

#[test]
fn the_hub_its_connections_channels_and_graph_are_told() {
    let mut hub = hub();
    let [mut arm, mut eye, mut view] = ["arm", "eye", "view"].map(|name| flow(&mut hub, name));
    let camera = eye.create_with(&mut hub, "camera", with_properties([("latch", true.into())]));
    let copy = view.create(&mut hub, "copy");
    view.send(&mut hub, 2, &Command::Attach { replica: copy, source: camera });
    arm.subscribe_as(&mut hub, camera, Policy::All, 7);
    arm.subscribe(&mut hub, copy);
    eye.publish(&mut hub, camera, Bytes::from_static(b"picture"));
    hub.tick(at(500));
    let told: HubReport = ask(&mut hub, &mut view, "hub");
    assert_eq!((told.connections, told.flows, told.channels, told.subscriptions), (3, 3, 2, 2));
    assert_eq!((told.counts.offered, told.counts.queued), (2, 2));
    assert_eq!(told.up, Duration::from_millis(500));
    assert_eq!(told.bytes_waiting as usize, hub.bytes_waiting());
    assert_eq!(told.limits["bytes waiting in all"] as usize, HUB_BYTES_MAX);
    let told: FlowsReport = ask(&mut hub, &mut view, "flows");
    let names: Vec<_> = told.flows.iter().map(|one| one.flow.clone().unwrap_or_default()).collect();
    assert_eq!(names, ["robot.arm", "robot.eye", "robot.view"]);
    assert_eq!((told.flows[0].subscriptions, told.flows[1].channels, told.left_out), (2, 1, 0));
    assert_eq!((told.flows[0].state.as_str(), told.flows[0].origin.as_str()), ("flow", "local user 1000"));
    let told: ChannelReport = ask(&mut hub, &mut view, "channel robot.camera");
    assert_eq!((told.owner.as_str(), told.owner_id, told.published), ("robot.eye", eye.id.wire(), 1));
    assert!(told.latch && told.heard && told.bytes_latched > 7 && told.credit.is_none());
    assert_eq!(told.repeated_by, ["robot.copy"]);
    let [subscriber] = told.subscribers.as_slice() else { panic!("one subscribes: {told:?}") };
    assert_eq!((subscriber.flow.as_str(), subscriber.policy.as_str()), ("robot.arm", "all"));
    assert_eq!((subscriber.depth, subscriber.counts.queued), (Some(7), 1));
    let told: GraphReport = ask(&mut hub, &mut view, "graph");
    assert_eq!(told.flows, ["robot.arm", "robot.eye", "robot.view"]);
    let lines: Vec<String> = told
        .channels
        .iter()
        .map(|one| format!("{} -> {} -> {:?}, {:?}", one.owner, one.name, one.subscribers, one.repeats))
        .collect();
    assert_eq!(
        lines,
        [
            r#"robot.eye -> robot.camera -> ["robot.arm"], None"#,
            r#"robot.view -> robot.copy -> ["robot.arm"], Some("robot.camera")"#,
        ]
    );
}

#[test]
fn subjects_that_are_none_are_refused_and_who_may_not_list_may_not_look() {
    let mut hub = hub();
    let mut raw = flow(&mut hub, "arm");
    for (subject, code) in [
        ("", RefusalCode::NoSuchSubject),
        ("hub more", RefusalCode::NoSuchSubject),
        ("channel", RefusalCode::NoSuchSubject),
        ("channel robot.x more", RefusalCode::NoSuchSubject),
        ("why robot.x", RefusalCode::NoSuchSubject),
        ("channel robot.x", RefusalCode::Gone),
    ] {
        raw.send(&mut hub, 3, &Command::Inspect { subject: subject.into(), form: Form::Binary });
        assert_eq!(refusal(&raw.read(&mut hub), 3), Some(code), "{subject:?}");
    }
    let mut stranger =
        Raw::flow(&mut hub, Origin::Inside { rights: Rights::NONE.with(crate::flow::Right::Publish) });
    stranger.send(&mut hub, 3, &Command::Inspect { subject: "hub".into(), form: Form::Binary });
    assert_eq!(refusal(&stranger.read(&mut hub), 3), Some(RefusalCode::Denied));
}

#[test]
fn a_list_that_is_too_long_for_one_answer_says_how_much_it_leaves_out() {
    for (count, left_out) in [(999, 0), (1000, 0), (1001, 1)] {
        let mut hub = hub();
        let mut raw = flow(&mut hub, "arm");
        for _ in 1..count {
            hub.open(Origin::Inside { rights: Rights::ALL }, [1; 32], at(0))
                .expect("a place");
        }
        let told: FlowsReport = ask(&mut hub, &mut raw, "flows");
        assert_eq!(told.left_out, left_out, "{count} connections");
    }
}

#[test]
fn why_says_at_each_hop_whether_data_passes() {
    let mut hub = hub();
    let [mut eye, mut arm] = ["eye", "arm"].map(|name| flow(&mut hub, name));
    let why = |hub: &mut ServerCore, raw: &mut Raw, from: &str, to: &str| {
        let told: WhyReport = ask(hub, raw, &format!("why {from} {to}"));
        assert_eq!(told.passes, told.hops.iter().all(|hop| hop.passes));
        let last = told.hops.last().expect("a hop").clone();
        (
            told.passes,
            told.hops.iter().map(|hop| hop.says.clone()).collect::<Vec<_>>().join(" | "),
            last.at,
        )
    };
    let ends = |(passes, says, at): (bool, String, String), where_: &str, word: &str| {
        assert!(!passes && at == where_ && says.contains(word), "{says} at {at}");
    };
    ends(why(&mut hub, &mut arm, "robot.x", "robot.arm"), "robot.x", "no such channel");
    ends(why(&mut hub, &mut arm, "robot.eye", "robot.arm"), "robot.eye", "owns no channel");
    let camera = eye.create(&mut hub, "camera");
    ends(why(&mut hub, &mut arm, "robot.camera", "robot.leg"), "robot.leg", "no such flow");
    ends(
        why(&mut hub, &mut arm, "robot.camera", "robot.arm"),
        "robot.arm",
        "nothing was published yet",
    );
    ends(
        why(&mut hub, &mut arm, "robot.eye", "robot.arm"),
        "robot.arm",
        "subscribes to none of the 1",
    );
    eye.publish(&mut hub, camera, Bytes::from_static(b"1"));
    ends(why(&mut hub, &mut arm, "robot.camera", "robot.arm"), "robot.arm", "is not subscribed");
    arm.subscribe_as(&mut hub, camera, Policy::Latest, 1);
    let mut other = flow(&mut hub, "tool");
    for _ in 0..3 {
        eye.publish(&mut hub, camera, Bytes::from_static(b"2"));
    }
    ends(
        why(&mut hub, &mut other, "robot.camera", "robot.arm"),
        "robot.arm",
        "2 (newest-wins); 1 wait",
    );
    arm.read(&mut hub);
    let (passes, says, _) = why(&mut hub, &mut other, "robot.eye", "robot.arm");
    assert!(passes && says.contains("1 of 3 messages were delivered"), "{says}");
    let copy = other.create(&mut hub, "copy");
    other.send(&mut hub, 5, &Command::Attach { replica: copy, source: camera });
    other.subscribe(&mut hub, copy);
    eye.publish(&mut hub, camera, Bytes::from_static(b"3"));
    other.read(&mut hub);
    let (passes, says, _) = why(&mut hub, &mut arm, "robot.camera", "robot.tool");
    assert!(passes && says.contains("is repeated by robot.copy"), "{says}");
    hub.tick(at(2100));
    ends(why(&mut hub, &mut other, "robot.camera", "robot.tool"), "robot.tool", "the last 2 s ago");
}
