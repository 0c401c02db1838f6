//! The hub's server as an object: listeners and links around a [`ServerCore`].

mod blob_keeper;
mod datagrams;
mod doors;
mod keeper;
mod services;

use super::server::{ConnectionId, Notice, Origin, ServerCore, Settings, TooManyConnections};
use super::transport::{Broken, Core, Link, PipeEnd, PipeSeed, StreamLink, TURN_BYTES_MAX, Turn};
use super::wire::Slices;
use super::{Encoded, Rights};
use crate::eventloop::Timer;
#[cfg(feature = "http")]
use crate::net::http::HttpServer;
use crate::net::{Door, Shortage};
use crate::object::{Access, Handle, ObjectId};
use crate::signal::Signal;
use crate::testing::{Bug, is_planted};
use crate::world::{Datagram, Endpoint, Readiness, Stream, Token};
use crate::{Cx, attach};
use blob_keeper::BlobKeeper;
pub use keeper::KeepError;
use keeper::Keeper;
use rustc_hash::FxHashMap;
use sk_flat::{Instant, Name};
use std::io::{self, ErrorKind};
use std::time::Duration;

/// How many connections one listener takes in one turn.
const ACCEPTS_PER_TURN_MAX: usize = 64;
/// How long a listener waits when the process is out of descriptors.
const ACCEPT_AGAIN_AFTER: Duration = Duration::from_millis(100);
/// How often deadlines are looked at.
const CHECK_EVERY: Duration = Duration::from_millis(250);
/// How long a server that ends waits for the modules inside.
const INSIDERS_LINGER: Duration = Duration::from_secs(1);

/// The hub's server (`SkFlowServer` of the papers): it listens, serves every kind of connection and keeps the
/// channels. All of it lives on one loop.
///
/// ```
/// use sk_core::flow::{SkFlowServer, server::Settings};
/// use sk_core::prelude::*;
///
/// let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
/// let settings = Settings { user: "robot".parse()?, token: None, owner_uid: None };
/// let server = SkFlowServer::start(app.cx(), settings);
/// let address = server.listen(app.cx(), &"tcp:127.0.0.1:0".parse()?)?;
/// assert!(address.to_string().starts_with("tcp:127.0.0.1:"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SkFlowServer {
    core: ServerCore,
    doors: FxHashMap<Token, Door>,
    /// Where datagrams come in.
    datagrams: FxHashMap<Token, Box<dyn Datagram>>,
    #[cfg(feature = "http")]
    http: Option<Handle<HttpServer>>,
    links: FxHashMap<Token, Served>,
    tokens: FxHashMap<ConnectionId, Token>,
    /// Links that stay unread until their connection wants more.
    held: Vec<Token>,
    /// Links whose peers would take more than one round's writes.
    unfinished: Vec<Token>,
    /// Connections whose peers have gone. They leave after this round's flush: with them go their channels and
    /// what is queued of those, and their last words came just before.
    leaving: Vec<ConnectionId>,
    /// Room for the links of one flush.
    flushing: Vec<Token>,
    /// What the hub serves itself.
    services: services::Services,
    ending: Option<Ending>,
    shortage: Shortage,
    flush_asked: bool,
    work_token: Token,
    room: Vec<u8>,
    /// The way to the disk, if databases are kept.
    keeper: Option<Keeper>,
    /// The way to the files of blob channels, if the hub has any.
    blob_keeper: Option<BlobKeeper>,
    /// A satellite logged in; carries its account.
    pub logged_in: Signal<String>,
    /// A channel was opened; carries its full name.
    pub channel_added: Signal<String>,
    /// A channel was closed; carries its full name.
    pub channel_removed: Signal<String>,
    /// After [`shut_down`](Handle#method.shut_down): the last connection is gone.
    pub ended: Signal<()>,
}

struct Served {
    connection: ConnectionId,
    link: Option<Box<dyn Link>>,
    waiting: Option<Encoded>,
    /// It is in the list of links that stay unread.
    held: bool,
    /// It takes nothing any more; it is over when nothing is left to read.
    broken: bool,
}

crate::object! {
    pub SkFlowServer {
        signals { logged_in(String) channel_added(String) channel_removed(String) ended() }
        slots { on_check() on_request_deadline() }
        hooks { on_destroy }
    }
}

/// The core of one connection, as its link sees it.
struct Side<'a> {
    core: &'a mut ServerCore,
    id: ConnectionId,
    now: Instant,
    waiting: &'a mut Option<Encoded>,
}

impl Core for Side<'_> {
    fn wants_input(&self) -> bool {
        self.core.wants_input(self.id)
    }
    fn bytes(&mut self, bytes: &[u8]) -> Result<(), Broken> {
        self.core.receive(self.id, bytes, self.now);
        self.core.connection(self.id).map(|_| ()).ok_or(Broken)
    }
    fn frame(&mut self, frame: Encoded) -> Result<(), Broken> {
        self.core.accept(self.id, frame, self.now);
        self.core.connection(self.id).map(|_| ()).ok_or(Broken)
    }
    fn has_output(&self) -> bool {
        self.core.has_output(self.id)
    }
    fn slices(&mut self, parts_max: usize) -> Slices<'_> {
        self.core.slices(self.id, parts_max)
    }
    fn wrote(&mut self, count: usize) {
        self.core.wrote(self.id, count, self.now);
    }
    fn take(&mut self) -> Option<Encoded> {
        self.core.take(self.id)
    }
    fn put_back(&mut self, frame: Encoded) {
        *self.waiting = Some(frame);
    }
    fn put_back_first(&mut self) -> Option<Encoded> {
        self.waiting.take()
    }
}

impl SkFlowServer {
    /// A server with nobody connected, that listens nowhere yet.
    pub fn start(cx: &mut Cx, settings: Settings) -> Handle<SkFlowServer> {
        cx.named("flow_server").spawn_with(|cx, this: Handle<SkFlowServer>| {
            let timer = cx.under(this).spawn(Timer::default());
            attach!(cx, timer.timeout => this.on_check);
            let request_timer = cx.under(this).spawn(Timer::default());
            attach!(cx, request_timer.timeout => this.on_request_deadline);
            // The timer was made just now and is no more gone than this object.
            let _ = timer.start(cx, CHECK_EVERY);
            SkFlowServer {
                core: ServerCore::new(settings, cx.now()),
                doors: FxHashMap::default(),
                datagrams: FxHashMap::default(),
                #[cfg(feature = "http")]
                http: None,
                links: FxHashMap::default(),
                tokens: FxHashMap::default(),
                held: Vec::new(),
                unfinished: Vec::new(),
                leaving: Vec::new(),
                flushing: Vec::new(),
                services: services::Services::new(request_timer),
                ending: None,
                shortage: Shortage::default(),
                flush_asked: false,
                work_token: cx.add_source(this.id(), work),
                room: vec![0; TURN_BYTES_MAX],
                keeper: None,
                blob_keeper: None,
                logged_in: Signal::new(),
                channel_added: Signal::new(),
                channel_removed: Signal::new(),
                ended: Signal::new(),
            }
        })
    }

    /// The hub without its sockets: channels, connections, counts.
    pub fn core(&self) -> &ServerCore {
        &self.core
    }

    fn on_check(&mut self, cx: &mut Cx) {
        self.core.tick(cx.now());
        self.take_stored(cx);
        self.take_filed(cx);
    }

    fn on_destroy(&mut self, cx: &mut Cx) {
        self.core.shut_down(cx.now());
        self.flush(cx);
        self.store_the_rest(cx);
        self.file_the_rest(cx);
        for (_, served) in self.links.drain() {
            if let Some(link) = served.link {
                link.close(cx);
            }
        }
    }

    fn accept(&mut self, cx: &mut Cx, at: Token) -> bool {
        let this = cx.this(self);
        for _ in 0..ACCEPTS_PER_TURN_MAX {
            let Some(door) = self.doors.get_mut(&at) else { return false };
            let token = cx.add_source(this.id(), serve);
            match door.accept(token) {
                Ok(stream) => {
                    let now = cx.now();
                    self.take_in(cx, token, stream, now);
                }
                Err(error) => {
                    cx.remove_source(token);
                    match error.kind() {
                        ErrorKind::WouldBlock => return false,
                        // The peer has gone again between its arrival and now.
                        ErrorKind::ConnectionAborted | ErrorKind::Interrupted => {}
                        _ => {
                            self.pause_accepting(cx, at, &error);
                            return false;
                        }
                    }
                }
            }
        }
        true
    }

    /// Out of descriptors: the waiting connection is not reported again, and asking at once would spin.
    fn pause_accepting(&mut self, cx: &mut Cx, at: Token, error: &io::Error) {
        if self.shortage.is_news(cx.now()) {
            tracing::error!("connections cannot be taken in for now: {error}");
        }
        cx.offer_source_after(at, ACCEPT_AGAIN_AFTER);
    }

    /// Takes a connection in whose time for the login began at `opened`.
    fn take_in(&mut self, cx: &mut Cx, token: Token, stream: Box<dyn Stream>, opened: Instant) {
        let origin = match (stream.peer_uid(), stream.peer()) {
            (Some(uid), _) => Origin::Unix { uid },
            (None, Some(Endpoint::Ip(at))) => Origin::Network(at.ip()),
            _ => {
                // A peer that is gone has no address any more.
                cx.remove_source(token);
                return;
            }
        };
        self.take_link(cx, token, Box::new(StreamLink::new(stream)), origin, opened);
    }

    fn take_link(&mut self, cx: &mut Cx, token: Token, link: Box<dyn Link>, origin: Origin, opened: Instant) {
        if !self.core.admits(origin, opened) {
            // Too many at once from there: closed without a word, before it costs anything.
            cx.remove_source(token);
            return;
        }
        let mut nonce = [0; 32];
        cx.world().rng.fill(&mut nonce);
        match self.core.open(origin, nonce, opened) {
            Ok(connection) => self.enlist(token, connection, link),
            Err(TooManyConnections) => cx.remove_source(token),
        }
        self.after(cx);
    }

    fn enlist(&mut self, token: Token, connection: ConnectionId, link: Box<dyn Link>) {
        self.tokens.insert(connection, token);
        self.links.insert(
            token,
            Served { connection, link: Some(link), waiting: None, held: false, broken: false },
        );
    }

    fn serve(&mut self, cx: &mut Cx, readiness: Readiness) -> bool {
        let token = readiness.token;
        if self.doors.contains_key(&token) {
            return self.accept(cx, token);
        }
        let now = cx.now();
        let Some(served) = self.links.get_mut(&token) else { return false };
        let id = served.connection;
        let Some(mut link) = served.link.take() else { return false };
        if self.core.is_unbound(id)
            && let Some(binding) = link.channel_binding()
        {
            self.core.bind(id, binding);
        }
        let mut side = Side { core: &mut self.core, id, now, waiting: &mut served.waiting };
        let wrote = if link.may_write(readiness) { link.write(cx, &mut side) } else { Turn::Done };
        // Read in any case: a peer that takes nothing any more may have left its last words.
        let read = readiness.readable || wrote == Turn::Over;
        let mut turn = if read { link.read(cx, &mut side, &mut self.room) } else { Turn::Done };
        served.broken |= wrote == Turn::Over;
        if served.broken && turn == Turn::Done {
            turn = Turn::Over;
        }
        served.link = Some(link);
        if wrote == Turn::More {
            self.unfinished.push(token);
        }
        match turn {
            Turn::Over => self.leaving.push(id),
            Turn::Held if !std::mem::replace(&mut served.held, true) => self.held.push(token),
            Turn::Held | Turn::Done | Turn::More => {}
        }
        self.after(cx);
        turn == Turn::More
    }

    /// What follows from whatever happened to the core.
    fn after(&mut self, cx: &mut Cx) {
        while let Some(notice) = self.core.next_notice() {
            self.on_notice(cx, notice);
        }
        let core = &self.core;
        let links = &mut self.links;
        self.held.retain(|&token| {
            let Some(served) = links.get_mut(&token) else { return false };
            served.held = !core.wants_input(served.connection);
            if !served.held {
                cx.offer_source(token);
            }
            served.held
        });
        self.store_requests(cx);
        self.file_requests(cx);
        self.end_in_turn(cx);
        self.watch_request_deadlines(cx);
        if self.core.has_work() {
            cx.offer_source(self.work_token);
        }
        let to_flush = self.core.has_dirty()
            || !self.unfinished.is_empty()
            || !self.leaving.is_empty()
            || self.ending == Some(Ending::Flush);
        if to_flush && !self.flush_asked {
            self.flush_asked = true;
            let this = cx.this(self);
            cx.write_later(this.id(), flush);
        }
    }

    fn on_notice(&mut self, cx: &mut Cx, notice: Notice) {
        match notice {
            Notice::LoggedIn { user, connection } => {
                tracing::debug!(%connection, %user, "logged in");
                self.tell(cx, |server| &server.logged_in, user.to_string());
            }
            Notice::Ended { connection, ending } => {
                tracing::debug!(%connection, ?ending, "connection ended");
                if let Some(token) = self.tokens.remove(&connection) {
                    cx.remove_source(token);
                    if let Some(Served { link: Some(link), .. }) = self.links.remove(&token) {
                        link.close(cx);
                    }
                }
            }
            Notice::ChannelAdded { name, .. } => {
                self.tell(cx, |server| &server.channel_added, name.to_string())
            }
            Notice::ChannelRemoved { name, .. } => {
                self.tell(cx, |server| &server.channel_removed, name.to_string());
            }
            Notice::Request { channel, request, asker, payload } => {
                self.on_request(cx, channel, request, asker, payload);
            }
            Notice::RequestOver { request } => self.on_request_over(cx, request),
            _ => {}
        }
    }

    /// Emits in the next round, when this object is not leased: a slot may then ask the server that called it.
    fn tell(&self, cx: &mut Cx, signal: fn(&SkFlowServer) -> &Signal<String>, about: String) {
        if signal(self).listeners() > 0 {
            let this = cx.this(self);
            cx.post_own(this, move |cx| cx.emit_own(this, signal, &about));
        }
    }

    /// Step 7: what the round has gathered for each connection goes out in vectored writes.
    fn flush(&mut self, cx: &mut Cx) {
        self.flush_asked = false;
        let now = cx.now();
        let mut tokens = std::mem::take(&mut self.flushing);
        tokens.append(&mut self.unfinished);
        tokens.extend(self.core.take_dirty().filter_map(|id| self.tokens.get(&id)));
        // Only a planted bug lets anybody wait behind another.
        let mut behind = Vec::new();
        for token in tokens.drain(..) {
            if !behind.is_empty() {
                behind.push(token);
                continue;
            }
            let Some(served) = self.links.get_mut(&token) else { continue };
            let id = served.connection;
            let Some(mut link) = served.link.take() else { continue };
            let mut side = Side { core: &mut self.core, id, now, waiting: &mut served.waiting };
            let turn = link.write(cx, &mut side);
            served.link = Some(link);
            match turn {
                Turn::Over => {
                    served.broken = true;
                    cx.offer_source(token);
                }
                Turn::More => self.unfinished.push(token),
                Turn::Done | Turn::Held => {}
            }
            if is_planted(Bug::StuckPeerBlocks) && self.core.has_output(id) {
                behind.push(token);
            }
        }
        tokens.append(&mut behind);
        self.flushing = tokens;
        if self.ending == Some(Ending::Flush) {
            // Those who read have been given all that was queued.
            self.ending = Some(Ending::Everybody);
            self.core.shut_down(now);
        }
        for id in std::mem::take(&mut self.leaving) {
            self.core.left(id, now);
        }
        self.after(cx);
    }

    /// The server's end, a step at a time: first the modules inside say their last, then everybody is told,
    /// then the last connection is gone.
    fn end_in_turn(&mut self, cx: &mut Cx) {
        let now = cx.now();
        match self.ending {
            None | Some(Ending::Ended) => {}
            Some(Ending::Insiders { until }) => {
                let said = self.core.insiders() == 0
                    && self.core.unanswered_store_requests() == 0
                    && self.core.unanswered_blob_requests() == 0;
                if said || now >= until {
                    self.ending = Some(Ending::Flush);
                }
            }
            Some(Ending::Flush) => {}
            Some(Ending::Everybody) if self.core.connections() == 0 => {
                self.ending = Some(Ending::Ended);
                let this = cx.this(self);
                cx.post_own(this, move |cx| cx.emit_own(this, |server| &server.ended, &()));
            }
            Some(Ending::Everybody) => {}
        }
    }

    /// Listens no more, and ends when everybody has left or was told.
    fn shut_down(&mut self, cx: &mut Cx) {
        for (token, _) in self.doors.drain() {
            cx.remove_source(token);
        }
        self.stop_datagrams(cx);
        #[cfg(feature = "http")]
        if let Some(http) = self.http {
            // It is this object's child, and gone only if somebody destroyed it.
            let _ = http.stop_listening(cx);
        }
        if self.ending.is_none() {
            self.ending = Some(Ending::Insiders { until: cx.now() + INSIDERS_LINGER });
            self.after(cx);
        }
    }
}

/// How far the server's end has come.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Ending {
    /// Modules inside may still have something to say, and the disk to do.
    Insiders { until: Instant },
    /// They have said it; it goes out with the next flush.
    Flush,
    /// Everybody was told.
    Everybody,
    /// Nobody is left.
    Ended,
}

/// A listener or a connection is ready.
fn serve(cx: &mut Cx, server: ObjectId, readiness: Readiness) -> bool {
    cx.with(Handle::<SkFlowServer>::new(server), |server, cx| server.serve(cx, readiness))
        .unwrap_or(false)
}

/// Commands wait for their turn.
fn work(cx: &mut Cx, server: ObjectId, _readiness: Readiness) -> bool {
    let worked = cx.with(Handle::<SkFlowServer>::new(server), |server, cx| {
        let more = server.core.work(cx.now());
        server.after(cx);
        more
    });
    worked.unwrap_or(false)
}

fn flush(cx: &mut Cx, server: ObjectId) {
    // A server that was buried meanwhile has flushed in its hook.
    let _ = cx.with(Handle::<SkFlowServer>::new(server), |server, cx| server.flush(cx));
}

impl Handle<SkFlowServer> {
    /// Makes a connection inside the process; the seed becomes a satellite's link, on this loop or another
    /// thread's. It logs in as the owner's account with these rights.
    ///
    /// # Errors
    /// If the hub is full or the server gone.
    pub fn pipe(self, cx: &mut Cx, rights: Rights) -> io::Result<PipeSeed> {
        self.refuse_at_end(cx)?;
        let token = cx.add_source(self.id(), serve);
        let (near, far) = PipeEnd::pair();
        near.serve_by(cx, token);
        let mut nonce = [0; 32];
        cx.world().rng.fill(&mut nonce);
        let opened = cx.with(self, |server, cx| {
            let connection = server.core.open(Origin::Inside { rights }, nonce, cx.now())?;
            server.enlist(token, connection, Box::new(near));
            server.after(cx);
            Ok::<(), TooManyConnections>(())
        });
        opened.map_err(io::Error::other)?.map_err(io::Error::other)?;
        Ok(far)
    }

    /// As [`ServerCore::require_channel_binding`].
    ///
    /// # Errors
    /// If the server is gone, or one of its slots is running.
    pub fn require_channel_binding(self, cx: &mut Cx, required: bool) -> Result<(), Access> {
        cx.with(self, |server, _| server.core.require_channel_binding(required))
    }

    /// As [`ServerCore::narrow_channel_ids`].
    ///
    /// # Errors
    /// If the server is gone, or one of its slots is running.
    pub fn narrow_channel_ids(self, cx: &mut Cx, ids: std::ops::Range<u16>) -> Result<(), Access> {
        cx.with(self, |server, _| server.core.narrow_channel_ids(ids))
    }

    fn refuse_at_end(self, cx: &mut Cx) -> io::Result<()> {
        match cx.with(self, |server, _| server.ending.is_some()) {
            Ok(false) => Ok(()),
            Ok(true) => Err(io::Error::new(ErrorKind::NotConnected, "the server is ending")),
            Err(error) => Err(io::Error::other(error)),
        }
    }

    /// Ends the server: it listens no more; when the satellites inside the process have gone, or after a
    /// second, what is queued goes to those who take it at once, and everybody is told; then
    /// [`ended`](SkFlowServer::ended) is emitted. Peers that take nothing are given up after another second.
    ///
    /// # Errors
    /// If the server is gone, or one of its slots is running.
    pub fn shut_down(self, cx: &mut Cx) -> Result<(), Access> {
        cx.with(self, |server, cx| server.shut_down(cx))
    }

    /// The names of all channels with their subscribers' number, by identifier.
    ///
    /// # Errors
    /// If the server is gone, or one of its slots is running.
    pub fn channels(self, cx: &mut Cx) -> Result<Vec<(Name, usize)>, Access> {
        cx.with(self, |server, _| {
            server
                .core
                .channels()
                .map(|(channel, listeners)| (channel.name.clone(), listeners))
                .collect()
        })
    }
}
