//! How the processes of a run begin.

use crate::actors::{Identity, Member, Plain, Scribe, TOKEN, Talker, Wild};
use crate::archive::OnDisk;
use crate::ledger::{self, Rule};
use crate::run::Actor;
use crate::script::{Role, Way};
use crate::stamp::USER;
use sk_core::flow::database::disk::{Store, StoreError};
use sk_core::flow::database::{DatabaseStore, StoreRequest, StoreWork, Stored};
use sk_core::flow::login::OwnerToken;
use sk_core::flow::server::Settings;
use sk_core::flow::{SkFlowSat, SkFlowServer, Value};
use sk_core::prelude::*;
use sk_core::testing::USER_ID;
use std::ops::Range;

/// Where a hub keeps its databases.
pub(crate) const STORE: &str = "/databases.redb";

/// Ends the hub's process when its server has ended.
pub(crate) struct HubEnd;

impl HubEnd {
    fn quit(&mut self, cx: &mut Cx) {
        cx.quit();
    }
}

object! { pub(crate) HubEnd { slots { quit() } } }

/// How a hub is started.
pub(crate) struct HubStart {
    /// The identifiers of channels that it has.
    pub(crate) ids: Range<u16>,
    /// It keeps databases on its disk.
    pub(crate) keeps: bool,
}

/// Starts what a node's process does. None if it ended at once.
pub(crate) fn start_actor(cx: &mut Cx, who: Identity, role: Role, hub: &HubStart) -> Option<Actor> {
    Some(match role {
        Role::Hub => Actor::Hub(start_hub(cx, hub)?),
        Role::Scribe(way) => Actor::Scribe(Scribe::start(cx, who, way)?),
        Role::Satellite(way) => Actor::Member(start_member(cx, who, way)),
        Role::Listener => Actor::Member(start_member(cx, who, Way::Unix)),
        Role::Speaker => {
            let member = start_member(cx, who, Way::Unix);
            Member::speak_always(cx, member);
            Actor::Member(member)
        }
        Role::Plain(way) => Actor::Plain(Plain::start(cx, who, way)),
        Role::Talker => Actor::Talker(Talker::start(cx, who)),
        Role::Wild => Actor::Wild(Wild::start(cx, who)),
        Role::Inside { .. } => return None,
    })
}

fn start_member(cx: &mut Cx, who: Identity, way: Way) -> Handle<Member> {
    let hub = SkFlowSat::connect_as(cx, &way.address(), way.credentials());
    Member::start(cx, who, hub)
}

fn start_hub(cx: &mut Cx, start: &HubStart) -> Option<Handle<SkFlowServer>> {
    let user = USER.parse().ok()?;
    let settings = Settings { user, token: Some(OwnerToken::new(TOKEN)), owner_uid: Some(USER_ID) };
    let server = SkFlowServer::start(cx, settings);
    // A server that was made just now is there and idle.
    let _ = server.narrow_channel_ids(cx, start.ids.clone());
    for way in [Way::Tcp, Way::Unix] {
        if let Err(error) = server.listen(cx, &way.address()) {
            let text = format!("the hub cannot listen at {}: {error}", way.address());
            ledger::with(|ledger| ledger.complain(Rule::Restored, text));
        }
    }
    // As every program does it: whoever has the addresses has the files.
    if start.keeps && !keep_databases(cx, server) {
        return None;
    }
    Some(server)
}

/// Opens the store, looks at all that is in it, and gives it to the hub. Answers whether that can be done; a disk that
/// fails is no damage, and a hub that cannot open its store ends.
fn keep_databases(cx: &mut Cx, server: Handle<SkFlowServer>) -> bool {
    let storage = cx.world().storage.clone();
    let mut opened = match Store::open(storage.clone(), STORE.into()) {
        Ok(opened) => opened,
        Err(error) => {
            if let StoreError::NotBegun { damage, .. } = error {
                ledger::with(|ledger| ledger.hub_found(&OnDisk::new(), Some(&damage.to_string())));
            }
            return false;
        }
    };
    let mut on_disk = OnDisk::new();
    for (number, (name, _)) in (0..).zip(&opened.saved) {
        let request = StoreRequest { number, database: name.clone(), work: StoreWork::Load };
        match opened.store.perform(vec![request]).pop().map(|answer| answer.outcome) {
            Some(Ok(Stored::Contents(Some(contents)))) => {
                let text = |value: Value| value.variant().as_str().unwrap_or_default().to_owned();
                let variables = contents.into_iter().map(|(key, value)| (key.to_string(), text(value)));
                on_disk.insert(name.to_string(), variables.collect());
            }
            // The disk fails just now.
            Some(Err(_)) => return false,
            other => {
                let text = format!("the store lists {name}, and answers {other:?}");
                ledger::with(|ledger| ledger.complain(Rule::Kept, text));
            }
        }
    }
    let damage = opened.damage.as_ref();
    if let Some(damage) = damage
        && storage.open(&damage.set_aside, false).is_err()
    {
        let text = format!("the damaged store is not at {}", damage.set_aside.display());
        ledger::with(|ledger| ledger.complain(Rule::Kept, text));
    }
    let damage = damage.map(ToString::to_string);
    ledger::with(|ledger| {
        ledger.now = cx.clock_now();
        ledger.hub_found(&on_disk, damage.as_deref());
    });
    server.keep_databases(cx, opened.store, opened.saved).is_ok()
}
