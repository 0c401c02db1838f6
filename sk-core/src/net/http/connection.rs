//! One HTTP connection without its socket: bytes in, requests out, answers to be written, deadlines.

use super::answer::Answer;
use super::request::{HEAD_BYTES_MAX, Method, Request, RequestError};
use bytes::{Buf, Bytes, BytesMut};
use sk_flat::Instant;
use std::collections::VecDeque;
use std::io::IoSlice;
use std::time::Duration;

/// From the opening, or the first byte of a later request, to the end of its head.
const HEAD_TIME_MAX: Duration = Duration::from_secs(2);
/// How long a connection may stay open between two requests.
const IDLE_TIME_MAX: Duration = Duration::from_secs(10);
/// How long a client may take nothing of an answer.
const ANSWER_TIME_MAX: Duration = Duration::from_secs(10);
/// How long a connection whose last answer is written waits for the client to close it.
const LINGER_TIME_MAX: Duration = Duration::from_secs(1);

/// How far a connection is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// It waits for a request, or reads one.
    Asking,
    /// The answer under way is the last.
    LastAnswer,
    /// The last answer is written. What still comes is dropped unread: closing at once would reset the
    /// connection, and the client might never see the answer.
    Lingering,
}

#[derive(Debug)]
pub(super) struct Connection {
    phase: Phase,
    input: BytesMut,
    output: VecDeque<Bytes>,
    /// When the request under way began, or the connection.
    begun: Instant,
    /// When something was last written or a request was answered.
    moved: Instant,
    answered: bool,
}

impl Connection {
    pub(super) fn new(now: Instant) -> Connection {
        Connection {
            phase: Phase::Asking,
            input: BytesMut::new(),
            output: VecDeque::new(),
            begun: now,
            moved: now,
            answered: false,
        }
    }

    /// How many bytes may be read now; 0 while an answer waits, which makes a client that only asks wait too.
    pub(super) fn room(&self) -> usize {
        match self.phase {
            Phase::Lingering => HEAD_BYTES_MAX,
            _ if !self.output.is_empty() => 0,
            _ => HEAD_BYTES_MAX.saturating_sub(self.input.len()),
        }
    }

    pub(super) fn receive(&mut self, bytes: &[u8], now: Instant) {
        if self.phase == Phase::Lingering {
            return;
        }
        if self.input.is_empty() && self.answered {
            self.begun = now;
        }
        self.input.extend_from_slice(bytes);
    }

    /// The next request, once the answer before it was written.
    pub(super) fn next(&mut self) -> Result<Option<Request>, RequestError> {
        if self.phase != Phase::Asking || !self.output.is_empty() {
            return Ok(None);
        }
        let Some((request, length)) = Request::read(&self.input)? else { return Ok(None) };
        self.input.advance(length);
        Ok(Some(request))
    }

    pub(super) fn answer(&mut self, answer: &Answer, method: &Method, keep_alive: bool, now: Instant) {
        let (head, body) = answer.encode(method, keep_alive);
        self.output.extend([head, body].into_iter().filter(|part| !part.is_empty()));
        self.answered = true;
        self.moved = now;
        // A request that came with the one before has the whole of its time still before it.
        self.begun = now;
        if !keep_alive {
            self.phase = Phase::LastAnswer;
        }
    }

    /// What is to be written.
    pub(super) fn slices(&self) -> Vec<IoSlice<'_>> {
        self.output.iter().map(|part| IoSlice::new(part)).collect()
    }

    /// Whether no further request will be taken.
    pub(super) fn is_last(&self) -> bool {
        self.phase != Phase::Asking
    }

    pub(super) fn has_output(&self) -> bool {
        !self.output.is_empty()
    }

    pub(super) fn wrote(&mut self, mut count: usize, now: Instant) {
        self.moved = now;
        while let Some(first) = self.output.front_mut() {
            if count < first.len() {
                first.advance(count);
                return;
            }
            count -= first.len();
            self.output.pop_front();
        }
    }

    /// Whether the last answer is out and the writing side is to be closed; true once.
    pub(super) fn ends_writing(&mut self) -> bool {
        let ends = self.phase == Phase::LastAnswer && self.output.is_empty();
        if ends {
            self.phase = Phase::Lingering;
            self.input = BytesMut::new();
        }
        ends
    }

    /// What came after the request that was taken last, and when that request began.
    pub(super) fn into_rest(self) -> (Vec<u8>, Instant) {
        (self.input.to_vec(), self.begun)
    }

    /// When it last showed life; the one that has been quiet for longest makes room for others.
    pub(super) fn quiet_since(&self) -> Instant {
        self.begun.max(self.moved)
    }

    /// What is to be done because of the time.
    pub(super) fn check(&self, now: Instant) -> Overdue {
        let since_move = now.since(self.moved);
        match self.phase {
            Phase::Lingering if since_move >= LINGER_TIME_MAX => Overdue::Drop,
            Phase::Lingering => Overdue::No,
            _ if self.has_output() && since_move >= ANSWER_TIME_MAX => Overdue::Drop,
            _ if self.has_output() => Overdue::No,
            _ if self.answered && self.input.is_empty() && since_move >= IDLE_TIME_MAX => Overdue::Drop,
            _ if self.answered && self.input.is_empty() => Overdue::No,
            _ if now.since(self.begun) >= HEAD_TIME_MAX => Overdue::Say,
            _ => Overdue::No,
        }
    }
}

/// What the time demands of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Overdue {
    No,
    /// It is told that its request did not come, and ended.
    Say,
    Drop,
}

#[cfg(test)]
mod tests {
    use super::*;

    const ASK: &[u8] = b"GET / HTTP/1.1\r\nHost: a\r\n\r\n";

    fn at(ms: u64) -> Instant {
        Instant::ZERO + Duration::from_millis(ms)
    }

    #[test]
    fn requests_sent_in_one_go_are_answered_one_after_another() {
        let mut connection = Connection::new(at(0));
        connection.receive(&[ASK, ASK].concat(), at(0));
        let request = connection.next().expect("good").expect("whole");
        connection.answer(&Answer::words(200, "one"), request.method(), true, at(1));
        assert_eq!((connection.next(), connection.room()), (Ok(None), 0), "the answer comes first");
        let length = connection.slices().iter().map(|part| part.len()).sum();
        connection.wrote(length, at(2));
        assert!(connection.next().expect("good").is_some());
        assert!(!connection.ends_writing());
    }

    #[test]
    fn a_head_that_drips_and_a_client_that_stays_are_ended() {
        let mut connection = Connection::new(at(0));
        connection.receive(b"GET", at(1900));
        assert_eq!((connection.check(at(1999)), connection.check(at(2000))), (Overdue::No, Overdue::Say));
        let mut connection = Connection::new(at(0));
        connection.receive(ASK, at(0));
        let request = connection.next().expect("good").expect("whole");
        connection.answer(&Answer::words(200, "one"), request.method(), true, at(0));
        assert_eq!((connection.check(at(9_999)), connection.check(at(10_000))), (Overdue::No, Overdue::Drop));
        connection.wrote(usize::MAX, at(5_000));
        assert_eq!(
            (connection.check(at(14_999)), connection.check(at(15_000))),
            (Overdue::No, Overdue::Drop)
        );
        connection.receive(b"G", at(14_000));
        assert_eq!((connection.check(at(15_999)), connection.check(at(16_000))), (Overdue::No, Overdue::Say));
    }

    #[test]
    fn after_the_last_answer_nothing_is_kept_and_the_end_comes_soon() {
        let mut connection = Connection::new(at(0));
        connection.receive(b"nonsense", at(0));
        assert!(connection.next().is_err());
        connection.answer(&Answer::words(400, "no"), &Method::Get, false, at(0));
        assert!(!connection.ends_writing());
        connection.wrote(usize::MAX, at(0));
        assert!(connection.ends_writing() && !connection.ends_writing());
        connection.receive(ASK, at(1));
        assert_eq!(connection.next(), Ok(None));
        assert_eq!((connection.check(at(999)), connection.check(at(1000))), (Overdue::No, Overdue::Drop));
    }
}
