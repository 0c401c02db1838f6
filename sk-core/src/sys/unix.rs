//! Unix sockets: a private socket file from its very creation, and who is at the other end.

use nix::sys::socket::{
    AddressFamily, Backlog, SockFlag, SockType, UnixAddr, bind, getsockopt, listen, socket, sockopt,
};
use nix::sys::stat::{Mode, fchmod};
use std::io;
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::path::Path;

/// How many connections may wait to be accepted.
const WAITING_MAX: i32 = 1024;

/// A non-blocking socket that listens at the new socket file `path`, of mode 0600.
///
/// # Errors
/// `AddrInUse` if there is any file of that name.
pub(crate) fn listen_private(path: &Path) -> io::Result<OwnedFd> {
    let flags = SockFlag::SOCK_CLOEXEC | SockFlag::SOCK_NONBLOCK;
    let fd = socket(AddressFamily::Unix, SockType::Stream, flags, None)?;
    // Linux gives the new file the mode of the socket less the umask. Setting it before the file exists
    // leaves no moment in which others may connect, and the process-wide umask is not touched.
    fchmod(fd.as_fd(), Mode::S_IRUSR | Mode::S_IWUSR)?;
    bind(fd.as_raw_fd(), &UnixAddr::new(path)?)?;
    listen(&fd, Backlog::new(WAITING_MAX)?)?;
    Ok(fd)
}

/// The user id of the process at the other end of a connected Unix socket.
pub(crate) fn peer_uid(of: &impl AsFd) -> io::Result<u32> {
    Ok(getsockopt(of, sockopt::PeerCredentials)?.uid())
}
