//! A satellite as an object: its link to a hub around a [`SatelliteCore`], and the way back when it breaks.

mod accounts;
mod asking;
mod blobs;
mod channels;
mod closing;
mod commands;
mod databases;
mod events;
mod message;
mod services;
mod side;
mod sync;
mod telling;
mod udp;

pub use blobs::{BlobProgress, FlowBlob, FlowDownload};
pub use databases::{FlowDatabase, Variable};
pub use message::{Flow, FlowMessage};
pub use services::{Answer, Call, CallError};

use super::satellite::{ChannelInfo, Credentials, SatelliteCore, SatelliteEvent, TickReport};
use super::server::Session;
#[cfg(feature = "tls")]
use super::transport::TlsTrust;
use super::transport::{Destination, Link, PipeSeed, TURN_BYTES_MAX, Turn, dial};
use super::{ChannelRef, Encoded, HubAddress, Policy};
use crate::eventloop::Timer;
use crate::object::{Handle, ObjectId};
use crate::signal::Signal;
use crate::world::{Readiness, Token};
use crate::{Cx, attach};
use channels::{Own, own_name};
use databases::clerk::Clerk;
use side::{Fault, Side, note_fault};
use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;
use std::time::Duration;

/// How often deadlines are looked at.
const CHECK_EVERY: Duration = Duration::from_millis(250);
/// The first wait before a lost hub is looked for again; each further one is twice as long.
const RECONNECT_FIRST: Duration = Duration::from_millis(100);
/// The longest.
const RECONNECT_MAX: Duration = Duration::from_secs(5);

/// A satellite's link to its hub (`SkFlowSat` of the papers): it logs in, opens channels by name, publishes,
/// hears what it subscribed to. When the hub is lost it looks for it again and restores channels and
/// subscriptions; what was published meanwhile is counted as lost.
///
/// ```no_run
/// use sk_core::flow::SkFlowSat;
/// use sk_core::prelude::*;
///
/// struct Thermometer { hub: Handle<SkFlowSat>, celsius: f64 }
/// impl Thermometer {
///     fn read(&mut self, cx: &mut Cx) {
///         self.celsius += 0.1;
///         self.hub.publish(cx, "celsius", self.celsius);
///     }
/// }
/// object! { Thermometer { slots { read() } } }
///
/// let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
/// let cx = app.cx();
/// let hub = SkFlowSat::connect(cx, &"unix:/run/user/1000/skrobot/hub.sock".parse()?);
/// let thermometer = cx.spawn(Thermometer { hub, celsius: 20.0 });
/// attach!(cx, cx.slow_zone().pulse => thermometer.read);
/// app.run();
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SkFlowSat {
    way: Way,
    core: Option<SatelliteCore>,
    link: Option<Box<dyn Link>>,
    token: Option<Token>,
    waiting: Option<Encoded>,
    read_into: Vec<u8>,
    flush_asked: bool,
    /// What this satellite owns, by its own names; opened again after a reconnection.
    own: BTreeMap<String, Own>,
    /// What it wants to hear, by full names.
    wanted: BTreeMap<String, (Policy, u16)>,
    /// What it ceased to want while there was no link, and the hub may still think it wants.
    renounced: BTreeSet<String>,
    /// What its flow is called, or empty.
    flow_name: String,
    /// Of its last flow: with this it takes its own place again after a link broke.
    session: Session,
    /// The hub did not let this connection become a flow.
    turned_away: bool,
    /// All channels, in step with the events that were told.
    heard: BTreeMap<ChannelRef, Rc<ChannelInfo>>,
    services: services::Services,
    sync: sync::Sync,
    udp: udp::Udp,
    /// How many links there have been.
    link_number: u64,
    call_timer: Handle<Timer>,
    /// Its dealings with databases.
    clerk: Clerk,
    /// Passwords of accounts from which a worker derives what the hub keeps.
    deriving: accounts::Deriving,
    questions: asking::Questions,
    /// Who carries files.
    porter: blobs::Porter,
    reconnect: Handle<Timer>,
    reconnect_after: Duration,
    losses: u64,
    /// This link was let in.
    was_ready: bool,
    /// Why the hub said it ends this link.
    farewell: Option<String>,
    /// What broke this link.
    fault: Option<Fault>,
    /// The last link broke because who answered is no hub that can be talked to.
    is_unusable: bool,
    /// The hub let this satellite in; channels and subscriptions are being restored.
    pub ready: Signal<()>,
    /// The hub is lost, or could not be reached; carries why, as exactly as the transport knows it. It is looked for again, but for a hub in this very process, whose end is
    /// for good.
    pub lost: Signal<String>,
    /// Somebody began to listen to a channel of this satellite's; carries its own name.
    pub start_publishing: Signal<String>,
    /// Nobody listens any more; carries the channel's own name.
    pub stop_publishing: Signal<String>,
    /// A message of a channel that was subscribed to.
    pub message: Signal<FlowMessage>,
    /// A channel exists, anybody's.
    pub channel_added: Signal<ChannelInfo>,
    /// A channel is gone, anybody's.
    pub channel_removed: Signal<ChannelInfo>,
    /// A channel says something else about itself, anybody's.
    pub header_changed: Signal<ChannelInfo>,
    /// Another connection owns a channel, anybody's: its flow came back and took its own place again.
    pub owner_changed: Signal<ChannelInfo>,
    /// After [`publish`](Handle#method.publish) answered `false` on a reliable channel, its slowest subscriber has
    /// caught up; carries the channel's own name.
    pub room: Signal<String>,
    /// The hub refused a command; carries the hub's words.
    pub refused: Signal<String>,
    /// This loop follows a sync channel from now on, or not any more.
    pub synced: Signal<bool>,
    /// How a target of a sync channel keeps up: this satellite, or one that follows it. At most once a second.
    pub sync_report: Signal<TickReport>,
    /// Messages of a subscription were dropped: the channel's full name, the reason, and how many for that
    /// reason since the subscription began.
    pub dropped: Signal<(String, String, u64)>,
}

crate::object! {
    pub SkFlowSat {
        signals {
            ready()
            lost(String)
            start_publishing(String)
            stop_publishing(String)
            message(&FlowMessage)
            channel_added(&ChannelInfo)
            channel_removed(&ChannelInfo)
            header_changed(&ChannelInfo)
            owner_changed(&ChannelInfo)
            room(String)
            refused(String)
            synced(bool)
            sync_report(TickReport)
            dropped(String, String, u64)
        }
        slots { on_check() on_second() on_reconnect() on_call_deadline() on_source_tick() }
        hooks { on_destroy }
    }
}

/// How the hub is reached.
enum Way {
    Address {
        to: Destination,
        credentials: Credentials,
    },
    /// Inside the process: if that breaks there is no hub any more.
    Pipe,
}

impl SkFlowSat {
    /// A satellite of a hub reached over a Unix socket: the login is by the user id of this process. It
    /// connects in the background, now and whenever the hub was lost.
    pub fn connect(cx: &mut Cx, to: &HubAddress) -> Handle<SkFlowSat> {
        SkFlowSat::connect_as(cx, to, Credentials::Peer)
    }

    /// As [`connect`](SkFlowSat::connect), with other credentials: the owner's token over TCP.
    pub fn connect_as(cx: &mut Cx, to: &HubAddress, credentials: Credentials) -> Handle<SkFlowSat> {
        SkFlowSat::connect_to(cx, Destination::from(to), credentials)
    }

    /// As [`connect_as`](SkFlowSat::connect_as), to a hub that has to show a certificate: at a `tls:` or `wss:`
    /// address.
    #[cfg(feature = "tls")]
    pub fn connect_secured(
        cx: &mut Cx,
        to: &HubAddress,
        credentials: Credentials,
        trust: TlsTrust,
    ) -> Handle<SkFlowSat> {
        let to = Destination { trust: Some(trust), ..Destination::from(to) };
        SkFlowSat::connect_to(cx, to, credentials)
    }

    fn connect_to(cx: &mut Cx, to: Destination, credentials: Credentials) -> Handle<SkFlowSat> {
        let satellite = SkFlowSat::make(cx, Way::Address { to, credentials });
        // It was made just now.
        let _ = cx.with(satellite, |satellite, cx| satellite.open_link(cx));
        satellite
    }

    /// A satellite inside the hub's process, on any of its loops.
    pub fn inside(cx: &mut Cx, seed: PipeSeed) -> Handle<SkFlowSat> {
        let satellite = SkFlowSat::make(cx, Way::Pipe);
        let token = cx.add_source(satellite.id(), serve);
        let pipe = seed.grow();
        pipe.serve_by(cx, token);
        // It was made just now.
        let _ =
            cx.with(satellite, |satellite, cx| satellite.begin(cx, Box::new(pipe), token, Credentials::Peer));
        satellite
    }

    fn make(cx: &mut Cx, way: Way) -> Handle<SkFlowSat> {
        cx.spawn_with(|cx, this: Handle<SkFlowSat>| {
            let reconnect = cx.under(this).spawn(Timer::default());
            let check = cx.under(this).spawn(Timer::default());
            let call_timer = cx.under(this).spawn(Timer::default());
            attach!(cx, call_timer.timeout => this.on_call_deadline);
            attach!(cx, reconnect.timeout => this.on_reconnect);
            attach!(cx, check.timeout => this.on_check);
            attach!(cx, cx.one_sec_zone().pulse => this.on_second);
            // The timer was made just now and is no more gone than this object.
            let _ = check.start(cx, CHECK_EVERY);
            SkFlowSat {
                way,
                core: None,
                link: None,
                token: None,
                waiting: None,
                read_into: vec![0; TURN_BYTES_MAX],
                flush_asked: false,
                own: BTreeMap::new(),
                wanted: BTreeMap::new(),
                renounced: BTreeSet::new(),
                flow_name: String::new(),
                session: [0; 16],
                turned_away: false,
                heard: BTreeMap::new(),
                services: services::Services::default(),
                sync: sync::Sync::default(),
                udp: udp::Udp::default(),
                link_number: 0,
                call_timer,
                clerk: Clerk::default(),
                deriving: accounts::Deriving::default(),
                questions: asking::Questions::default(),
                porter: blobs::Porter::default(),
                reconnect,
                reconnect_after: RECONNECT_FIRST,
                losses: 0,
                was_ready: false,
                farewell: None,
                fault: None,
                is_unusable: false,
                ready: Signal::new(),
                lost: Signal::new(),
                start_publishing: Signal::new(),
                stop_publishing: Signal::new(),
                message: Signal::new(),
                channel_added: Signal::new(),
                channel_removed: Signal::new(),
                header_changed: Signal::new(),
                owner_changed: Signal::new(),
                room: Signal::new(),
                refused: Signal::new(),
                synced: Signal::new(),
                sync_report: Signal::new(),
                dropped: Signal::new(),
            }
        })
    }

    /// The protocol's side, while there is a link.
    pub fn core(&self) -> Option<&SatelliteCore> {
        self.core.as_ref()
    }

    /// How many messages were not sent because there was no link or too much waited.
    pub fn losses(&self) -> u64 {
        self.losses + self.core.as_ref().map_or(0, SatelliteCore::lost)
    }

    // ---- the link ----

    fn open_link(&mut self, cx: &mut Cx) {
        let Way::Address { to, credentials } = &self.way else { return };
        let credentials = credentials.clone();
        let token = cx.add_source(cx.this(self).id(), serve);
        match dial(cx, to, token) {
            Ok(link) => self.begin(cx, link, token, credentials),
            Err(error) => {
                cx.remove_source(token);
                self.break_link(cx, error.to_string());
            }
        }
    }

    fn begin(&mut self, cx: &mut Cx, link: Box<dyn Link>, token: Token, credentials: Credentials) {
        let mut nonce = [0; 32];
        cx.world().rng.fill(&mut nonce);
        self.link_number += 1;
        let core = SatelliteCore::flow(credentials, nonce, cx.now());
        self.core = Some(match link.fragment_bytes_max() {
            Some(bytes_max) => core.with_fragments_of(bytes_max),
            None => core,
        });
        self.core = self.core.take().map(|core| core.named(&self.flow_name).resuming(self.session));
        self.turned_away = false;
        self.link = Some(link);
        self.token = Some(token);
        self.waiting = None;
        self.flush_later(cx);
    }

    /// The link is over; the way back is tried later.
    fn break_link(&mut self, cx: &mut Cx, why: String) {
        if let Some(token) = self.token.take() {
            cx.remove_source(token);
        }
        if let Some(link) = self.link.take() {
            link.close(cx);
        }
        if let Some(core) = self.core.take() {
            self.losses += core.lost();
        }
        self.own.values_mut().for_each(Own::forget_channel);
        self.heard.clear();
        self.end_services(cx);
        self.end_sync(cx);
        self.close_udp(cx);
        self.clerk.lose();
        self.questions.lose();
        self.porter.lose();
        if matches!(self.way, Way::Address { .. }) {
            // The timer is this object's child and lives as long as it.
            let _ = self.reconnect.start_once(cx, self.reconnect_after);
            self.reconnect_after = (self.reconnect_after * 2).min(RECONNECT_MAX);
        }
        self.was_ready = false;
        let fault = self.fault.take();
        self.is_unusable = fault.as_ref().is_some_and(|fault| fault.is_unusable);
        let why = self.farewell.take().or(fault.map(|fault| fault.why)).unwrap_or(why);
        match self.way {
            Way::Address { .. } => tracing::debug!("the hub is lost: {why}"),
            // There is no way back.
            Way::Pipe => tracing::warn!("the hub of this process has ended: {why}"),
        }
        let this = cx.this(self);
        cx.post_own(this, move |cx| {
            databases::commands::tell_told(cx, this);
            asking::tell_answers(cx, this);
            blobs::tell_told(cx, this);
            cx.emit_own(this, |satellite| &satellite.lost, &why);
        });
    }

    fn on_reconnect(&mut self, cx: &mut Cx) {
        if self.link.is_none() {
            self.open_link(cx);
        }
    }

    fn on_check(&mut self, cx: &mut Cx) {
        let now = cx.now();
        // Inside the process a silent hub is one whose loop stood still: its end would show in the pipe.
        if matches!(self.way, Way::Address { .. })
            && let Some(core) = &mut self.core
            && let Err(error) = core.tick(now)
        {
            self.break_link(cx, error.to_string());
        }
        if let Some(core) = &mut self.core {
            self.clerk.check(core);
        }
        self.carry_on(cx);
    }

    fn on_destroy(&mut self, cx: &mut Cx) {
        self.flush(cx);
        if let Some(link) = self.link.take() {
            link.close(cx);
        }
    }

    fn flush_later(&mut self, cx: &mut Cx) {
        let has_output = self.waiting.is_some()
            || self.core.as_ref().is_some_and(SatelliteCore::has_output)
            || self.has_datagrams();
        if has_output {
            self.flush_in_next_round(cx);
        }
    }

    /// In step 7, of the next round if this round's has come.
    fn flush_in_next_round(&mut self, cx: &mut Cx) {
        if !std::mem::replace(&mut self.flush_asked, true) {
            let this = cx.this(self);
            cx.write_later(this.id(), flush);
        }
    }

    /// Step 7.
    fn flush(&mut self, cx: &mut Cx) {
        self.flush_asked = false;
        self.finish_pulses(cx);
        self.send_datagrams(cx);
        let now = cx.now();
        let (Some(core), Some(mut link)) = (&mut self.core, self.link.take()) else { return };
        let fault = &mut self.fault;
        let turn = link.write(cx, &mut Side { core, now, waiting: &mut self.waiting, fault });
        note_fault(fault, &mut *link);
        self.link = Some(link);
        match turn {
            Turn::Over => self.break_link(cx, "the connection broke".to_owned()),
            Turn::More => self.flush_later(cx),
            Turn::Done | Turn::Held => {}
        }
    }

    fn serve(&mut self, cx: &mut Cx, readiness: Readiness) -> Turn {
        let now = cx.now();
        if self.token != Some(readiness.token) {
            return Turn::Done;
        }
        let (Some(core), Some(mut link)) = (&mut self.core, self.link.take()) else { return Turn::Done };
        if readiness.writable
            && let Err(error) = link.connected()
        {
            self.link = Some(link);
            self.break_link(cx, error.to_string());
            return Turn::Done;
        }
        if !core.has_greeted()
            && let Some(binding) = link.channel_binding()
        {
            core.bind(binding);
        }
        let fault = &mut self.fault;
        let mut side = Side { core, now, waiting: &mut self.waiting, fault };
        let wrote = if link.may_write(readiness) { link.write(cx, &mut side) } else { Turn::Done };
        // Read in any case: a hub that takes nothing any more may have said why.
        let read = readiness.readable || wrote == Turn::Over;
        let mut turn = if read { link.read(cx, &mut side, &mut self.read_into) } else { Turn::Done };
        if wrote == Turn::Over && turn == Turn::Done {
            turn = Turn::Over;
        }
        note_fault(&mut self.fault, &mut *link);
        self.link = Some(link);
        if wrote == Turn::More {
            self.flush_later(cx);
        }
        self.derive_if_challenged(cx);
        turn
    }

    // ---- what the hub says ----

    /// Whether an event is for one of those who deal with the hub for others, and tell it themselves.
    fn hear_apart(&mut self, event: &SatelliteEvent) -> bool {
        if self.hear_answer(event) {
            return true;
        }
        let Some(core) = &mut self.core else { return false };
        self.clerk.hear(core, event) || self.porter.hear(core, event)
    }

    /// Takes the next event and does the bookkeeping for it.
    fn next_event(&mut self, cx: &mut Cx) -> Option<SatelliteEvent> {
        let mut event = self.core.as_mut()?.next_event()?;
        // What answers a question, or is about databases or files, is told apart.
        while self.hear_apart(&event) {
            event = self.core.as_mut()?.next_event()?;
        }
        self.note_sync(cx, &event);
        match &event {
            SatelliteEvent::Ready => self.restore(cx),
            SatelliteEvent::UdpOpened { port, .. } => self.udp_opened(cx, *port),
            SatelliteEvent::Created { tag, channel, name } => {
                self.created(cx, *tag, *channel, name);
                self.service_created(own_name(name), *channel);
                self.sync_created(own_name(name), *channel);
                self.remove_unwanted(cx, own_name(name), *channel);
            }
            SatelliteEvent::ChannelAdded(info) => {
                self.heard.insert(info.channel, Rc::new(info.clone()));
                self.repeat_new_source(cx, info);
                self.send_waiting(cx, Some(&info.name));
            }
            SatelliteEvent::ChannelRemoved(info) => {
                self.heard.remove(&info.channel);
                self.name_is_free(cx, &info.name);
            }
            SatelliteEvent::HeaderChanged { info, .. } | SatelliteEvent::OwnerChanged(info) => {
                self.heard.insert(info.channel, Rc::new(info.clone()));
            }
            // Before it is ready nothing else can be refused than to become a flow.
            SatelliteEvent::Refused { text, .. } if !self.was_ready => {
                self.turned_away = true;
                self.farewell = Some(text.clone());
            }
            _ => {}
        }
        Some(event)
    }

    /// As it was when the event came: the core may know already that the channel has gone since.
    fn heard_channel(&self, channel: ChannelRef) -> Option<Rc<ChannelInfo>> {
        self.heard.get(&channel).cloned()
    }
}

/// The link is ready.
fn serve(cx: &mut Cx, satellite: ObjectId, readiness: Readiness) -> bool {
    let satellite = Handle::<SkFlowSat>::new(satellite);
    let turn = cx.with(satellite, |satellite, cx| satellite.serve(cx, readiness));
    // Events first: a hub says why before it ends a connection.
    events::tell_all(cx, satellite);
    let turn = turn.unwrap_or(Turn::Done);
    let turned_away = cx.with(satellite, |satellite, _| satellite.turned_away) == Ok(true);
    if turn == Turn::Over || turned_away {
        // A satellite that was destroyed by its own event needs no way back.
        let _ = cx
            .with(satellite, |satellite, cx| satellite.break_link(cx, "the hub ended the connection".into()));
        return false;
    }
    turn == Turn::More
}

fn flush(cx: &mut Cx, satellite: ObjectId) {
    // One that was buried meanwhile has flushed in its hook.
    let _ = cx.with(Handle::<SkFlowSat>::new(satellite), |satellite, cx| satellite.flush(cx));
}
