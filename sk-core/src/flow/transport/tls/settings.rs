//! What a server shows and what a client trusts.

use super::pin::{Pinned, fingerprint_of};
use rustls::client::Resumption;
use rustls::crypto::{CryptoProvider, ring};
use rustls::pki_types::pem::{self, PemObject};
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::server::NoServerSessionStorage;
use rustls::{ClientConfig, RootCertStore, ServerConfig};
use std::fmt;
use std::sync::Arc;
use thiserror::Error;

/// Why certificates or keys cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TlsError {
    /// The text is no PEM, or has nothing of what is needed.
    #[error("this is no PEM file of {what}: {error}")]
    Pem {
        /// What was expected.
        what: &'static str,
        /// What is wrong.
        error: pem::Error,
    },
    /// There is no certificate in the text.
    #[error("there is no certificate in the file")]
    Empty,
    /// Certificate and key do not fit, or are of a kind that is not supported.
    #[error("the certificate cannot be used: {0}")]
    Unusable(#[from] rustls::Error),
    /// The text is no fingerprint.
    #[error(
        "a fingerprint is the 64 hexadecimal digits of the certificate's SHA-256, with or without colons"
    )]
    Fingerprint,
}

fn provider() -> Arc<CryptoProvider> {
    Arc::new(ring::default_provider())
}

fn certificates(text: &[u8]) -> Result<Vec<CertificateDer<'static>>, TlsError> {
    let read: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(text).collect();
    let read = read.map_err(|error| TlsError::Pem { what: "certificates", error })?;
    if read.is_empty() { Err(TlsError::Empty) } else { Ok(read) }
}

/// What a server shows to those who connect by TLS: its certificate, with those that lead to the authority, and
/// that it has the key.
///
/// ```
/// use sk_core::flow::transport::{TlsIdentity, TlsTrust};
///
/// let made = rcgen::generate_simple_self_signed(["127.0.0.1".to_string()])?;
/// let (certificate, key) = (made.cert.pem(), made.signing_key.serialize_pem());
/// let identity = TlsIdentity::from_pem(certificate.as_bytes(), key.as_bytes())?;
/// let trust = TlsTrust::pinned(&identity.fingerprint())?;
/// # let _ = trust;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
pub struct TlsIdentity {
    pub(super) config: Arc<ServerConfig>,
    fingerprint: [u8; 32],
}

impl TlsIdentity {
    /// From the texts of two PEM files: the certificate, followed by those that lead to the authority, and its key.
    ///
    /// # Errors
    /// If the texts are no such files, or do not fit each other.
    pub fn from_pem(chain: &[u8], key: &[u8]) -> Result<TlsIdentity, TlsError> {
        let chain = certificates(chain)?;
        let fingerprint = chain.first().map(fingerprint_of).ok_or(TlsError::Empty)?;
        let key = PrivateKeyDer::from_pem_slice(key)
            .map_err(|error| TlsError::Pem { what: "a private key", error })?;
        let mut config = ServerConfig::builder_with_provider(provider())
            .with_safe_default_protocol_versions()?
            .with_no_client_auth()
            .with_single_cert(chain, key)?;
        // Satellites stay connected: what would make a second handshake cheaper is memory for nothing.
        config.session_storage = Arc::new(NoServerSessionStorage {});
        config.send_tls13_tickets = 0;
        Ok(TlsIdentity { config: Arc::new(config), fingerprint })
    }

    /// The SHA-256 of the certificate as 64 hexadecimal digits, for clients that pin it.
    pub fn fingerprint(&self) -> String {
        self.fingerprint.iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

impl fmt::Debug for TlsIdentity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "TlsIdentity({})", self.fingerprint())
    }
}

/// Which servers a client believes to be who they say.
#[derive(Clone)]
pub struct TlsTrust {
    pub(super) config: Arc<ClientConfig>,
}

impl TlsTrust {
    /// Those whose certificate comes from one of the authorities in the text of a PEM file and names their address.
    ///
    /// # Errors
    /// If the text is no such file.
    pub fn authority_pem(text: &[u8]) -> Result<TlsTrust, TlsError> {
        let mut roots = RootCertStore::empty();
        for certificate in certificates(text)? {
            roots.add(certificate)?;
        }
        let config = ClientConfig::builder_with_provider(provider())
            .with_safe_default_protocol_versions()?
            .with_root_certificates(roots)
            .with_no_client_auth();
        Ok(TlsTrust::of(config))
    }

    /// The one whose certificate has this fingerprint, whatever the certificate says: for a hub that made its own.
    ///
    /// # Errors
    /// If the text is no fingerprint.
    pub fn pinned(fingerprint: &str) -> Result<TlsTrust, TlsError> {
        let provider = provider();
        let pinned = Pinned::new(parse_fingerprint(fingerprint)?, provider.signature_verification_algorithms);
        let config = ClientConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()?
            .dangerous()
            .with_custom_certificate_verifier(Arc::new(pinned))
            .with_no_client_auth();
        Ok(TlsTrust::of(config))
    }

    fn of(mut config: ClientConfig) -> TlsTrust {
        config.resumption = Resumption::disabled();
        TlsTrust { config: Arc::new(config) }
    }
}

impl fmt::Debug for TlsTrust {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("TlsTrust")
    }
}

fn parse_fingerprint(text: &str) -> Result<[u8; 32], TlsError> {
    let digits: Option<Vec<u8>> = text
        .chars()
        .filter(|character| *character != ':')
        .map(|character| character.to_digit(16).map(|digit| digit as u8))
        .collect();
    let digits = digits.filter(|digits| digits.len() == 64).ok_or(TlsError::Fingerprint)?;
    let mut bytes = [0; 32];
    for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
        *byte = pair[0] << 4 | pair[1];
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fingerprint_is_read_with_and_without_colons() {
        let plain = "0f".repeat(32);
        let colons = vec!["0F"; 32].join(":");
        assert_eq!(parse_fingerprint(&plain).ok(), Some([15; 32]));
        assert_eq!(parse_fingerprint(&colons).ok(), Some([15; 32]));
        for wrong in ["", "0f", &plain[1..], &format!("{plain}0"), &plain.replace('f', "g")] {
            assert!(matches!(parse_fingerprint(wrong), Err(TlsError::Fingerprint)), "{wrong}");
        }
    }

    #[test]
    fn files_that_are_none_are_refused_in_words() {
        let made = rcgen::generate_simple_self_signed(["127.0.0.1".to_owned()]).expect("a certificate");
        let (certificate, key) = (made.cert.pem(), made.signing_key.serialize_pem());
        let other = rcgen::KeyPair::generate().expect("a key").serialize_pem();
        assert!(TlsIdentity::from_pem(certificate.as_bytes(), key.as_bytes()).is_ok());
        let wrong = |chain: &str, key: &str| {
            TlsIdentity::from_pem(chain.as_bytes(), key.as_bytes())
                .expect_err("refused")
                .to_string()
        };
        assert!(wrong("", &key).contains("no certificate"));
        assert!(wrong(&certificate, "").contains("no PEM file of a private key"));
        assert!(wrong(&certificate, &other).contains("cannot be used"));
        assert!(TlsTrust::authority_pem(b"-----BEGIN CERTIFICATE-----\n").is_err());
    }
}
