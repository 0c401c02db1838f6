//! A serial line without its port: bytes and instants in, bytes and news out.
//!
//! One side calls, the other listens. A life of the line begins when the caller's number, the listener's and
//! the caller's confirmation have passed; each side's number is new for each life, so nothing of a former one is
//! taken for this one's. It ends when something was not acknowledged for three seconds, when a side begins anew,
//! or when one sends what none may. All streams end with it.

use super::envelope::{ENVELOPE_BYTES_MAX, Envelope, Kind, PAYLOAD_BYTES_MAX, STREAMS};
use super::slip::{SlipReader, slip_encode};
use super::stream::{Due, Stream};
use super::window::{Numbered, Turn, WINDOW, Window};
use sk_flat::Instant;
use std::time::Duration;

/// Without an acknowledgement for so long the line is down.
pub const DOWN_AFTER: Duration = Duration::from_secs(3);
/// How often a caller that is not answered calls.
const CALL_EVERY: Duration = Duration::from_millis(250);
/// What the peer and the kernel may take to answer, beside the time on the line.
const ANSWER_TIME: Duration = Duration::from_millis(200);
/// A byte on the line, with its start and stop bits.
const BITS_PER_BYTE: u64 = 10;
/// What is made ready ahead of the port: little, so that a repetition is not made before it is needed.
const READY_BYTES_MAX: usize = 2 * 1024;

/// Which side of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// It calls, and opens streams.
    Caller,
    /// It waits to be called.
    Listener,
}

/// Something that has happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineEvent {
    /// A life of the line began.
    Up,
    /// It ended, and all streams with it.
    Down,
    /// The caller opened a stream.
    Opened(u8),
    /// There may be something to read from a stream, its end included, or room to write.
    Ready(u8),
}

/// Why a stream cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StreamError {
    /// Nothing for now; [`LineEvent::Ready`] tells.
    #[error("not now")]
    NotNow,
    /// It has ended.
    #[error("the stream has ended")]
    Ended,
}

/// One use of a stream number; it means nothing in a later life of the line or to its next user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StreamId {
    /// Its number.
    pub number: u8,
    use_number: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Life {
    /// A caller that calls, next at this instant; a listener that has not been called.
    None {
        call_at: Instant,
    },
    /// A listener that has answered this caller.
    Answered {
        peer: u32,
    },
    Up {
        peer: u32,
    },
}

/// Numbers of what has not been reported.
#[derive(Debug, Default)]
struct News {
    up: bool,
    down: bool,
    opened: u16,
    ready: u16,
}

/// The state of one side.
#[derive(Debug)]
pub struct Line {
    role: Role,
    /// This side's number in this life.
    own: u32,
    numbers: u64,
    life: Life,
    window: Window,
    streams: [Stream; STREAMS as usize],
    uses: [u64; STREAMS as usize],
    /// The stream whose turn to send is next.
    turn: u8,
    reader: SlipReader,
    ready: Vec<u8>,
    /// How much of `ready` the port has taken.
    taken: usize,
    /// An answer that has no number and is owed to the peer.
    owed: Option<Kind>,
    in_flight_max: usize,
    payload_max: usize,
    repeat_after: Duration,
    news: News,
    damaged: u64,
    repeated: u64,
}

impl Line {
    /// A line that is down. `seed` is from the world's `Rng`; the speed in bits a second says how much may be
    /// under way and how long an answer may take.
    pub fn new(role: Role, seed: u64, baud: u32, now: Instant) -> Line {
        let bytes_per_second = (u64::from(baud) / BITS_PER_BYTE).max(1);
        // Half a second of line time may be under way, so that a repetition does not come too late to help.
        let half_second = usize::try_from(bytes_per_second / 2).unwrap_or(usize::MAX);
        let in_flight_max = half_second.clamp(128, WINDOW * PAYLOAD_BYTES_MAX);
        let there_and_back = Duration::from_nanos(2_000_000_000 * in_flight_max as u64 / bytes_per_second);
        let mut line = Line {
            role,
            own: 0,
            numbers: seed,
            life: Life::None { call_at: now },
            window: Window::new(now),
            streams: Default::default(),
            uses: [0; STREAMS as usize],
            turn: 0,
            reader: SlipReader::new(ENVELOPE_BYTES_MAX),
            ready: Vec::new(),
            taken: 0,
            owed: None,
            in_flight_max,
            payload_max: (in_flight_max / WINDOW).clamp(64, PAYLOAD_BYTES_MAX),
            repeat_after: ANSWER_TIME + there_and_back,
            news: News::default(),
            damaged: 0,
            repeated: 0,
        };
        line.own = line.new_number();
        line
    }

    /// Whether streams can be opened.
    pub fn is_up(&self) -> bool {
        matches!(self.life, Life::Up { .. })
    }

    /// How many packets came damaged.
    pub fn damaged(&self) -> u64 {
        self.damaged + self.reader.lost
    }

    /// How often sending went back to what was missing.
    pub fn repeated(&self) -> u64 {
        self.repeated
    }

    // ---- streams ----

    /// A new stream to the listener; `None` while the line is down or all numbers are in use.
    pub fn open(&mut self) -> Option<StreamId> {
        if !self.is_up() || self.role == Role::Listener {
            return None;
        }
        let number = self.streams.iter().position(Stream::is_free)?;
        self.streams[number] = Stream::begin(true);
        Some(self.use_of(number))
    }

    /// The stream that [`LineEvent::Opened`] named.
    pub fn opened(&self, number: u8) -> Option<StreamId> {
        let index = usize::from(number);
        self.streams.get(index).filter(|stream| !stream.is_free())?;
        Some(StreamId { number, use_number: self.uses[index] })
    }

    /// Takes bytes to send; answers how many.
    ///
    /// # Errors
    /// `NotNow` when there is no room, `Ended` when either side has closed the stream or the line went down.
    pub fn write(&mut self, id: StreamId, bytes: &[u8]) -> Result<usize, StreamError> {
        let stream = self
            .stream(id)
            .filter(|stream| !stream.closed_there)
            .ok_or(StreamError::Ended)?;
        match stream.write(bytes) {
            0 if !bytes.is_empty() => Err(StreamError::NotNow),
            count => Ok(count),
        }
    }

    /// Hands out bytes that have come; answers how many, which is more than none.
    ///
    /// # Errors
    /// As [`write`](Line::write).
    pub fn read(&mut self, id: StreamId, into: &mut [u8]) -> Result<usize, StreamError> {
        let stream = self.stream(id).ok_or(StreamError::Ended)?;
        match stream.read(into) {
            0 if stream.closed_there => Err(StreamError::Ended),
            0 => Err(StreamError::NotNow),
            count => Ok(count),
        }
    }

    /// Ends a stream; what was written still goes out.
    pub fn close(&mut self, id: StreamId) {
        if let Some(stream) = self.stream(id) {
            stream.close();
            // It means nothing to its former user any more.
            self.uses[usize::from(id.number)] += 1;
        }
    }

    fn stream(&mut self, id: StreamId) -> Option<&mut Stream> {
        let index = usize::from(id.number);
        (self.uses.get(index) == Some(&id.use_number)).then(|| &mut self.streams[index])
    }

    fn use_of(&mut self, index: usize) -> StreamId {
        self.uses[index] += 1;
        StreamId { number: index as u8, use_number: self.uses[index] }
    }

    // ---- the port ----

    /// Takes what the port brought.
    pub fn receive(&mut self, bytes: &[u8], now: Instant) {
        for byte in bytes {
            let Some(packet) = self.reader.push(*byte) else { continue };
            // The reader keeps the packet only until the next byte; envelopes are short.
            let packet = packet.to_vec();
            match Envelope::decode(&packet) {
                Some(envelope) => self.take(&envelope, now),
                None => self.damaged += 1,
            }
        }
    }

    /// What the port is to write; nothing if there is nothing to say.
    pub fn output(&mut self, now: Instant) -> &[u8] {
        if self.taken == self.ready.len() {
            (self.ready, self.taken) = (Vec::new(), 0);
        }
        while self.ready.len() - self.taken < READY_BYTES_MAX && self.make_ready(now) {}
        &self.ready[self.taken..]
    }

    /// The port has written so much of it.
    pub fn wrote(&mut self, count: usize) {
        self.taken = (self.taken + count).min(self.ready.len());
    }

    /// When [`tick`](Line::tick) has something to do, if nothing comes before.
    pub fn next_deadline(&self) -> Option<Instant> {
        match self.life {
            Life::None { call_at } if self.role == Role::Caller => Some(call_at),
            Life::Up { .. } if !self.window.is_empty() => {
                Some((self.window.tried + self.repeat_after).min(self.window.moved + DOWN_AFTER))
            }
            _ => None,
        }
    }

    /// Looks at the time: calls, repeats, and gives the line up.
    pub fn tick(&mut self, now: Instant) {
        match &mut self.life {
            Life::None { call_at } if self.role == Role::Caller && now >= *call_at => {
                *call_at = now + CALL_EVERY;
                self.owed = Some(Kind::Hello);
            }
            Life::Up { .. } if self.window.is_empty() => {}
            Life::Up { .. } if now >= self.window.moved + DOWN_AFTER => self.end_life(now),
            Life::Up { .. } if now >= self.window.tried + self.repeat_after => {
                self.repeated += 1;
                self.window.go_back(now);
            }
            _ => {}
        }
    }

    /// The next thing that has happened.
    pub fn next_event(&mut self) -> Option<LineEvent> {
        let lowest = |bits: &mut u16| {
            let number = bits.trailing_zeros();
            *bits &= bits.wrapping_sub(1);
            number as u8
        };
        if std::mem::take(&mut self.news.down) {
            return Some(LineEvent::Down);
        }
        if std::mem::take(&mut self.news.up) {
            return Some(LineEvent::Up);
        }
        if self.news.opened != 0 {
            return Some(LineEvent::Opened(lowest(&mut self.news.opened)));
        }
        (self.news.ready != 0).then(|| LineEvent::Ready(lowest(&mut self.news.ready)))
    }

    /// The port is gone: whatever there was has ended.
    pub fn hang_up(&mut self, now: Instant) {
        self.end_life(now);
    }

    // ---- what comes ----

    fn take(&mut self, envelope: &Envelope<'_>, now: Instant) {
        match (envelope.kind, self.role) {
            (Kind::Hello, Role::Listener) => self.on_hello(envelope.payload, now),
            (Kind::Welcome, Role::Caller) => self.on_welcome(envelope.payload, now),
            (Kind::Confirm, Role::Listener) => self.on_confirm(envelope.payload, now),
            (Kind::Reset, Role::Caller) if self.is_up() => self.end_life(now),
            (Kind::Ack | Kind::Again, _) if self.is_up() => self.on_ack(envelope, now),
            (kind, _) if kind.is_numbered() => match (self.life, self.role) {
                (Life::Up { .. }, _) => self.on_numbered(envelope, now),
                // The caller believes in a life that this side knows nothing of, or has not heard confirmed.
                (Life::Answered { .. }, _) => self.owed = Some(Kind::Welcome),
                (Life::None { .. }, Role::Listener) => self.owed = Some(Kind::Reset),
                (Life::None { .. }, Role::Caller) => {}
            },
            _ => {}
        }
    }

    fn on_hello(&mut self, payload: &[u8], now: Instant) {
        let Some(caller) = number_at(payload, 0) else { return };
        match self.life {
            Life::Up { peer } | Life::Answered { peer } if peer == caller => {}
            Life::None { .. } | Life::Answered { .. } => self.life = Life::Answered { peer: caller },
            Life::Up { .. } => {
                self.end_life(now);
                self.life = Life::Answered { peer: caller };
            }
        }
        self.owed = Some(Kind::Welcome);
    }

    fn on_welcome(&mut self, payload: &[u8], now: Instant) {
        let (Some(listener), Some(own)) = (number_at(payload, 0), number_at(payload, 4)) else { return };
        if own != self.own {
            // Meant for a former number, unless the line is up: then the listener is in another life.
            if self.is_up() {
                self.end_life(now);
            }
            return;
        }
        match self.life {
            Life::Up { peer } if peer == listener => self.owed = Some(Kind::Confirm),
            // The listener has begun anew.
            Life::Up { .. } => self.end_life(now),
            _ => {
                self.begin_life(listener, now);
                self.owed = Some(Kind::Confirm);
            }
        }
    }

    fn on_confirm(&mut self, payload: &[u8], now: Instant) {
        let (caller, own) = (number_at(payload, 0), number_at(payload, 4));
        if let Life::Answered { peer } = self.life
            && (caller, own) == (Some(peer), Some(self.own))
        {
            self.begin_life(peer, now);
        }
    }

    fn on_ack(&mut self, envelope: &Envelope<'_>, now: Instant) {
        self.window.acknowledged(envelope.ack, now);
        if envelope.kind == Kind::Again && self.window.again(envelope.ack, now) {
            self.repeated += 1;
        }
    }

    fn on_numbered(&mut self, envelope: &Envelope<'_>, now: Instant) {
        self.window.acknowledged(envelope.ack, now);
        match self.window.arrived(envelope.number) {
            Turn::Next => {
                self.owed.get_or_insert(Kind::Ack);
                if !self.apply(envelope) {
                    // No honest peer sends it at any timing.
                    self.end_life(now);
                }
            }
            Turn::Old | Turn::Gap { new: false } => {
                self.owed.get_or_insert(Kind::Ack);
            }
            Turn::Gap { new: true } => self.owed = Some(Kind::Again),
        }
    }

    /// Does what a numbered envelope says; `false` if none may say that.
    fn apply(&mut self, envelope: &Envelope<'_>) -> bool {
        let index = usize::from(envelope.stream);
        let bit = 1 << envelope.stream;
        let stream = &mut self.streams[index];
        match envelope.kind {
            Kind::Open if self.role == Role::Listener && stream.is_free() => {
                *stream = Stream::begin(false);
                self.use_of(index);
                self.news.opened |= bit;
                return true;
            }
            Kind::Data if !stream.is_free() && !stream.closed_there => {
                if !stream.receive(envelope.payload) {
                    return false;
                }
            }
            Kind::Close if !stream.is_free() && !stream.closed_there => stream.close_there(),
            Kind::Credit if !stream.is_free() => {
                let Some(bytes) = number_at(envelope.payload, 0) else { return false };
                stream.add_credit(bytes);
                return true;
            }
            _ => return false,
        }
        self.news.ready |= bit;
        true
    }

    // ---- what goes ----

    /// Makes one more envelope ready for the port; `false` if there is none to make.
    fn make_ready(&mut self, now: Instant) -> bool {
        if !self.is_up() {
            return self.make_owed();
        }
        // A gap is told at once; an acknowledgement rides on whatever goes out anyway.
        if self.owed.is_some_and(|kind| kind != Kind::Ack) {
            return self.make_owed();
        }
        if !self.window.has_next() && self.window.has_room(self.in_flight_max) {
            self.number_next(now);
        }
        let ack = self.window.expected();
        match self.window.next() {
            Some((number, Numbered { kind, stream, payload })) => {
                let envelope = Envelope { kind: *kind, stream: *stream, number, ack, payload };
                slip_encode(&envelope.encode(), &mut self.ready);
                self.owed = None;
                true
            }
            None => self.make_owed(),
        }
    }

    fn make_owed(&mut self) -> bool {
        let Some(kind) = self.owed.take() else { return false };
        let peer = match self.life {
            Life::Up { peer } | Life::Answered { peer } => peer,
            Life::None { .. } => 0,
        };
        let mut payload = Vec::new();
        match kind {
            Kind::Hello => payload.extend(self.own.to_le_bytes()),
            Kind::Welcome | Kind::Confirm => {
                payload.extend(self.own.to_le_bytes());
                payload.extend(peer.to_le_bytes());
            }
            _ => {}
        }
        let envelope =
            Envelope { kind, stream: 0, number: 0, ack: self.window.expected(), payload: &payload };
        slip_encode(&envelope.encode(), &mut self.ready);
        true
    }

    /// Gives the next thing that a stream has to send its number; streams take turns.
    fn number_next(&mut self, now: Instant) {
        for offset in 0..STREAMS {
            let number = (self.turn + offset) % STREAMS;
            let stream = &mut self.streams[usize::from(number)];
            let Some(due) = stream.next(self.payload_max) else { continue };
            if stream.has_new_room() {
                self.news.ready |= 1 << number;
            }
            let (kind, payload) = match due {
                Due::Open => (Kind::Open, Vec::new()),
                Due::Close => (Kind::Close, Vec::new()),
                Due::Credit(bytes) => (Kind::Credit, bytes.to_le_bytes().to_vec()),
                Due::Data(bytes) => (Kind::Data, bytes),
            };
            self.window.push(Numbered { kind, stream: number, payload }, now);
            self.turn = (number + 1) % STREAMS;
            return;
        }
    }

    /// Whether something waits that [`output`](Line::output) would make ready.
    pub fn has_output(&self) -> bool {
        let sends = self.window.has_next()
            || self.window.has_room(self.in_flight_max) && self.streams.iter().any(Stream::has_next);
        self.taken < self.ready.len() || self.owed.is_some() || self.is_up() && sends
    }

    // ---- lives ----

    fn begin_life(&mut self, peer: u32, now: Instant) {
        self.life = Life::Up { peer };
        self.window = Window::new(now);
        self.news.up = true;
    }

    fn end_life(&mut self, now: Instant) {
        let was_up = self.is_up();
        self.life = Life::None { call_at: now };
        self.own = self.new_number();
        // A caller that has nothing to send would not find out for long.
        self.owed = (was_up && self.role == Role::Listener).then_some(Kind::Reset);
        self.window = Window::new(now);
        // Half an envelope must not be continued by another's beginning; the end mark before each sees to that.
        (self.ready, self.taken) = (Vec::new(), 0);
        self.news.opened = 0;
        for (index, stream) in self.streams.iter_mut().enumerate() {
            if !stream.is_free() {
                self.news.ready |= 1 << index;
                self.uses[index] += 1;
                *stream = Stream::default();
            }
        }
        self.news.down |= was_up;
        self.news.up &= !was_up;
    }

    /// A number of this side's that no earlier life had, never 0. SplitMix64 of a counter.
    fn new_number(&mut self) -> u32 {
        loop {
            self.numbers = self.numbers.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mixed = (self.numbers ^ (self.numbers >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            let number = ((mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB) >> 32) as u32;
            if number != 0 && number != self.own {
                return number;
            }
        }
    }
}

fn number_at(payload: &[u8], at: usize) -> Option<u32> {
    let bytes = payload.get(at..at + 4)?;
    Some(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
}
