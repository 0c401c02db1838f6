//! Sockets and readiness.

mod addresses;
mod bell;
mod endpoint;
mod faults;
mod machines;
mod real;
mod real_socket;
mod real_token;
mod real_tty;
mod real_waker;
mod reserve;
mod sim_socket;
mod simulated;
mod socket_file;
mod switch;
mod wire;

pub(crate) use bell::SimulatedBell;
pub use faults::LinkFaults;
pub use machines::Death;
pub use real::RealNet;
pub(crate) use simulated::{Network, SIMULATED_UID};
pub use simulated::{SimulatedNet, SimulatedShare};
pub use wire::NetworkSettings;

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// What a source is known by when it becomes ready: chosen by the loop, never reused while events of
/// the former bearer may be under way (it carries a generation).
///
/// It has to fit the machine's word, and the two highest values of that are the real net's own: a socket
/// with such a token is refused as `InvalidInput`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Token(pub u64);

/// One report of [`Net::wait`]: edge-triggered, so read or write until `WouldBlock`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Readiness {
    /// Whose.
    pub token: Token,
    /// Something can be read or accepted, or the end of the stream was reached.
    pub readable: bool,
    /// Something can be written, or a connection under way was made or failed.
    pub writable: bool,
}

/// Where something listens or is reached.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Endpoint {
    /// An address and port of IPv4 or IPv6. Port 0 asks for any free one.
    Ip(SocketAddr),
    /// A socket file. The file is made with mode 0600 and removed when its listener is dropped.
    Unix(PathBuf),
    /// A serial port: it is opened by connecting, and nobody can listen there.
    Tty {
        /// The device, `/dev/ttyUSB0`.
        path: PathBuf,
        /// Its speed in bits a second.
        baud: u32,
    },
}

/// Wakes a loop that sleeps in [`Net::wait`], from any thread.
pub trait Wake: Send + Sync {
    /// Makes the wait under way, or the next one, return at once. Calls made before that wait returns
    /// are joined into one.
    fn wake(&self);
}

/// The sockets of one loop and the wait for their readiness.
pub trait Net {
    /// Waits until a source is ready, a [`Wake`] is used or `timeout` has passed, and adds what is
    /// ready to `ready`. `Some(ZERO)` looks without waiting; `None` waits for ever. Precise to
    /// microseconds below 2 ms (a timerfd), to the millisecond above.
    fn wait(&mut self, timeout: Option<Duration>, ready: &mut Vec<Readiness>) -> io::Result<()>;

    /// A handle that ends this loop's wait from another thread.
    fn waker(&self) -> Arc<dyn Wake>;

    /// Listens for streams; readiness to accept is reported with `token`.
    fn listen(&mut self, at: &Endpoint, token: Token) -> io::Result<Box<dyn Listener>>;

    /// Begins to connect; the outcome is reported as `writable`, and [`Stream::connected`] tells it.
    ///
    /// # Errors
    /// What is known at once: there is no such socket file (`NotFound`), no process behind it
    /// (`ConnectionRefused`) or no room with it (`WouldBlock`), or no descriptor or port is left.
    fn connect(&mut self, to: &Endpoint, token: Token) -> io::Result<Box<dyn Stream>>;

    /// Binds a datagram socket (UDP).
    fn bind(&mut self, at: SocketAddr, token: Token) -> io::Result<Box<dyn Datagram>>;

    /// Watches a POSIX signal set; readiness for reading is reported with `token`. Only the
    /// application's main loop asks for it, once, after [`block_os_signals`](Net::block_os_signals).
    fn watch_os_signals(&mut self, token: Token) -> io::Result<Box<dyn OsSignals>>;

    /// Blocks SIGINT, SIGTERM and SIGHUP for this thread and those it starts. Must come before the first thread.
    fn block_os_signals(&mut self) -> io::Result<()>;

    /// Gives SIGINT, SIGTERM and SIGHUP their usual effect again on this thread: from now on they end the process at
    /// once. For a program that was asked to end once already, and may hang.
    fn release_os_signals(&mut self) -> io::Result<()>;
}

/// A POSIX signal that an application hears.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum OsSignal {
    /// SIGINT: Ctrl-C.
    Interrupt,
    /// SIGTERM: the service manager wants an end.
    Terminate,
    /// SIGHUP: the terminal is gone, or somebody wants the configuration read again.
    HangUp,
}

/// Arrived POSIX signals.
pub trait OsSignals {
    /// The next one that has arrived, never waiting. No system call other than one read.
    fn take(&mut self) -> io::Result<Option<OsSignal>>;
}

/// Accepts streams. Dropping it stops listening.
pub trait Listener {
    /// Where it listens, with the port that was chosen.
    fn local(&self) -> Endpoint;

    /// The next waiting stream, to be reported with `token`; `WouldBlock` if there is none.
    ///
    /// # Errors
    /// EMFILE and ENFILE when there is no descriptor for it but those that are left free for others. Streams may
    /// go on waiting then, and are not reported again: who gets such an error has to try again later by himself.
    fn accept(&mut self, token: Token) -> io::Result<Box<dyn Stream>>;
}

/// A connected byte stream that never blocks. Dropping it closes it.
pub trait Stream {
    /// Whether a connection begun by [`Net::connect`] is made: `Ok(false)` while it is under way.
    fn connected(&mut self) -> io::Result<bool>;

    /// Reads into `into`: `Ok(0)` is the end of the stream, `WouldBlock` nothing for now.
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize>;

    /// Writes the first bytes of `parts` in one system call and answers how many.
    fn write_vectored(&mut self, parts: &[io::IoSlice<'_>]) -> io::Result<usize>;

    /// Writes what the stream itself holds back, answers to its own handshakes included. A socket holds
    /// nothing; a layer over one (TLS, WebSocket) does.
    ///
    /// # Errors
    /// `WouldBlock` while something is left: readiness to write is reported when more can go.
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }

    /// Tells the peer that nothing more will be written.
    fn shutdown_write(&mut self) -> io::Result<()>;

    /// The other end, where it has a name.
    fn peer(&self) -> Option<Endpoint>;

    /// The user id of the process at the other end of a Unix socket (SO_PEERCRED); `None` for TCP.
    fn peer_uid(&self) -> Option<u32>;

    /// What both ends of a layer with keys of its own know and nobody between them, once they have agreed: with it
    /// a login is bound to this very connection. `None` where there is no such layer.
    fn channel_binding(&self) -> Option<[u8; 32]> {
        None
    }
}

/// A datagram socket that never blocks.
pub trait Datagram {
    /// Where it is bound.
    fn local(&self) -> SocketAddr;

    /// The next datagram and its sender; what does not fit into `into` is lost.
    fn receive(&mut self, into: &mut [u8]) -> io::Result<(usize, SocketAddr)>;

    /// Sends one datagram.
    fn send(&mut self, to: SocketAddr, datagram: &[u8]) -> io::Result<usize>;
}
