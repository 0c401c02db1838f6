//! Kinds of values that only a configuration has.

use sk_core::flow::HubAddress;
use sk_core::module::ParameterType;
use sk_core::prelude::*;
use sk_flat::{FromVariant, IntoVariant, VariantError};
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};

/// Where the hub listens for TCP unless told otherwise.
pub const TCP_DEFAULT: SocketAddr = SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 4141));

/// How a loop waits, as a configuration writes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoopMode {
    /// `coarse`: a sleep of one interval.
    Coarse,
    /// `realtime`: an absolute schedule.
    Realtime,
    /// `select-io`: traffic wakes it early.
    SelectIo,
}

const MODES: &[&str] = &["coarse", "realtime", "select-io"];

impl LoopMode {
    /// The same, as loops know it.
    pub fn timing(self) -> TimingMode {
        match self {
            LoopMode::Coarse => TimingMode::Coarse,
            LoopMode::Realtime => TimingMode::Realtime,
            LoopMode::SelectIo => TimingMode::SelectIo,
        }
    }
}

impl IntoVariant for LoopMode {
    fn into_variant(self) -> SkVariant {
        match self {
            LoopMode::Coarse => "coarse".into(),
            LoopMode::Realtime => "realtime".into(),
            LoopMode::SelectIo => "select-io".into(),
        }
    }
}

impl FromVariant for LoopMode {
    fn from_variant(value: &SkVariant) -> Result<LoopMode, VariantError> {
        match text(value)? {
            "coarse" => Ok(LoopMode::Coarse),
            "realtime" => Ok(LoopMode::Realtime),
            "select-io" => Ok(LoopMode::SelectIo),
            other => Err(VariantError::UnknownCase { found: other.into(), known: MODES }),
        }
    }
}

impl ParameterType for LoopMode {
    fn schema() -> SkVariant {
        SkVariant::map([("enum", SkVariant::list(MODES.iter().copied()))])
    }
}

/// Where to listen for TCP: `HOST:PORT` with a numeric host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TcpAddress(pub SocketAddr);

impl std::str::FromStr for TcpAddress {
    type Err = String;
    fn from_str(text: &str) -> Result<TcpAddress, String> {
        text.parse()
            .map(TcpAddress)
            .map_err(|_| format!("{text:?} is no HOST:PORT with a numeric host, such as 127.0.0.1:4141"))
    }
}

impl IntoVariant for TcpAddress {
    fn into_variant(self) -> SkVariant {
        self.0.to_string().into()
    }
}

impl FromVariant for TcpAddress {
    fn from_variant(value: &SkVariant) -> Result<TcpAddress, VariantError> {
        text(value)?.parse().map_err(|error: String| VariantError::Custom(error.into()))
    }
}

impl ParameterType for TcpAddress {
    fn schema() -> SkVariant {
        let pattern = r"^(\[[0-9a-fA-F:.%]+\]|[0-9.]+):[0-9]{1,5}$";
        SkVariant::map([("type", "string".into()), ("pattern", pattern.into())])
    }
}

/// Where to listen, in any way that a hub is reached.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListenAddress(pub HubAddress);

impl IntoVariant for ListenAddress {
    fn into_variant(self) -> SkVariant {
        self.0.to_string().into()
    }
}

impl FromVariant for ListenAddress {
    fn from_variant(value: &SkVariant) -> Result<ListenAddress, VariantError> {
        let address = text(value)?.parse::<HubAddress>();
        address
            .map(ListenAddress)
            .map_err(|error| VariantError::Custom(error.to_string().into()))
    }
}

impl ParameterType for ListenAddress {
    fn schema() -> SkVariant {
        let pattern = r"^(tcp|tls|unix|ws|wss|tty|udp):.+$";
        SkVariant::map([("type", "string".into()), ("pattern", pattern.into())])
    }
}

fn text(value: &SkVariant) -> Result<&str, VariantError> {
    value
        .as_str()
        .ok_or(VariantError::Expected { expected: "string", found: value.kind() })
}
