//! Real listeners, streams and datagram sockets.

use super::real_token::poll_token;
use super::reserve::{Guests, Reserve, exhausted};
use super::socket_file::SocketFile;
use super::{Datagram, Endpoint, Listener, Stream, Token};
use crate::sys::unix;
use mio::event::Source;
use mio::net::{TcpListener, TcpStream, UdpSocket, UnixListener, UnixStream};
use mio::{Interest, Registry};
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr};
use std::os::fd::{AsRawFd, RawFd};
use std::rc::Rc;

/// Passes the registration on to the socket inside, whichever it is.
macro_rules! source_of {
    ($type:ty, $field:ident: $($variant:pat => $inner:ident),+) => {
        impl Source for $type {
            fn register(&mut self, with: &Registry, token: mio::Token, what: Interest) -> io::Result<()> {
                match &mut self.$field { $($variant => $inner.register(with, token, what)),+ }
            }
            fn reregister(&mut self, with: &Registry, token: mio::Token, what: Interest) -> io::Result<()> {
                match &mut self.$field { $($variant => $inner.reregister(with, token, what)),+ }
            }
            fn deregister(&mut self, with: &Registry) -> io::Result<()> {
                match &mut self.$field { $($variant => $inner.deregister(with)),+ }
            }
        }
    };
}

source_of!(RealListener, socket: ListenerSocket::Tcp(s, _) => s, ListenerSocket::Unix(s, _) => s);
source_of!(RealStream, socket: StreamSocket::Tcp(s) => s, StreamSocket::Unix(s) => s);
source_of!(RealDatagram, socket: s => s);

enum ListenerSocket {
    Tcp(TcpListener, SocketAddr),
    Unix(UnixListener, SocketFile),
}

/// A listening socket. What it accepts is registered with the poll of the loop it belongs to.
pub(super) struct RealListener {
    socket: ListenerSocket,
    registry: Rc<Registry>,
    reserve: Reserve,
}

impl RealListener {
    pub(super) fn tcp(at: SocketAddr, registry: Rc<Registry>) -> io::Result<RealListener> {
        let listener = TcpListener::bind(at)?;
        let local = listener.local_addr()?;
        let (socket, reserve) = (ListenerSocket::Tcp(listener, local), Reserve::new(Guests::Network));
        Ok(RealListener { socket, registry, reserve })
    }

    pub(super) fn unix(listener: UnixListener, file: SocketFile, registry: Rc<Registry>) -> RealListener {
        let (socket, reserve) = (ListenerSocket::Unix(listener, file), Reserve::new(Guests::SameUser));
        RealListener { socket, registry, reserve }
    }
}

fn next(socket: &ListenerSocket) -> io::Result<RealStream> {
    match socket {
        ListenerSocket::Tcp(listener, _) => {
            let (stream, from) = listener.accept()?;
            stream.set_nodelay(true)?;
            Ok(RealStream::accepted(StreamSocket::Tcp(stream), Some(Endpoint::Ip(from))))
        }
        ListenerSocket::Unix(listener, _) => {
            let (stream, from) = listener.accept()?;
            let peer = from.as_pathname().map(|path| Endpoint::Unix(path.to_owned()));
            Ok(RealStream::accepted(StreamSocket::Unix(stream), peer))
        }
    }
}

impl Listener for RealListener {
    fn local(&self) -> Endpoint {
        match &self.socket {
            ListenerSocket::Tcp(_, local) => Endpoint::Ip(*local),
            ListenerSocket::Unix(_, file) => Endpoint::Unix(file.path().to_owned()),
        }
    }

    fn accept(&mut self, token: Token) -> io::Result<Box<dyn Stream>> {
        let token = poll_token(token)?;
        loop {
            match next(&self.socket) {
                Ok(stream) if self.reserve.is_touched_by(stream.descriptor()) => return Err(exhausted()),
                Ok(mut stream) => {
                    self.registry
                        .register(&mut stream, token, Interest::READABLE | Interest::WRITABLE)?;
                    return Ok(Box::new(stream));
                }
                // The peer gave up while it waited: nobody is there to be accepted, the next may be.
                Err(error) if error.kind() == io::ErrorKind::ConnectionAborted => {}
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => {
                    let Self { socket, reserve, .. } = self;
                    reserve.turn_away(&error, || next(socket));
                    return Err(error);
                }
            }
        }
    }
}

enum StreamSocket {
    Tcp(TcpStream),
    Unix(UnixStream),
}

/// How far a stream's connection is.
enum Progress {
    UnderWay,
    Made,
    /// The kernel tells the error once only; it is kept by its number.
    Failed(i32),
}

/// A connected socket, or one that is being connected.
pub(super) struct RealStream {
    socket: StreamSocket,
    progress: Progress,
    peer: Option<Endpoint>,
}

impl RealStream {
    pub(super) fn connect(to: &Endpoint) -> io::Result<RealStream> {
        let socket = match to {
            Endpoint::Ip(to) => {
                let stream = TcpStream::connect(*to)?;
                // Frames are gathered by the loop's flush; Nagle's waiting would only add delay.
                stream.set_nodelay(true)?;
                StreamSocket::Tcp(stream)
            }
            Endpoint::Unix(path) => StreamSocket::Unix(UnixStream::connect(path)?),
            // The net opens ports itself.
            Endpoint::Tty { .. } => return Err(io::ErrorKind::Unsupported.into()),
        };
        Ok(RealStream { socket, progress: Progress::UnderWay, peer: Some(to.clone()) })
    }

    fn descriptor(&self) -> RawFd {
        match &self.socket {
            StreamSocket::Tcp(socket) => socket.as_raw_fd(),
            StreamSocket::Unix(socket) => socket.as_raw_fd(),
        }
    }

    fn accepted(socket: StreamSocket, peer: Option<Endpoint>) -> RealStream {
        RealStream { socket, progress: Progress::Made, peer }
    }

    fn take_error(&self) -> io::Result<Option<io::Error>> {
        match &self.socket {
            StreamSocket::Tcp(stream) => stream.take_error(),
            StreamSocket::Unix(stream) => stream.take_error(),
        }
    }

    fn has_peer(&self) -> io::Result<()> {
        match &self.socket {
            StreamSocket::Tcp(stream) => stream.peer_addr().map(drop),
            StreamSocket::Unix(stream) => stream.peer_addr().map(drop),
        }
    }
}

impl Stream for RealStream {
    fn connected(&mut self) -> io::Result<bool> {
        match self.progress {
            Progress::Made => return Ok(true),
            Progress::Failed(number) => return Err(io::Error::from_raw_os_error(number)),
            Progress::UnderWay => {}
        }
        if let Some(error) = self.take_error()? {
            if let Some(number) = error.raw_os_error() {
                self.progress = Progress::Failed(number);
            }
            return Err(error);
        }
        match self.has_peer() {
            Ok(()) => {
                self.progress = Progress::Made;
                Ok(true)
            }
            Err(error) if error.kind() == io::ErrorKind::NotConnected => Ok(false),
            Err(error) => Err(error),
        }
    }

    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match &mut self.socket {
            StreamSocket::Tcp(stream) => stream.read(into),
            StreamSocket::Unix(stream) => stream.read(into),
        }
    }

    fn write_vectored(&mut self, parts: &[io::IoSlice<'_>]) -> io::Result<usize> {
        match &mut self.socket {
            StreamSocket::Tcp(stream) => stream.write_vectored(parts),
            StreamSocket::Unix(stream) => stream.write_vectored(parts),
        }
    }

    fn shutdown_write(&mut self) -> io::Result<()> {
        match &self.socket {
            StreamSocket::Tcp(stream) => stream.shutdown(Shutdown::Write),
            StreamSocket::Unix(stream) => stream.shutdown(Shutdown::Write),
        }
    }

    fn peer(&self) -> Option<Endpoint> {
        self.peer.clone()
    }

    fn peer_uid(&self) -> Option<u32> {
        match &self.socket {
            StreamSocket::Tcp(_) => None,
            StreamSocket::Unix(stream) => unix::peer_uid(stream).ok(),
        }
    }
}

/// A bound UDP socket.
pub(super) struct RealDatagram {
    socket: UdpSocket,
    local: SocketAddr,
}

impl RealDatagram {
    pub(super) fn bind(at: SocketAddr) -> io::Result<RealDatagram> {
        let socket = UdpSocket::bind(at)?;
        let local = socket.local_addr()?;
        Ok(RealDatagram { socket, local })
    }
}

impl Datagram for RealDatagram {
    fn local(&self) -> SocketAddr {
        self.local
    }

    fn receive(&mut self, into: &mut [u8]) -> io::Result<(usize, SocketAddr)> {
        self.socket.recv_from(into)
    }

    fn send(&mut self, to: SocketAddr, datagram: &[u8]) -> io::Result<usize> {
        self.socket.send_to(datagram, to)
    }
}
