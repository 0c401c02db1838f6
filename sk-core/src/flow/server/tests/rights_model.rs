//! Whatever is granted, revoked, opened and asked in whatever order: nobody ever does more than his rights, every
//! flow knows exactly the channels that it may see, every call has one end, and the books balance.

use super::accounts::flow_of;
use super::rights::{grant, hub_with};
use super::*;
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

const RIGHTS: [&str; 7] = ["list", "publish", "subscribe", "serve", "call", "database_read", "administer"];
const PATTERNS: [&[&str]; 6] =
    [&[], &["*"], &["ada.*"], &["bob.a", "robot.*"], &["ada.a", "bob.*"], &["robot.b"]];
const NAMES: [&str; 3] = ["a", "b", "c"];

#[derive(Clone, Debug)]
enum Step {
    Grant { user: usize, right: usize, patterns: usize },
    Stream { flow: usize, name: usize },
    Service { flow: usize, name: usize },
    Subscribe { flow: usize, channel: usize },
    Attach { flow: usize, replica: usize, source: usize },
    Publish { flow: usize, channel: usize },
    Call { flow: usize, channel: usize, whole: bool },
    Remove { flow: usize, channel: usize },
    Read { flow: usize },
}

fn step() -> impl Strategy<Value = Step> {
    let (flow, place) = (0_usize..3, 0_usize..16);
    prop_oneof![
        4 => (0_usize..2, 0..RIGHTS.len(), 0..PATTERNS.len())
            .prop_map(|(user, right, patterns)| Step::Grant { user, right, patterns }),
        2 => (flow.clone(), 0..NAMES.len()).prop_map(|(flow, name)| Step::Stream { flow, name }),
        1 => (flow.clone(), 0..NAMES.len()).prop_map(|(flow, name)| Step::Service { flow, name }),
        3 => (flow.clone(), place.clone()).prop_map(|(flow, channel)| Step::Subscribe { flow, channel }),
        2 => (flow.clone(), place.clone(), place.clone())
            .prop_map(|(flow, replica, source)| Step::Attach { flow, replica, source }),
        2 => (flow.clone(), place.clone()).prop_map(|(flow, channel)| Step::Publish { flow, channel }),
        2 => (flow.clone(), place.clone(), any::<bool>())
            .prop_map(|(flow, channel, whole)| Step::Call { flow, channel, whole }),
        1 => (flow.clone(), place).prop_map(|(flow, channel)| Step::Remove { flow, channel }),
        2 => flow.prop_map(|flow| Step::Read { flow }),
    ]
}

/// A flow and what it was told.
struct Member {
    raw: Raw,
    known: BTreeSet<ChannelRef>,
    /// The ends that each call has had.
    ends: BTreeMap<u32, u32>,
    next_tag: u32,
}

impl Member {
    fn new(raw: Raw) -> Member {
        Member { raw, known: BTreeSet::new(), ends: BTreeMap::new(), next_tag: 1000 }
    }

    fn tag(&mut self) -> u32 {
        self.next_tag += 1;
        self.next_tag
    }

    fn read(&mut self, hub: &mut ServerCore) {
        for event in self.raw.read(hub) {
            match event.message {
                Event::ChannelAdded { channel, .. } => assert!(self.known.insert(channel), "told twice"),
                Event::ChannelRemoved { channel } => assert!(self.known.remove(&channel), "never told"),
                Event::Refused { .. } => {
                    self.ends.entry(event.tag).and_modify(|ends| *ends += 1);
                }
                Event::Data { channel, .. } => {
                    assert!(self.known.contains(&channel), "data of nothing known")
                }
                _ => {}
            }
        }
    }
}

fn channels(hub: &ServerCore) -> Vec<ChannelRef> {
    hub.channels().map(|(known, _)| known.reference).collect()
}

fn act(hub: &mut ServerCore, owner: &mut Raw, members: &mut [Member], step: &Step) {
    let all = channels(hub);
    let some = |index: usize| all.get(index % all.len().max(1)).copied();
    match *step {
        Step::Grant { user, right, patterns } => {
            grant(hub, owner, ["ada", "bob"][user], RIGHTS[right], PATTERNS[patterns]);
        }
        Step::Stream { flow, name } => {
            let (name, properties) = (NAMES[name].to_owned(), no_properties());
            members[flow].raw.send(hub, 1, &Command::CreateStream { name, properties });
        }
        Step::Service { flow, name } => {
            let (name, properties) = (NAMES[name].to_owned(), no_properties());
            members[flow].raw.send(hub, 1, &Command::CreateService { name, properties });
        }
        Step::Read { flow } => members[flow].read(hub),
        Step::Subscribe { flow, channel } => {
            if let Some(channel) = some(channel) {
                members[flow].raw.send(hub, 1, &subscribe(channel, 2));
            }
        }
        Step::Attach { flow, replica, source } => {
            if let (Some(replica), Some(source)) = (some(replica), some(source)) {
                members[flow].raw.send(hub, 1, &Command::Attach { replica, source });
            }
        }
        Step::Publish { flow, channel } => {
            if let Some(channel) = some(channel) {
                members[flow].raw.publish(hub, channel, Bytes::from_static(b"pulse"));
            }
        }
        Step::Call { flow, channel, whole } => {
            if let Some(channel) = some(channel) {
                let tag = members[flow].tag();
                members[flow].ends.insert(tag, 0);
                let flags = if whole { Flags::WHOLE } else { Flags::FIRST };
                let payload = Bytes::from_static(b"do");
                let call = Command::Call { channel, deadline_ms: 0, payload };
                members[flow].raw.send_flagged(hub, tag, flags, &call);
            }
        }
        Step::Remove { flow, channel } => {
            if let Some(channel) = some(channel) {
                members[flow].raw.send(hub, 1, &Command::RemoveChannel { channel });
            }
        }
    }
}

proptest! {
    #[test]
    fn rights_are_never_widened(steps in prop::collection::vec(step(), 1..60)) {
        let (mut hub, mut owner) = hub_with(&["ada", "bob"]);
        let mut members: Vec<Member> = ["ada", "bob", "ada"]
            .into_iter()
            .map(|user| Member::new(flow_of(&mut hub, user)))
            .collect();
        for step in &steps {
            act(&mut hub, &mut owner, &mut members, step);
            prop_assert_eq!(hub.widened_rights(), Vec::<String>::new(), "after {:?}", step);
            prop_assert!(hub.totals().balance());
            owner.read(&mut hub);
        }
        prop_assert_eq!(hub.spurious(), 0);
        for member in &mut members {
            member.read(&mut hub);
            let seen: BTreeSet<ChannelRef> = hub.seen_by(member.raw.id).collect();
            prop_assert_eq!(&member.known, &seen, "a flow knows what it may see");
            prop_assert!(member.ends.values().all(|ends| *ends <= 1), "a call ends once");
        }
        // Without any rights nothing is left of them.
        for user in ["ada", "bob"] {
            for right in RIGHTS {
                grant(&mut hub, &mut owner, user, right, &[]);
            }
        }
        prop_assert_eq!(channels(&hub), []);
        prop_assert_eq!(hub.open_requests(), 0);
        for member in &mut members {
            member.read(&mut hub);
            prop_assert!(member.known.is_empty());
            prop_assert!(member.ends.values().all(|ends| *ends == 1), "{:?}", member.ends);
        }
    }
}
