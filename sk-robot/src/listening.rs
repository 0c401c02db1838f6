//! Where a hub listens, as its configuration says.

use crate::config::Config;
use crate::hub_error::HubError;
use crate::places::Places;
use sk_core::flow::{HubAddress, SkFlowServer, TlsIdentity};
use sk_core::prelude::*;
use std::io::{self, ErrorKind};
use std::path::Path;

/// The longest certificate or key that is read.
const PEM_BYTES_MAX: u64 = 1024 * 1024;

/// Where a hub listens, and the fingerprint of the certificate that it shows there.
type Listening = (Vec<HubAddress>, Option<String>);

/// Listens everywhere it is told to; answers where that is in fact.
pub(crate) fn listen(
    cx: &mut Cx,
    server: Handle<SkFlowServer>,
    config: &Config,
    places: &Places,
) -> Result<Listening, HubError> {
    let unix = config.listen.unix.then(|| (places.address(), "--state-dir (`state_dir`)"));
    let tcp = config
        .listen
        .tcp
        .iter()
        .map(|at| (HubAddress::Tcp(at.0), "--tcp (`listen.tcp`)"));
    let others = config.listen.addresses.iter();
    let others = others.map(|at| (at.0.clone(), "--listen (`listen.addresses`)"));
    let identity = identity(cx, config)?;
    let mut addresses = Vec::new();
    for (address, option) in unix.into_iter().chain(tcp).chain(others) {
        let local = match (&address, &identity) {
            (HubAddress::Tls(_) | HubAddress::SecureWebSocket { .. }, None) => {
                return Err(HubError::NoCertificate(address));
            }
            (HubAddress::Tls(_) | HubAddress::SecureWebSocket { .. }, Some(identity)) => {
                server.listen_secured(cx, &address, identity.clone())
            }
            _ => server.listen(cx, &address),
        };
        addresses.push(local.map_err(|error| refused(error, address, option))?);
    }
    Ok((addresses, identity.map(|identity| identity.fingerprint())))
}

fn refused(error: io::Error, address: HubAddress, option: &'static str) -> HubError {
    match error.kind() {
        ErrorKind::AddrInUse => HubError::Taken { address, option },
        _ => HubError::Listen { address, error },
    }
}

/// The certificate and its key, if there are any.
fn identity(cx: &mut Cx, config: &Config) -> Result<Option<TlsIdentity>, HubError> {
    let (certificate, key) = match (&config.listen.tls_certificate, &config.listen.tls_key) {
        (None, None) => return Ok(None),
        (Some(certificate), Some(key)) => (certificate, key),
        (Some(path), None) => return Err(wrong("tls_key", path, "this certificate has no key beside it")),
        (None, Some(path)) => {
            return Err(wrong("tls_certificate", path, "this key has no certificate beside it"));
        }
    };
    let mut read = |name: &'static str, path: &str| {
        let bytes = cx.world().storage.read(Path::new(path), PEM_BYTES_MAX);
        bytes.map_err(|error| wrong(name, path, error))
    };
    let (chain, secret) = (read("tls_certificate", certificate)?, read("tls_key", key)?);
    let identity = TlsIdentity::from_pem(&chain, &secret);
    identity.map(Some).map_err(|error| wrong("tls_certificate", certificate, error))
}

fn wrong(key: &'static str, path: &str, why: impl ToString) -> HubError {
    HubError::Tls { key, path: path.to_owned(), why: why.to_string() }
}
