//! What a service manager is told: systemd's notification socket.
//!
//! The manager names a datagram socket in `NOTIFY_SOCKET`, and the program sends it lines: `READY=1` when it
//! serves, `STOPPING=1` when it begins to end, and `WATCHDOG=1` as often as `WATCHDOG_USEC` asks for.

use std::env;
use std::ffi::OsStr;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::Duration;

/// The service manager that started this program.
///
/// ```
/// use sk_robot::notify::ServiceManager;
/// use std::os::unix::net::UnixDatagram;
///
/// let path = std::env::temp_dir().join(format!("sk-notify-doc-{}", std::process::id()));
/// let manager = UnixDatagram::bind(&path)?;
/// let service = ServiceManager::at(path.as_os_str())?;
/// service.tell("READY=1")?;
/// let mut line = [0; 16];
/// let length = manager.recv(&mut line)?;
/// assert_eq!(&line[..length], b"READY=1");
/// # std::fs::remove_file(&path)?;
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct ServiceManager {
    socket: UnixDatagram,
    address: SocketAddr,
}

impl ServiceManager {
    /// The one named in the environment; none if there is none.
    ///
    /// # Errors
    /// The address cannot be, or there is no descriptor for a socket.
    pub fn from_environment() -> io::Result<Option<ServiceManager>> {
        match env::var_os("NOTIFY_SOCKET").filter(|address| !address.is_empty()) {
            Some(address) => ServiceManager::at(&address).map(Some),
            None => Ok(None),
        }
    }

    /// The one at a path, or at a name without a file if it begins with `@`.
    ///
    /// # Errors
    /// The address cannot be, or there is no descriptor for a socket.
    pub fn at(address: &OsStr) -> io::Result<ServiceManager> {
        let address = match address.as_bytes().strip_prefix(b"@") {
            Some(name) => SocketAddr::from_abstract_name(name)?,
            None => SocketAddr::from_pathname(address)?,
        };
        let socket = UnixDatagram::unbound()?;
        // A manager that does not read must not hold up a loop.
        socket.set_nonblocking(true)?;
        Ok(ServiceManager { socket, address })
    }

    /// Sends lines such as `READY=1`. Never waits.
    ///
    /// # Errors
    /// The manager is gone or does not read.
    pub fn tell(&self, lines: &str) -> io::Result<()> {
        self.socket.send_to_addr(lines.as_bytes(), &self.address).map(|_| ())
    }
}

/// How often the manager wants to hear `WATCHDOG=1` from this process, at least; none if it does not. A sign of
/// life is sent twice as often.
pub fn watchdog_period() -> Option<Duration> {
    let number = |name: &str| env::var(name).ok()?.parse::<u64>().ok();
    // The variables are inherited; the process id says whom they mean.
    if env::var_os("WATCHDOG_PID").is_some() && number("WATCHDOG_PID") != Some(u64::from(std::process::id()))
    {
        return None;
    }
    number("WATCHDOG_USEC").filter(|us| *us > 0).map(Duration::from_micros)
}
