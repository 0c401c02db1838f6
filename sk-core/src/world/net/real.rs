//! The machine's sockets, through mio.

use super::real_socket::{RealDatagram, RealListener, RealStream};
use super::real_token::{TIMER, WAKER, poll_token};
use super::real_tty::RealTty;
use super::real_waker::RealWaker;
use super::socket_file::SocketFile;
use super::{Datagram, Endpoint, Listener, Net, OsSignal, OsSignals, Readiness, Stream, Token, Wake};
use crate::sys::signal::{self, EndingSignals};
use crate::sys::timer::{self, PollTimer};
use mio::event::Event;
use mio::unix::SourceFd;
use mio::{Events, Interest, Poll, Registry};
use std::io;
use std::net::SocketAddr;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

/// How many sources one look at the kernel can report; the others come with the next one.
const EVENTS_MAX: usize = 1024;

/// From here on a time-out is left to the poll, which rounds it up to whole milliseconds.
const COARSE_TIMEOUT_MIN: Duration = Duration::from_millis(2);

/// An armed timer this near the wanted instant is left as it is. A loop that waits again for the same
/// instant asks for it through a fresh reading of the clock, some hundred nanoseconds off.
const TIMER_TOLERANCE_NS: u64 = 2_000;

/// The sockets of one loop on the real machine: an epoll (and its duplicate for listeners), an eventfd
/// and a timerfd, all closed on exec. As long as it never had a socket, its longer waits go by without them:
/// the thread is parked. It has to be used on the thread that made it.
///
/// ```
/// use sk_core::world::{Net, RealNet};
/// use std::time::Duration;
///
/// let mut net = RealNet::new()?;
/// net.waker().wake();
/// let mut ready = Vec::new();
/// net.wait(None, &mut ready)?; // returns because it was woken
/// assert!(ready.is_empty());
/// net.wait(Some(Duration::from_micros(100)), &mut ready)?; // returns because the time is over
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct RealNet {
    poll: Poll,
    // Listeners register what they accept; a clone of the registry by mio would cost a descriptor each.
    registry: Rc<Registry>,
    events: Events,
    waker: Arc<RealWaker>,
    timer: PollTimer,
    /// When the timer expires, 0 if it is not armed.
    armed_for_ns: u64,
    /// There is, or was, something that can become ready.
    has_sources: bool,
}

impl RealNet {
    /// An empty set of sources.
    pub fn new() -> io::Result<RealNet> {
        let poll = Poll::new()?;
        let registry = Rc::new(poll.registry().try_clone()?);
        let waker = Arc::new(RealWaker::new(mio::Waker::new(&registry, WAKER)?));
        let timer = PollTimer::new()?;
        registry.register(&mut SourceFd(&timer.raw_fd()), TIMER, Interest::READABLE)?;
        let events = Events::with_capacity(EVENTS_MAX);
        Ok(RealNet { poll, registry, events, waker, timer, armed_for_ns: 0, has_sources: false })
    }

    /// Prepares what ends the wait and answers the time-out for the poll itself.
    fn arm(&mut self, end_ns: Option<u64>, remaining: Option<Duration>) -> io::Result<Option<Duration>> {
        match (end_ns, remaining) {
            (Some(end_ns), Some(remaining)) if !remaining.is_zero() && remaining < COARSE_TIMEOUT_MIN => {
                if self.armed_for_ns.abs_diff(end_ns) > TIMER_TOLERANCE_NS {
                    self.timer.arm(end_ns)?;
                    self.armed_for_ns = end_ns;
                }
                Ok(None)
            }
            (_, Some(Duration::ZERO)) => Ok(Some(Duration::ZERO)),
            _ => {
                // A timer left from a shorter wait would end this one early.
                if self.armed_for_ns != 0 {
                    self.timer.disarm()?;
                    self.armed_for_ns = 0;
                }
                Ok(remaining)
            }
        }
    }

    /// Hands on what the poll has found; answers whether anything was found that ends the wait.
    fn report(&mut self, ready: &mut Vec<Readiness>) -> bool {
        let mut ends = false;
        for event in &self.events {
            match event.token() {
                WAKER => ends = true,
                TIMER => {
                    self.armed_for_ns = 0;
                    ends = true;
                }
                _ => {
                    ready.push(readiness(event));
                    ends = true;
                }
            }
        }
        ends
    }
}

fn no_listening() -> io::Error {
    io::Error::new(io::ErrorKind::Unsupported, "nobody can listen at a serial port: connect to it")
}

/// What an event says. An error or a hang-up makes reads and writes return at once, so it is both.
fn readiness(event: &Event) -> Readiness {
    Readiness {
        token: Token(event.token().0 as u64),
        readable: event.is_readable() || event.is_read_closed() || event.is_error(),
        writable: event.is_writable() || event.is_write_closed() || event.is_error(),
    }
}

impl Net for RealNet {
    fn wait(&mut self, timeout: Option<Duration>, ready: &mut Vec<Readiness>) -> io::Result<()> {
        // The clock is read only for a wait that time can end.
        let end_ns = timeout.filter(|span| !span.is_zero()).map(|span| {
            let span_ns = u64::try_from(span.as_nanos()).unwrap_or(u64::MAX);
            timer::monotonic_ns().saturating_add(span_ns)
        });
        let sleeps = timeout.is_none_or(|span| !span.is_zero());
        // Below that the poll's timer is more exact than the time-out of a parked thread.
        if sleeps && !self.has_sources && timeout.is_none_or(|span| span >= COARSE_TIMEOUT_MIN) {
            self.waker.park(end_ns);
            return Ok(());
        }
        let mut remaining = timeout;
        loop {
            let poll_timeout = self.arm(end_ns, remaining)?;
            let (poll, events) = (&mut self.poll, &mut self.events);
            let polled = match sleeps {
                true => self.waker.while_polling(|| poll.poll(events, poll_timeout)),
                false => None,
            };
            // A wake that came before the poll makes it a mere look.
            match polled.unwrap_or_else(|| self.poll.poll(&mut self.events, Some(Duration::ZERO))) {
                Ok(()) => {
                    let woken = sleeps && self.waker.take_wake();
                    if self.report(ready) || woken || poll_timeout.is_some() {
                        return Ok(());
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
            // Interrupted: the wait goes on for what is left of it.
            remaining = end_ns.map(|end| Duration::from_nanos(end.saturating_sub(timer::monotonic_ns())));
            if timeout.is_some() && remaining.is_none_or(|left| left.is_zero()) {
                return Ok(());
            }
        }
    }

    fn waker(&self) -> Arc<dyn Wake> {
        self.waker.clone()
    }

    fn listen(&mut self, at: &Endpoint, token: Token) -> io::Result<Box<dyn Listener>> {
        let token = poll_token(token)?;
        self.has_sources = true;
        let mut listener = match at {
            Endpoint::Ip(at) => RealListener::tcp(*at, self.registry.clone())?,
            Endpoint::Unix(path) => {
                let (listener, file) = SocketFile::listen(path)?;
                RealListener::unix(listener, file, self.registry.clone())
            }
            Endpoint::Tty { .. } => return Err(no_listening()),
        };
        self.registry.register(&mut listener, token, Interest::READABLE)?;
        Ok(Box::new(listener))
    }

    fn connect(&mut self, to: &Endpoint, token: Token) -> io::Result<Box<dyn Stream>> {
        let token = poll_token(token)?;
        self.has_sources = true;
        let both = Interest::READABLE | Interest::WRITABLE;
        if let Endpoint::Tty { path, baud } = to {
            let port = RealTty::open(path, *baud)?;
            self.registry.register(&mut SourceFd(&port.raw_fd()), token, both)?;
            return Ok(Box::new(port));
        }
        let mut stream = RealStream::connect(to)?;
        self.registry.register(&mut stream, token, both)?;
        Ok(Box::new(stream))
    }

    fn bind(&mut self, at: SocketAddr, token: Token) -> io::Result<Box<dyn Datagram>> {
        let token = poll_token(token)?;
        self.has_sources = true;
        let mut socket = RealDatagram::bind(at)?;
        self.registry
            .register(&mut socket, token, Interest::READABLE | Interest::WRITABLE)?;
        Ok(Box::new(socket))
    }

    fn watch_os_signals(&mut self, token: Token) -> io::Result<Box<dyn OsSignals>> {
        let token = poll_token(token)?;
        self.has_sources = true;
        let signals = EndingSignals::new()?;
        self.registry
            .register(&mut SourceFd(&signals.raw_fd()), token, Interest::READABLE)?;
        Ok(Box::new(signals))
    }

    fn block_os_signals(&mut self) -> io::Result<()> {
        signal::block_ending()
    }

    fn release_os_signals(&mut self) -> io::Result<()> {
        signal::release_ending()
    }
}

impl OsSignals for EndingSignals {
    fn take(&mut self) -> io::Result<Option<OsSignal>> {
        Ok(EndingSignals::take(self)?.map(|number| match number {
            libc::SIGINT => OsSignal::Interrupt,
            libc::SIGHUP => OsSignal::HangUp,
            // The set has three members.
            _ => OsSignal::Terminate,
        }))
    }
}
