//! Where a hub is reached.

use crate::world::Endpoint;
use std::fmt;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The path of the flow in an HTTP server, if an address does not say another.
pub const FLOW_PATH: &str = "/flow";
/// The speed of a serial line, if an address does not say another.
const BAUD_DEFAULT: u32 = 115_200;
/// The longest path of an address.
const PATH_BYTES_MAX: usize = 255;

/// Where a hub is reached: `tcp:127.0.0.1:4141`, `unix:/run/user/1000/skrobot/hub.sock`,
/// `ws:127.0.0.1:4180/flow`, with TLS below `tls:127.0.0.1:4142` and `wss:127.0.0.1:4443/flow`, and over a serial
/// line `tty:/dev/ttyUSB0?baud=115200`. At `udp:127.0.0.1:4143` a hub takes what flows publish by datagrams; nobody
/// logs in there.
///
/// ```
/// use sk_core::flow::HubAddress;
///
/// let address: HubAddress = "tcp:127.0.0.1:4141".parse()?;
/// assert_eq!(address.to_string(), "tcp:127.0.0.1:4141");
/// let address: HubAddress = "ws:127.0.0.1:4180".parse()?;
/// assert_eq!(address.to_string(), "ws:127.0.0.1:4180/flow");
/// assert!("somewhere".parse::<HubAddress>().is_err());
/// # Ok::<(), sk_core::flow::AddressError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum HubAddress {
    /// TCP; the login is by the owner's token.
    Tcp(SocketAddr),
    /// A Unix socket; the login is by the user id of the process.
    Unix(PathBuf),
    /// WebSocket in an HTTP server; the login is as over TCP.
    WebSocket {
        /// The server.
        at: SocketAddr,
        /// The path there.
        path: String,
    },
    /// TLS over TCP.
    Tls(SocketAddr),
    /// UDP, for publishing only: a flow is told the port over its own connection.
    Udp(SocketAddr),
    /// WebSocket over TLS.
    SecureWebSocket {
        /// The server.
        at: SocketAddr,
        /// The path there.
        path: String,
    },
    /// A serial line; the login is as over TCP.
    Tty {
        /// The device.
        path: PathBuf,
        /// Its speed in bits a second; a satellite and its hub must mean the same.
        baud: u32,
    },
}

/// Why an address was not understood.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{0:?} is no address of a hub: write `tcp:HOST:PORT` with a numeric host, `unix:PATH`, `ws:HOST:PORT/flow`, \
     `tls:HOST:PORT`, `wss:HOST:PORT/flow`, `udp:HOST:PORT` or `tty:DEVICE?baud=115200`"
)]
pub struct AddressError(String);

impl HubAddress {
    /// The same as an endpoint of the world's network.
    pub fn endpoint(&self) -> Endpoint {
        match self {
            HubAddress::Tcp(at)
            | HubAddress::Tls(at)
            | HubAddress::Udp(at)
            | HubAddress::WebSocket { at, .. }
            | HubAddress::SecureWebSocket { at, .. } => Endpoint::Ip(*at),
            HubAddress::Unix(path) => Endpoint::Unix(path.clone()),
            HubAddress::Tty { path, baud } => Endpoint::Tty { path: path.clone(), baud: *baud },
        }
    }

    /// The same way to where something listens in fact, with the port that was chosen.
    pub(crate) fn listening_at(&self, local: &Endpoint) -> HubAddress {
        match (self, local) {
            (HubAddress::Tls(_), Endpoint::Ip(at)) => HubAddress::Tls(*at),
            (HubAddress::Udp(_), Endpoint::Ip(at)) => HubAddress::Udp(*at),
            (HubAddress::WebSocket { path, .. }, Endpoint::Ip(at)) => {
                HubAddress::WebSocket { at: *at, path: path.clone() }
            }
            (HubAddress::SecureWebSocket { path, .. }, Endpoint::Ip(at)) => {
                HubAddress::SecureWebSocket { at: *at, path: path.clone() }
            }
            _ => HubAddress::from(local),
        }
    }
}

impl From<&Endpoint> for HubAddress {
    fn from(endpoint: &Endpoint) -> HubAddress {
        match endpoint {
            Endpoint::Ip(at) => HubAddress::Tcp(*at),
            Endpoint::Unix(path) => HubAddress::Unix(path.clone()),
            Endpoint::Tty { path, baud } => HubAddress::Tty { path: path.clone(), baud: *baud },
        }
    }
}

impl From<&Path> for HubAddress {
    fn from(path: &Path) -> HubAddress {
        HubAddress::Unix(path.to_owned())
    }
}

impl FromStr for HubAddress {
    type Err = AddressError;
    fn from_str(text: &str) -> Result<HubAddress, AddressError> {
        let refused = || AddressError(text.to_owned());
        let ip = |at: &str| at.parse::<SocketAddr>().map_err(|_| refused());
        match text.split_once(':') {
            Some(("tcp", at)) => ip(at).map(HubAddress::Tcp),
            Some(("tls", at)) => ip(at).map(HubAddress::Tls),
            Some(("udp", at)) => ip(at).map(HubAddress::Udp),
            Some(("unix", path)) if !path.is_empty() => Ok(HubAddress::Unix(path.into())),
            Some(("tty", rest)) => {
                let (path, baud) = match rest.rsplit_once("?baud=") {
                    Some((path, baud)) => (path, baud.parse().map_err(|_| refused())?),
                    None => (rest, BAUD_DEFAULT),
                };
                if path.is_empty() { Err(refused()) } else { Ok(HubAddress::Tty { path: path.into(), baud }) }
            }
            Some((scheme @ ("ws" | "wss"), rest)) => {
                let (at, path) = match rest.find('/') {
                    Some(slash) => rest.split_at(slash),
                    None => (rest, FLOW_PATH),
                };
                let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"/._-~".contains(&byte);
                if path.len() > PATH_BYTES_MAX || !path.bytes().all(is_plain) {
                    return Err(refused());
                }
                let (at, path) = (ip(at)?, path.to_owned());
                Ok(match scheme {
                    "ws" => HubAddress::WebSocket { at, path },
                    _ => HubAddress::SecureWebSocket { at, path },
                })
            }
            _ => Err(refused()),
        }
    }
}

impl fmt::Display for HubAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            HubAddress::Tcp(at) => write!(f, "tcp:{at}"),
            HubAddress::Unix(path) => write!(f, "unix:{}", path.display()),
            HubAddress::WebSocket { at, path } => write!(f, "ws:{at}{path}"),
            HubAddress::Tls(at) => write!(f, "tls:{at}"),
            HubAddress::Udp(at) => write!(f, "udp:{at}"),
            HubAddress::SecureWebSocket { at, path } => write!(f, "wss:{at}{path}"),
            HubAddress::Tty { path, baud } => write!(f, "tty:{}?baud={baud}", path.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_address_reads_as_it_is_written() {
        for text in [
            "tcp:127.0.0.1:1",
            "unix:/run/hub.sock",
            "ws:[::1]:80/flow",
            "ws:192.0.2.1:4180/a/b",
            "tls:127.0.0.1:2",
            "udp:[::1]:3",
            "wss:127.0.0.1:443/flow",
            "tty:/dev/ttyUSB0?baud=9600",
        ] {
            assert_eq!(text.parse::<HubAddress>().map(|at| at.to_string()), Ok(text.to_owned()));
        }
        for text in [
            "",
            "tcp:",
            "tcp:host:1",
            "udp:7",
            "unix:",
            "ws:127.0.0.1/flow",
            "tty:",
            "tty:/dev/x?baud=fast",
            "ws:127.0.0.1:1/a b",
            "wss:/x",
        ] {
            assert!(text.parse::<HubAddress>().is_err(), "{text}");
        }
        assert!(
            "ws:127.0.0.1:1/\r\nHost:evil".parse::<HubAddress>().is_err(),
            "no line enters the request"
        );
    }
}
