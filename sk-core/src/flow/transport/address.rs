//! Where a hub is reached.

use crate::world::Endpoint;
use std::fmt;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Where a hub is reached: `tcp:127.0.0.1:4141` or `unix:/run/user/1000/skrobot/hub.sock`.
///
/// ```
/// use sk_core::flow::HubAddress;
///
/// let address: HubAddress = "tcp:127.0.0.1:4141".parse()?;
/// assert_eq!(address.to_string(), "tcp:127.0.0.1:4141");
/// assert!("somewhere".parse::<HubAddress>().is_err());
/// # Ok::<(), sk_core::flow::AddressError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum HubAddress {
    /// TCP; the login is by the owner's token.
    Tcp(SocketAddr),
    /// A Unix socket; the login is by the user id of the process.
    Unix(PathBuf),
}

/// Why an address was not understood.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no address of a hub: write `tcp:HOST:PORT` with a numeric host, or `unix:PATH`")]
pub struct AddressError(String);

impl HubAddress {
    /// The same as an endpoint of the world's network.
    pub fn endpoint(&self) -> Endpoint {
        match self {
            HubAddress::Tcp(at) => Endpoint::Ip(*at),
            HubAddress::Unix(path) => Endpoint::Unix(path.clone()),
        }
    }
}

impl From<&Endpoint> for HubAddress {
    fn from(endpoint: &Endpoint) -> HubAddress {
        match endpoint {
            Endpoint::Ip(at) => HubAddress::Tcp(*at),
            Endpoint::Unix(path) => HubAddress::Unix(path.clone()),
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
        match text.split_once(':') {
            Some(("tcp", at)) => at.parse().map(HubAddress::Tcp).map_err(|_| refused()),
            Some(("unix", path)) if !path.is_empty() => Ok(HubAddress::Unix(path.into())),
            _ => Err(refused()),
        }
    }
}

impl fmt::Display for HubAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            HubAddress::Tcp(at) => write!(f, "tcp:{at}"),
            HubAddress::Unix(path) => write!(f, "unix:{}", path.display()),
        }
    }
}
