//! A byte stream under TLS.

use super::settings::{TlsError, TlsIdentity, TlsTrust};
use crate::world::{Endpoint, Stream};
use rustls::pki_types::ServerName;
use rustls::{CertificateError, ClientConnection, Connection, ProtocolVersion, ServerConnection};
use std::io::{self, ErrorKind, IoSlice, Read, Write};
use std::net::IpAddr;

/// What may wait here to be sent: what a drop policy may still reach stays with the core.
const WAITING_BYTES_MAX: usize = 64 * 1024;
/// What RFC 9266 calls the bytes that a login is bound to.
const EXPORTER_LABEL: &[u8] = b"EXPORTER-Channel-Binding";
/// How many reads of the stream below one read here may make without a byte to show for it.
const FRUITLESS_READS_MAX: usize = 16;

/// One end of a TLS connection. The handshake is made by reading and writing; until it is, nothing can be written.
pub(crate) struct TlsStream {
    tls: Box<Connection>,
    below: Box<dyn Stream>,
}

/// The stream below, as rustls wants it.
struct Below<'a>(&'a mut dyn Stream);

impl Read for Below<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        self.0.read(into)
    }
}

impl Write for Below<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write_vectored(&[IoSlice::new(bytes)])
    }

    fn write_vectored(&mut self, parts: &[IoSlice<'_>]) -> io::Result<usize> {
        self.0.write_vectored(parts)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

impl TlsStream {
    /// The server's end.
    ///
    /// # Errors
    /// If rustls finds the settings unusable.
    pub(crate) fn accepted(below: Box<dyn Stream>, identity: &TlsIdentity) -> io::Result<TlsStream> {
        let tls = ServerConnection::new(identity.config.clone()).map_err(|error| unusable(error.into()))?;
        Ok(TlsStream::over(below, tls.into()))
    }

    /// The client's end, over a stream that may still be connecting.
    ///
    /// # Errors
    /// As [`accepted`](TlsStream::accepted).
    pub(crate) fn connect(below: Box<dyn Stream>, to: IpAddr, trust: &TlsTrust) -> io::Result<TlsStream> {
        let tls = ClientConnection::new(trust.config.clone(), ServerName::from(to))
            .map_err(|error| unusable(error.into()))?;
        Ok(TlsStream::over(below, tls.into()))
    }

    fn over(below: Box<dyn Stream>, mut tls: Connection) -> TlsStream {
        tls.set_buffer_limit(Some(WAITING_BYTES_MAX));
        TlsStream { tls: Box::new(tls), below }
    }

    /// Takes what the stream below has; whether that was anything.
    fn pull(&mut self) -> io::Result<bool> {
        let count = self.tls.read_tls(&mut Below(&mut *self.below))?;
        if let Err(error) = self.tls.process_new_packets() {
            // The peer hears why, if it takes anything.
            let _ = self.push();
            return Err(io::Error::new(ErrorKind::InvalidData, in_words(&error)));
        }
        Ok(count > 0)
    }

    /// Sends what waits.
    fn push(&mut self) -> io::Result<()> {
        while self.tls.wants_write() {
            self.tls.write_tls(&mut Below(&mut *self.below))?;
        }
        self.below.flush()
    }
}

/// What went wrong, for who chose the address and what to trust there.
fn in_words(error: &rustls::Error) -> String {
    match error {
        rustls::Error::InvalidCertificate(CertificateError::ApplicationVerificationFailure) => {
            "its certificate has another fingerprint than the one that is trusted".to_owned()
        }
        rustls::Error::InvalidCertificate(why) => format!("its certificate is not trusted: {why}"),
        rustls::Error::InvalidMessage(why) => format!("no TLS is spoken there: {why:?}"),
        rustls::Error::AlertReceived(why) => format!("the other end refused the TLS handshake: {why:?}"),
        other => other.to_string(),
    }
}

fn unusable(error: TlsError) -> io::Error {
    io::Error::new(ErrorKind::InvalidInput, error)
}

impl Stream for TlsStream {
    fn connected(&mut self) -> io::Result<bool> {
        self.below.connected()
    }

    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        for _ in 0..FRUITLESS_READS_MAX {
            match self.tls.reader().read(into) {
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                // The peer went without taking leave. Frames have their lengths: what was cut off shows.
                Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(0),
                other => return other,
            }
            if !self.pull()? && self.tls.is_handshaking() {
                return Ok(0);
            }
        }
        // A handshake under way, or records without content: others have their turn first.
        Err(ErrorKind::Interrupted.into())
    }

    fn write_vectored(&mut self, parts: &[IoSlice<'_>]) -> io::Result<usize> {
        self.push()?;
        if self.tls.is_handshaking() {
            return Err(ErrorKind::WouldBlock.into());
        }
        let count = self.tls.writer().write_vectored(parts)?;
        match self.push() {
            // It was taken and goes out with the next flush.
            Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(count),
            Err(error) => Err(error),
            Ok(()) => Ok(count),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.push()
    }

    fn shutdown_write(&mut self) -> io::Result<()> {
        self.tls.send_close_notify();
        // A peer that takes nothing sees the end of the stream instead.
        let _ = self.push();
        self.below.shutdown_write()
    }

    fn peer(&self) -> Option<Endpoint> {
        self.below.peer()
    }

    fn peer_uid(&self) -> Option<u32> {
        None
    }

    /// `tls-exporter` of RFC 9266. Of older versions than 1.3 it holds under conditions only.
    fn channel_binding(&self) -> Option<[u8; 32]> {
        if self.tls.is_handshaking() || self.tls.protocol_version() != Some(ProtocolVersion::TLSv1_3) {
            return None;
        }
        self.tls.export_keying_material([0; 32], EXPORTER_LABEL, Some(&[])).ok()
    }
}
