//! How the processes of a run begin.

use crate::action::Action;
use crate::actors::{Filer, Follower, Member, Plain, Poller, SERVICE, Scribe, Talker, Wild};
use crate::address::{datagrams_of, token_of};
use crate::archive::OnDisk;
use crate::files::{FOLDER, Sight, Thing, sight_of};
use crate::identity::Identity;
use crate::ledger;
use crate::parts::Actor;
use crate::rule::Rule;
use crate::script::{Role, Script, Step, Way};
use crate::stamp::USER;
use sk_core::flow::blob::BlobStore;
use sk_core::flow::database::disk::{Store, StoreError};
use sk_core::flow::database::{DatabaseStore, StoreRequest, StoreWork, Stored};
use sk_core::flow::server::Settings;
use sk_core::flow::{SkFlowSat, SkFlowServer, Value};
use sk_core::prelude::*;
use sk_core::testing::USER_ID;
use sk_core::world::Storage;
use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::ops::Range;
use std::path::Path;

/// Where a hub keeps its databases.
pub(crate) const STORE: &str = "/databases.redb";

/// Longer than any file of a run.
const FILE_BYTES_MAX: u64 = 1 << 30;

/// Ends the hub's process when its server has ended.
pub(crate) struct HubEnd;

impl HubEnd {
    fn quit(&mut self, cx: &mut Cx) {
        cx.quit();
    }
}

object! { pub(crate) HubEnd { slots { quit() } } }

/// The first identifier of a channel that a flow may have.
const CHANNEL_ID_FIRST: u16 = 1024;
/// Stands for a node's sync channel beside the numbers of its others.
const CLOCK: u8 = 255;
/// And for its blob channel.
const FILES: u8 = 254;
/// Identifiers of channels in runs that have too few.
const CHANNELS_OF_NARROW_RUNS: usize = 3;

/// How a hub is started.
pub(crate) struct HubStart {
    /// The identifiers of channels that it has.
    ids: Range<u16>,
    /// It keeps databases on its disk.
    keeps: bool,
    /// It has a place for files.
    files: bool,
}

impl HubStart {
    /// As the script needs it.
    pub(crate) fn of(script: &Script) -> HubStart {
        let keeps = script.nodes.iter().any(|(_, role)| matches!(role, Role::Scribe(_)));
        let files = script.nodes.iter().any(|(_, role)| matches!(role, Role::Filer(_)));
        HubStart { ids: channel_ids(script), keeps, files }
    }

    /// The same for a hub that keeps nothing.
    fn plain(&self) -> HubStart {
        HubStart { ids: self.ids.clone(), keeps: false, files: false }
    }
}

/// In some runs there are fewer identifiers than channels that somebody wants, so that each is used again and again.
pub(crate) fn is_narrow(script: &Script) -> bool {
    script.seed.is_multiple_of(4)
}

/// The identifiers of channels: just enough for all that are wanted at once, so that they are used again soon.
fn channel_ids(script: &Script) -> Range<u16> {
    let filers = script.nodes.iter().filter(|(_, role)| matches!(role, Role::Filer(_)));
    let mut wanted: BTreeSet<(u16, u8)> = filers.map(|(node, _)| (*node, FILES)).collect();
    for Step { node, action, .. } in &script.steps {
        match action {
            Action::Open(channel) => _ = wanted.insert((*node, *channel)),
            Action::Tick => _ = wanted.insert((*node, CLOCK)),
            Action::Serve => _ = wanted.insert((*node, SERVICE)),
            _ => {}
        }
    }
    let most = if is_narrow(script) { CHANNELS_OF_NARROW_RUNS } else { usize::MAX };
    let count = wanted.len().min(most) as u16;
    // One for the undisturbed pair, and one for the ticks of its first.
    CHANNEL_ID_FIRST..CHANNEL_ID_FIRST + 2 + count
}

/// Starts what a node's process does. None if it ended at once.
pub(crate) fn start_actor(cx: &mut Cx, who: Identity, role: Role, hub: &HubStart) -> Option<Actor> {
    Some(match role {
        Role::Hub => Actor::Hub(start_hub(cx, 0, hub)?),
        Role::OtherHub => Actor::Hub(start_hub(cx, who.node, &hub.plain())?),
        Role::Scribe(way) => Actor::Scribe(Scribe::start(cx, who, way)?),
        Role::Satellite(way) | Role::Guest(way, _) => Actor::Member(start_member(cx, who, way)),
        Role::Listener => Actor::Member(start_member(cx, who, Way::Unix)),
        Role::Speaker => {
            let member = start_member(cx, who, Way::Unix);
            Member::speak_always(cx, member);
            Actor::Member(member)
        }
        Role::Plain(way) => Actor::Plain(Plain::start(cx, who, way)),
        Role::Filer(way) => Actor::Filer(Filer::start(cx, who, way)?),
        Role::Poller(way) => Actor::Poller(Poller::start(cx, who, way)),
        Role::Follower => Actor::Follower(Follower::start(cx, who)),
        Role::Talker => Actor::Talker(Talker::start(cx, who)),
        Role::Wild => Actor::Wild(Wild::start(cx, who)),
        Role::Inside { .. } => return None,
    })
}

fn start_member(cx: &mut Cx, who: Identity, way: Way) -> Handle<Member> {
    // Who mistakes the address still has his own hub's credentials.
    let hub = SkFlowSat::connect_as(cx, &way.address(who.hub), way.credentials(who.home));
    Member::start(cx, who, hub)
}

fn start_hub(cx: &mut Cx, number: u16, start: &HubStart) -> Option<Handle<SkFlowServer>> {
    let user = USER.parse().ok()?;
    let settings = Settings { user, token: Some(token_of(number)), owner_uid: Some(USER_ID) };
    let server = SkFlowServer::start(cx, settings);
    // A server that was made just now is there and idle.
    let _ = server.narrow_channel_ids(cx, start.ids.clone());
    let ways = Way::ALL.map(|way| way.address(number));
    for address in ways.into_iter().chain([datagrams_of(number)]) {
        if let Err(error) = server.listen(cx, &address) {
            let text = format!("the hub cannot listen at {address}: {error}");
            ledger::with(|ledger| ledger.complain(Rule::Restored, text));
        }
    }
    // As every program does it: whoever has the addresses has the files.
    if start.keeps && !keep_databases(cx, server) || start.files && !keep_files(cx, server) {
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
    // The disk may fail just now: then nobody can say what there is.
    if let Some(damage) = damage
        && storage
            .open(&damage.set_aside, false)
            .is_err_and(|error| error.kind() == ErrorKind::NotFound)
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

/// Looks at all files that the disk has, and gives their place to the hub. Answers whether that can be done: a hub
/// whose disk fails just now ends.
fn keep_files(cx: &mut Cx, server: Handle<SkFlowServer>) -> bool {
    let storage = cx.world().storage.clone();
    let Ok(store) = BlobStore::open(storage.clone(), FOLDER.into()) else { return false };
    let Some(on_disk) = files_on_disk(&*storage) else { return false };
    ledger::with(|ledger| {
        ledger.now = cx.clock_now();
        for wrong in ledger.files.hub_found(&on_disk) {
            ledger.complain(Rule::Files, wrong);
        }
    });
    server.keep_blobs(cx, store).is_ok()
}

/// Every path of every blob channel, by the node whose it is. None if the disk fails.
fn files_on_disk(storage: &dyn Storage) -> Option<BTreeMap<(u16, String), Sight>> {
    let mut on_disk = BTreeMap::new();
    for channel in storage.list(FOLDER.as_ref()).ok()? {
        let name = channel.to_string_lossy();
        let node = name.trim_start_matches(USER).trim_start_matches(".n").trim_end_matches(".f");
        let Ok(node) = node.parse::<u16>() else { continue };
        let root = Path::new(FOLDER).join(&channel).join("files");
        let mut folders = vec![String::new()];
        while let Some(folder) = folders.pop() {
            let names = match storage.list(&root.join(&folder)) {
                Ok(names) => names,
                // The channel has no files yet.
                Err(error) if error.kind() == ErrorKind::NotFound => continue,
                Err(_) => return None,
            };
            for name in names {
                let path = format!("{folder}{}", name.to_string_lossy());
                let sight = match storage.read(&root.join(&path), FILE_BYTES_MAX) {
                    Ok(bytes) => sight_of(&bytes),
                    Err(error) if error.kind() == ErrorKind::IsADirectory => {
                        folders.push(format!("{path}/"));
                        Sight::Thing(Thing::Folder)
                    }
                    Err(_) => return None,
                };
                on_disk.insert((node, path), sight);
            }
        }
    }
    Some(on_disk)
}
