//! WebSocket as a layer over a byte stream: binary messages carry the bytes of the flow protocol, cut anywhere.
//!
//! The upgrade is answered and asked for here; frames, masks, pings and the closing handshake are tungstenite's.
//! No extension is ever agreed to, so nothing is compressed. The masks of a client are the one thing here that
//! does not come from the world's randomness: they hide bytes from proxies and change nothing that is seen at
//! either end.

use crate::net::http::{Answer, HEAD_BYTES_MAX, HEADERS_MAX, Method, Request};
use crate::testing::{Bug, is_planted};
use crate::world::{Endpoint, Rng, Stream};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use bytes::{Buf, Bytes, BytesMut};
use std::io::{self, ErrorKind, IoSlice, Read, Write};
use std::net::SocketAddr;
use tungstenite::handshake::derive_accept_key;
use tungstenite::protocol::frame::coding::CloseCode;
use tungstenite::protocol::{CloseFrame, Role, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};

/// The longest message, and frame, that is taken: a whole frame of the flow protocol fits with room to spare.
const MESSAGE_BYTES_MAX: usize = 128 * 1024;
/// The longest message that is sent. What was sent last may wait in a buffer of this size.
const SENT_BYTES_MAX: usize = 32 * 1024;
/// What may wait for the stream: a message and answers to pings.
const WAITING_BYTES_MAX: usize = 2 * SENT_BYTES_MAX;
/// How many characters of what a server says beside its refusal are shown.
const WORDS_SHOWN_MAX: usize = 200;
/// What a connection keeps for reading, also when it is idle.
const READ_BUFFER_BYTES: usize = 8 * 1024;

/// A stream under WebSocket.
pub(crate) struct WebSocketStream {
    state: State,
}

enum State {
    /// A client's: the request is under way, the answer not yet whole.
    Asking {
        below: Below,
        key: String,
        answer: BytesMut,
    },
    Open {
        socket: Box<WebSocket<Below>>,
        /// What was not read yet of the last message.
        message: Bytes,
    },
    Over,
}

/// The stream below, with what goes out before anything else.
struct Below {
    stream: Box<dyn Stream>,
    first: Bytes,
}

impl Below {
    fn send_first(&mut self) -> io::Result<()> {
        while !self.first.is_empty() {
            let count = self.stream.write_vectored(&[IoSlice::new(&self.first)])?;
            self.first.advance(count);
        }
        Ok(())
    }
}

impl Read for Below {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        self.stream.read(into)
    }
}

impl Write for Below {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.send_first()?;
        self.stream.write_vectored(&[IoSlice::new(bytes)])
    }

    fn flush(&mut self) -> io::Result<()> {
        self.send_first()?;
        self.stream.flush()
    }
}

fn config() -> WebSocketConfig {
    WebSocketConfig::default()
        .read_buffer_size(READ_BUFFER_BYTES)
        .write_buffer_size(0)
        .max_write_buffer_size(WAITING_BYTES_MAX)
        .max_message_size(Some(MESSAGE_BYTES_MAX))
        .max_frame_size(Some(MESSAGE_BYTES_MAX))
}

/// The head that agrees to the upgrade, or why there is none.
pub(crate) fn agree(request: &Request) -> Result<Bytes, Answer> {
    let field = |name| request.field(name).map_err(|error| Answer::from(&error));
    let upgrades = request.lists("upgrade", "websocket") && request.lists("connection", "upgrade");
    if *request.method() != Method::Get || !upgrades {
        let words =
            "This path is for WebSocket. Ask with GET, `Upgrade: websocket` and `Connection: Upgrade`.";
        return Err(Answer::words(426, words).with("Upgrade", "websocket"));
    }
    if field("sec-websocket-version")? != Some("13") {
        let answer = Answer::words(426, "Only version 13 of WebSocket is spoken here.");
        return Err(answer.with("Upgrade", "websocket").with("Sec-WebSocket-Version", "13"));
    }
    let key = field("sec-websocket-key")?.unwrap_or_default();
    if BASE64.decode(key).map_or(0, |bytes| bytes.len()) != 16 {
        return Err(Answer::words(400, "The Sec-WebSocket-Key must be 16 bytes in base64."));
    }
    Ok(Bytes::from(format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Accept: {}\r\n\r\n",
        derive_accept_key(key.as_bytes())
    )))
}

impl WebSocketStream {
    /// The server's end: `answer` goes out first, `leftover` came after the request.
    pub(crate) fn accepted(stream: Box<dyn Stream>, answer: Bytes, leftover: Vec<u8>) -> WebSocketStream {
        WebSocketStream { state: open(Below { stream, first: answer }, leftover, Role::Server) }
    }

    /// The client's end, over a stream that may still be connecting.
    pub(crate) fn connect(
        stream: Box<dyn Stream>,
        at: SocketAddr,
        path: &str,
        rng: &mut dyn Rng,
    ) -> WebSocketStream {
        let mut nonce = [0; 16];
        rng.fill(&mut nonce);
        let key = BASE64.encode(nonce);
        let first = Bytes::from(format!(
            "GET {path} HTTP/1.1\r\nHost: {at}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
             Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n"
        ));
        WebSocketStream {
            state: State::Asking { below: Below { stream, first }, key, answer: BytesMut::new() },
        }
    }

    fn stream(&self) -> Option<&dyn Stream> {
        match &self.state {
            State::Asking { below, .. } => Some(&*below.stream),
            State::Open { socket, .. } => Some(&*socket.get_ref().stream),
            State::Over => None,
        }
    }

    /// Reads the server's answer until it is whole.
    fn hear_answer(&mut self) -> io::Result<()> {
        let State::Asking { below, key, answer } = &mut self.state else { return Ok(()) };
        match below.flush() {
            // A layer below may have to read before it can write.
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::NotConnected) => {}
            other => other?,
        }
        let mut room = [0; 1024];
        let length = loop {
            let count = below.stream.read(&mut room)?;
            if count == 0 {
                return Err(io::Error::new(
                    ErrorKind::UnexpectedEof,
                    "the connection ended before the upgrade",
                ));
            }
            answer.extend_from_slice(&room[..count]);
            if let Some(length) = check_answer(answer, key)? {
                break length;
            }
            if answer.len() > HEAD_BYTES_MAX {
                return Err(io::Error::new(ErrorKind::InvalidData, "the answer to the upgrade is too long"));
            }
        };
        let leftover = answer.split_off(length).to_vec();
        if let State::Asking { below, .. } = std::mem::replace(&mut self.state, State::Over) {
            self.state = open(below, leftover, Role::Client);
        }
        Ok(())
    }

    /// The next message that carries bytes.
    fn next_message(&mut self) -> io::Result<Option<Bytes>> {
        let State::Open { socket, .. } = &mut self.state else { return Ok(None) };
        let code = match socket.read() {
            Ok(Message::Binary(message)) => return Ok(Some(message)),
            Ok(Message::Text(_)) => CloseCode::Unsupported,
            // Nothing to hand on; the caller decides whether this turn has room for another look.
            Ok(_) => return Err(ErrorKind::Interrupted.into()),
            Err(Error::ConnectionClosed | Error::AlreadyClosed) => return Ok(None),
            Err(Error::Io(error)) => return Err(error),
            Err(Error::Protocol(tungstenite::error::ProtocolError::ResetWithoutClosingHandshake)) => {
                return Ok(None);
            }
            Err(Error::Capacity(_)) => CloseCode::Size,
            Err(Error::Utf8(_)) => CloseCode::Invalid,
            Err(_) => CloseCode::Protocol,
        };
        let reason = match code {
            CloseCode::Unsupported => "binary messages only",
            CloseCode::Size => "a message was too long",
            _ => "this is no WebSocket",
        };
        // The peer hears why if it still listens.
        let _ = socket.close(Some(CloseFrame { code, reason: reason.into() }));
        Err(io::Error::new(ErrorKind::InvalidData, reason))
    }
}

fn open(below: Below, leftover: Vec<u8>, role: Role) -> State {
    let socket = WebSocket::from_partially_read(below, leftover, role, Some(config()));
    State::Open { socket: Box::new(socket), message: Bytes::new() }
}

/// The length of the head that agrees to the upgrade; `None` while it is not whole.
fn check_answer(bytes: &[u8], key: &str) -> io::Result<Option<usize>> {
    let refused = |what: String| io::Error::new(ErrorKind::InvalidData, what);
    let mut places = [httparse::EMPTY_HEADER; HEADERS_MAX];
    let mut head = httparse::Response::new(&mut places);
    let length = match head.parse(bytes) {
        Ok(httparse::Status::Complete(length)) => length,
        Ok(httparse::Status::Partial) => return Ok(None),
        Err(error) => return Err(refused(format!("no HTTP server answers there: {error}"))),
    };
    if head.code != Some(101) {
        let (code, reason) = (head.code.unwrap_or_default(), head.reason.unwrap_or_default());
        let words = words_of(&bytes[length..]);
        return Err(refused(format!("the HTTP server there refuses the upgrade: {code} {reason}{words}")));
    }
    let field = |name: &str| {
        let found = head.headers.iter().find(|field| field.name.eq_ignore_ascii_case(name));
        found.map(|field| String::from_utf8_lossy(field.value).trim().to_owned())
    };
    let upgrades = field("upgrade").is_some_and(|value| value.eq_ignore_ascii_case("websocket"));
    let accepts = field("sec-websocket-accept") == Some(derive_accept_key(key.as_bytes()));
    let extends = field("sec-websocket-extensions").is_some();
    if !upgrades || !accepts || extends {
        return Err(refused("the HTTP server there agrees to another upgrade than was asked".into()));
    }
    Ok(Some(length))
}

/// What a server says beside its refusal, as far as it came with it: one line of it, without what would upset
/// a terminal.
fn words_of(body: &[u8]) -> String {
    let text = String::from_utf8_lossy(body);
    let line = text.lines().next().unwrap_or_default();
    let shown: String = line
        .chars()
        .filter(|character| !character.is_control())
        .take(WORDS_SHOWN_MAX)
        .collect();
    if shown.trim().is_empty() { String::new() } else { format!(": {}", shown.trim()) }
}

/// What an error of the layer is to a user of the stream.
fn stream_error(error: Error) -> io::Error {
    match error {
        Error::Io(error) => error,
        Error::WriteBufferFull(_) => ErrorKind::WouldBlock.into(),
        Error::ConnectionClosed | Error::AlreadyClosed => ErrorKind::BrokenPipe.into(),
        other => io::Error::new(ErrorKind::BrokenPipe, other.to_string()),
    }
}

impl Stream for WebSocketStream {
    fn connected(&mut self) -> io::Result<bool> {
        match &mut self.state {
            State::Asking { below, .. } => below.stream.connected(),
            State::Open { .. } => Ok(true),
            State::Over => Err(ErrorKind::NotConnected.into()),
        }
    }

    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        if matches!(self.state, State::Asking { .. }) {
            self.hear_answer()?;
        }
        let is_read = matches!(&self.state, State::Open { message, .. } if message.is_empty());
        if is_read {
            let next = self.next_message()?;
            let (State::Open { message, .. }, Some(next)) = (&mut self.state, next) else { return Ok(0) };
            *message = next;
        }
        let State::Open { message, .. } = &mut self.state else { return Ok(0) };
        if message.is_empty() {
            // A message without a byte is no end.
            return Err(ErrorKind::Interrupted.into());
        }
        let count = into.len().min(message.len());
        message.copy_to_slice(&mut into[..count]);
        if message.is_empty() {
            // An idle connection keeps nothing of the last message.
            *message = Bytes::new();
        }
        Ok(count)
    }

    fn write_vectored(&mut self, parts: &[IoSlice<'_>]) -> io::Result<usize> {
        // One message at a time waits below: what a drop policy may still reach stays with the core.
        self.flush()?;
        let State::Open { socket, .. } = &mut self.state else { return Err(ErrorKind::WouldBlock.into()) };
        let length = parts.iter().map(|part| part.len()).sum::<usize>().min(SENT_BYTES_MAX);
        let mut message = BytesMut::with_capacity(length);
        for part in parts {
            let left = length - message.len();
            message.extend_from_slice(&part[..part.len().min(left)]);
        }
        match socket.write(Message::Binary(message.freeze())).map_err(stream_error) {
            Ok(()) => Ok(length),
            // It was taken and goes out with the next flush.
            Err(error) if error.kind() == ErrorKind::WouldBlock && !is_planted(Bug::WebSentTwice) => {
                Ok(length)
            }
            Err(error) => Err(error),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.state {
            State::Asking { below, .. } => below.flush(),
            State::Open { socket, .. } => socket.flush().map_err(stream_error),
            State::Over => Ok(()),
        }
    }

    fn shutdown_write(&mut self) -> io::Result<()> {
        match &mut self.state {
            State::Asking { below, .. } => below.stream.shutdown_write(),
            State::Open { socket, .. } => {
                // A peer that takes nothing sees the end of the stream instead.
                let _ = socket.close(None);
                socket.get_mut().stream.shutdown_write()
            }
            State::Over => Ok(()),
        }
    }

    fn peer(&self) -> Option<Endpoint> {
        self.stream()?.peer()
    }

    fn peer_uid(&self) -> Option<u32> {
        None
    }

    fn channel_binding(&self) -> Option<[u8; 32]> {
        self.stream()?.channel_binding()
    }
}
