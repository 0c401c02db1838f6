//! The server as an object: listeners, connections and what they are answered.

use super::answer::Answer;
use super::connection::{Connection, Overdue};
use super::request::Method;
#[cfg(feature = "websocket")]
use super::site::Upgrade;
use super::site::{HttpSettings, Page, Reply, Site};
use super::site::{TakeUpgraded, Upgraded};
use crate::eventloop::Timer;
use crate::net::{Door, Shortage, Wrap};
use crate::object::{Access, Handle, ObjectId};
use crate::world::{Endpoint, Readiness, Stream, Token};
use crate::{Cx, attach};
use bytes::Bytes;
use rustc_hash::FxHashMap;
use std::io::{self, ErrorKind};
use std::time::Duration;

/// How many connections may be open that have not become something else. The one that has been quiet for
/// longest makes room for a new one, so that those who ask at once always find a place.
const CONNECTIONS_MAX: usize = 256;
/// How many connections one listener takes in one turn.
const ACCEPTS_PER_TURN_MAX: usize = 64;
/// How many requests one connection is answered in one turn.
const REQUESTS_PER_TURN_MAX: usize = 16;
/// How long a listener waits when the process is out of descriptors.
const ACCEPT_AGAIN_AFTER: Duration = Duration::from_millis(100);
/// How often deadlines are looked at, while anybody is connected.
const CHECK_EVERY: Duration = Duration::from_millis(250);

/// A small HTTP server: it answers GET and HEAD of [pages](Handle#method.page-1) that stand in memory.
///
/// Only requests to a name of this host are answered (else 421), and of browsers only those whose page came
/// from here (else 403); [`HttpSettings`] allows more. Each connection has two seconds for the head of a
/// request, ten between two of them, and ten in which it has to take something of its answer.
///
/// ```
/// use sk_core::net::http::{HttpServer, HttpSettings, Page};
/// use sk_core::prelude::*;
///
/// let mut app = SkApp::builder().mode(TimingMode::SelectIo).build()?;
/// let server = HttpServer::start(app.cx(), HttpSettings::default());
/// let at = server.listen(app.cx(), &Endpoint::Ip("127.0.0.1:0".parse()?))?;
/// server.page(app.cx(), "/", Page { kind: "text/plain", body: "hello".into() })?;
/// assert!(matches!(at, Endpoint::Ip(at) if at.port() != 0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct HttpServer {
    doors: FxHashMap<Token, Door>,
    served: FxHashMap<Token, Served>,
    site: Site,
    check: Handle<Timer>,
    room: Vec<u8>,
    shortage: Shortage,
}

struct Served {
    stream: Box<dyn Stream>,
    connection: Connection,
}

crate::object! { pub HttpServer { slots { on_check() } } }

/// What a turn of a connection came to.
enum Turn {
    Wait,
    More,
    Over,
    Upgrade { answer: Bytes, take: TakeUpgraded },
}

impl HttpServer {
    /// A server that listens nowhere yet and has no pages.
    pub fn start(cx: &mut Cx, settings: HttpSettings) -> Handle<HttpServer> {
        HttpServer::placed(cx.named("http"), settings)
    }

    /// As [`start`](HttpServer::start), with a place in the tree.
    pub fn placed(place: crate::eventloop::Spawner<'_>, settings: HttpSettings) -> Handle<HttpServer> {
        place.spawn_with(|cx, this: Handle<HttpServer>| {
            let check = cx.under(this).spawn(Timer::default());
            attach!(cx, check.timeout => this.on_check);
            HttpServer {
                doors: FxHashMap::default(),
                served: FxHashMap::default(),
                site: Site { settings, ..Site::default() },
                check,
                room: vec![0; super::HEAD_BYTES_MAX],
                shortage: Shortage::default(),
            }
        })
    }

    fn accept(&mut self, cx: &mut Cx, at: Token) -> bool {
        let this = cx.this(self);
        for _ in 0..ACCEPTS_PER_TURN_MAX {
            let Some(door) = self.doors.get_mut(&at) else { return false };
            let token = cx.add_source(this.id(), serve);
            match door.accept(token) {
                Ok(stream) => self.take_in(cx, token, stream),
                Err(error) => {
                    cx.remove_source(token);
                    match error.kind() {
                        ErrorKind::WouldBlock => return false,
                        // The peer has gone again between its arrival and now.
                        ErrorKind::ConnectionAborted | ErrorKind::Interrupted => {}
                        _ => {
                            if self.shortage.is_news(cx.now()) {
                                tracing::error!("HTTP connections cannot be taken in for now: {error}");
                            }
                            cx.offer_source_after(at, ACCEPT_AGAIN_AFTER);
                            return false;
                        }
                    }
                }
            }
        }
        true
    }

    fn take_in(&mut self, cx: &mut Cx, token: Token, stream: Box<dyn Stream>) {
        if self.served.len() >= CONNECTIONS_MAX {
            let quietest = self
                .served
                .iter()
                .min_by_key(|(token, s)| (s.connection.quiet_since(), **token));
            if let Some(quietest) = quietest.map(|(token, _)| *token) {
                self.drop_connection(cx, quietest);
            }
        }
        if self.served.is_empty() {
            // The timer is this object's child and lives as long as it.
            let _ = self.check.start(cx, CHECK_EVERY);
        }
        self.served
            .insert(token, Served { stream, connection: Connection::new(cx.now()) });
    }

    fn drop_connection(&mut self, cx: &mut Cx, token: Token) {
        cx.remove_source(token);
        self.served.remove(&token);
        self.rest_if_alone(cx);
    }

    fn rest_if_alone(&mut self, cx: &mut Cx) {
        if self.served.is_empty() {
            // As above.
            let _ = self.check.stop(cx);
        }
    }

    fn serve(&mut self, cx: &mut Cx, token: Token) -> (bool, Option<Handover>) {
        if self.doors.contains_key(&token) {
            return (self.accept(cx, token), None);
        }
        let now = cx.now();
        let Some(served) = self.served.get_mut(&token) else { return (false, None) };
        match served.turn(&self.site, &mut self.room, now) {
            Turn::Wait => (false, None),
            Turn::More => (true, None),
            Turn::Over => {
                self.drop_connection(cx, token);
                (false, None)
            }
            Turn::Upgrade { answer, take } => {
                let Some(Served { stream, connection }) = self.served.remove(&token) else {
                    return (false, None);
                };
                self.rest_if_alone(cx);
                let (leftover, begun) = connection.into_rest();
                let upgraded = Upgraded { stream, token, answer, leftover, begun };
                (false, Some(Handover { upgraded, take }))
            }
        }
    }

    fn on_check(&mut self, cx: &mut Cx) {
        let now = cx.now();
        let mut overdue: Vec<(Token, Overdue)> = self
            .served
            .iter()
            .map(|(token, served)| (*token, served.connection.check(now)))
            .filter(|(_, overdue)| *overdue != Overdue::No)
            .collect();
        // The order of a hash map reaches no output.
        overdue.sort_by_key(|(token, _)| *token);
        for (token, overdue) in overdue {
            if overdue == Overdue::Say
                && let Some(served) = self.served.get_mut(&token)
            {
                let late = Answer::words(408, "The request did not come in time.");
                served.connection.answer(&late, &Method::Get, false, now);
                cx.offer_source(token);
            } else {
                self.drop_connection(cx, token);
            }
        }
    }
}

impl Served {
    /// Writes, reads and answers what one turn allows.
    fn turn(&mut self, site: &Site, room: &mut [u8], now: sk_flat::Instant) -> Turn {
        for _ in 0..REQUESTS_PER_TURN_MAX {
            match self.write(now) {
                Ok(true) => {}
                Ok(false) => return Turn::Wait,
                Err(_) => return Turn::Over,
            }
            match self.connection.next() {
                Ok(Some(request)) => match site.reply(&request) {
                    Reply::Upgrade { answer, take } => return Turn::Upgrade { answer, take },
                    Reply::Answer(answer) => {
                        self.connection.answer(&answer, request.method(), request.keeps_alive(), now);
                        continue;
                    }
                },
                Ok(None) => {}
                Err(error) => {
                    self.connection.answer(&Answer::from(&error), &Method::Get, false, now);
                    continue;
                }
            }
            let most = room.len().min(self.connection.room());
            match self.stream.read(&mut room[..most]) {
                Ok(0) => return Turn::Over,
                Ok(count) => self.connection.receive(&room[..count], now),
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    // A layer may have to answer a handshake of its own.
                    let flushed = self.stream.flush();
                    let failed = flushed.is_err_and(|error| error.kind() != ErrorKind::WouldBlock);
                    return if failed { Turn::Over } else { Turn::Wait };
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return Turn::Over,
            }
        }
        Turn::More
    }

    /// Whether everything is written.
    fn write(&mut self, now: sk_flat::Instant) -> io::Result<bool> {
        while self.connection.has_output() {
            match self.stream.write_vectored(&self.connection.slices()) {
                Ok(count) => self.connection.wrote(count, now),
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(false),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        match self.stream.flush() {
            Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(!self.connection.is_last()),
            other => other?,
        }
        if self.connection.ends_writing() {
            self.stream.shutdown_write()?;
        }
        Ok(true)
    }
}

/// A connection on its way to whoever registered its path.
struct Handover {
    upgraded: Upgraded,
    take: TakeUpgraded,
}

/// A listener or a connection is ready.
fn serve(cx: &mut Cx, server: ObjectId, readiness: Readiness) -> bool {
    let server = Handle::<HttpServer>::new(server);
    let served = cx.with(server, |server, cx| server.serve(cx, readiness.token));
    let (more, handover) = served.unwrap_or((false, None));
    // Unleased: who takes the connection may register pages here.
    if let Some(Handover { upgraded, take }) = handover {
        take(cx, upgraded);
    }
    more
}

impl Handle<HttpServer> {
    /// Listens at an address as well; answers where, with the port that was chosen for port 0.
    ///
    /// # Errors
    /// If the address is taken or may not be used, or the server is gone.
    pub fn listen(self, cx: &mut Cx, at: &Endpoint) -> io::Result<Endpoint> {
        self.listen_through(cx, at, None)
    }

    /// As [`listen`](Handle::listen), with a layer over each connection.
    pub(crate) fn listen_through(
        self,
        cx: &mut Cx,
        at: &Endpoint,
        wrap: Option<Wrap>,
    ) -> io::Result<Endpoint> {
        let token = cx.add_source(self.id(), serve);
        let listener = match cx.world().net.listen(at, token) {
            Ok(listener) => listener,
            Err(error) => {
                cx.remove_source(token);
                return Err(error);
            }
        };
        let door = Door::new(listener, wrap);
        let local = door.local();
        cx.with(self, |server, _| {
            server.site.listens_at(&local);
            server.doors.insert(token, door);
        })
        .map_err(io::Error::other)?;
        Ok(local)
    }

    /// Shows a page at a path, in the place of one that was there.
    ///
    /// # Errors
    /// If the server is gone, or one of its slots is running.
    pub fn page(self, cx: &mut Cx, path: &str, page: Page) -> Result<(), Access> {
        cx.with(self, |server, _| {
            server.site.pages.insert(path.to_owned(), page);
        })
    }

    /// Answers to whatever else these settings allow.
    ///
    /// # Errors
    /// As [`page`](Handle::page).
    pub fn allow(self, cx: &mut Cx, settings: HttpSettings) -> Result<(), Access> {
        cx.with(self, |server, _| server.site.settings.join(settings))
    }

    /// Lets connections upgrade at a path.
    #[cfg(feature = "websocket")]
    pub(crate) fn upgrade_at(self, cx: &mut Cx, path: &str, upgrade: Upgrade) -> Result<(), Access> {
        cx.with(self, |server, _| {
            server.site.upgrades.insert(path.to_owned(), upgrade);
        })
    }

    /// Listens no more. Connections that are open are answered to their end.
    ///
    /// # Errors
    /// As [`page`](Handle::page).
    pub fn stop_listening(self, cx: &mut Cx) -> Result<(), Access> {
        cx.with(self, |server, cx| {
            for (token, _) in server.doors.drain() {
                cx.remove_source(token);
            }
        })
    }
}
