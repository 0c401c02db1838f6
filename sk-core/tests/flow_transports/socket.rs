//! Blocking sockets of the operating system, for peers that are not of this library.

use sk_core::flow::HubAddress;
use sk_core::world::Endpoint;
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;

pub enum Socket {
    Tcp(TcpStream),
    Unix(UnixStream),
}

impl Socket {
    pub fn connect(to: &HubAddress) -> io::Result<Socket> {
        match to.endpoint() {
            Endpoint::Ip(at) => TcpStream::connect(at).map(Socket::Tcp),
            Endpoint::Unix(path) => UnixStream::connect(path).map(Socket::Unix),
            other => panic!("{other:?} is no socket"),
        }
    }

    pub fn clone(&self) -> Socket {
        match self {
            Socket::Tcp(socket) => Socket::Tcp(socket.try_clone().expect("descriptors are left")),
            Socket::Unix(socket) => Socket::Unix(socket.try_clone().expect("descriptors are left")),
        }
    }

    pub fn end(&self) {
        // It may have ended already.
        let _ = match self {
            Socket::Tcp(socket) => socket.shutdown(Shutdown::Both),
            Socket::Unix(socket) => socket.shutdown(Shutdown::Both),
        };
    }

    pub fn never_wait(&self) {
        match self {
            Socket::Tcp(socket) => socket.set_nonblocking(true),
            Socket::Unix(socket) => socket.set_nonblocking(true),
        }
        .expect("the socket is open");
    }

    /// Drops what has come; whether the other side has ended the connection.
    pub fn is_over(&mut self) -> bool {
        let mut room = [0; 4096];
        loop {
            match self.read(&mut room) {
                Ok(0) => return true,
                Ok(_) => {}
                Err(error) => return error.kind() != io::ErrorKind::WouldBlock,
            }
        }
    }
}

impl Read for Socket {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Socket::Tcp(socket) => socket.read(into),
            Socket::Unix(socket) => socket.read(into),
        }
    }
}

impl Write for Socket {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Socket::Tcp(socket) => socket.write(bytes),
            Socket::Unix(socket) => socket.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

pub enum Listening {
    Tcp(TcpListener),
    Unix(UnixListener, PathBuf),
}

impl Listening {
    /// A place of the same kind as `like`, with the address through which it is reached.
    pub fn like(like: &HubAddress, path: PathBuf) -> (Listening, HubAddress) {
        if let HubAddress::Unix(_) = like {
            let listener = UnixListener::bind(&path).expect("the temporary folder can be written");
            return (Listening::Unix(listener, path.clone()), HubAddress::Unix(path));
        }
        let listener = TcpListener::bind("127.0.0.1:0").expect("the loopback has a free port");
        let at = listener.local_addr().expect("it listens");
        let text = like.to_string();
        let (scheme, rest) = text.split_once(':').expect("a scheme");
        let path = rest.find('/').map_or("", |slash| &rest[slash..]);
        let address = format!("{scheme}:{at}{path}").parse().expect("the same with another port");
        (Listening::Tcp(listener), address)
    }

    pub fn accept(&self) -> io::Result<Socket> {
        match self {
            Listening::Tcp(listener) => listener.accept().map(|(socket, _)| Socket::Tcp(socket)),
            Listening::Unix(listener, _) => listener.accept().map(|(socket, _)| Socket::Unix(socket)),
        }
    }
}

impl Drop for Listening {
    fn drop(&mut self) {
        if let Listening::Unix(_, path) = self {
            // Left behind it would only litter the temporary folder.
            let _ = std::fs::remove_file(path);
        }
    }
}
