//! What publishing over UDP looks like on the wire: a session, a counter, a frame and a proof.
//!
//! A datagram shows by its proof that it is the publisher's and whole; by its counter that it is new. It is not
//! hidden from others. The key is handed out over a connection that has logged in, and serves one session.

use crate::testing::{Bug, is_planted};
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;
use std::fmt;
use subtle::ConstantTimeEq;
use thiserror::Error;

/// The longest datagram: it passes every link of today's Internet in one piece.
pub const DATAGRAM_BYTES_MAX: usize = 1_200;
/// Session and counter, both `u64` in little-endian order.
const HEAD_BYTES: usize = 16;
/// The first half of an HMAC-SHA-256.
const PROOF_BYTES: usize = 16;
/// The longest frame in a datagram.
pub const DATAGRAM_FRAME_BYTES_MAX: usize = DATAGRAM_BYTES_MAX - HEAD_BYTES - PROOF_BYTES;
/// How far behind the newest a datagram may come and still be taken.
pub const REPLAY_WINDOW: u64 = 1_024;
/// What begins the input of the proof.
const LABEL: &[u8] = b"SpecialK flow 1 datagram";

/// The secret of one session.
#[derive(Clone)]
pub struct DatagramKey([u8; 32]);

impl DatagramKey {
    /// A key of these bytes, which come from the hub's `Rng`.
    pub const fn new(secret: [u8; 32]) -> DatagramKey {
        DatagramKey(secret)
    }

    fn prove(&self, head_and_frame: &[u8]) -> [u8; PROOF_BYTES] {
        // Filled up with zeros to one block of SHA-256, as HMAC does itself: so the constructor cannot fail.
        let mut block = hmac::digest::Key::<Hmac<Sha256>>::default();
        block[..32].copy_from_slice(&self.0);
        let mut mac = Hmac::<Sha256>::new(&block);
        mac.update(LABEL);
        mac.update(head_and_frame);
        let whole: [u8; 32] = mac.finalize().into_bytes().into();
        std::array::from_fn(|index| whole[index])
    }
}

impl Drop for DatagramKey {
    /// Overwrites the secret. The black box keeps the compiler from leaving the writes out.
    fn drop(&mut self) {
        self.0 = [0; 32];
        std::hint::black_box(&mut self.0);
    }
}

impl fmt::Debug for DatagramKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("DatagramKey(secret)")
    }
}

/// Why a datagram was not made or not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum DatagramError {
    /// It has another length than a datagram can have.
    #[error("{0} bytes cannot be a datagram of a session: expected more than 32 and at most 1,200")]
    Length(usize),
    /// It belongs to another session.
    #[error("it is for session {0}")]
    Session(u64),
    /// Its proof is wrong: it was changed on the way, or somebody else made it.
    #[error("its proof is wrong")]
    Forged,
    /// It came before, or so late that nobody can tell.
    #[error("counter {0} came before, or is too old")]
    Replayed(u64),
    /// All counters of the session are used up.
    #[error("the session has no counters left")]
    UsedUp,
}

/// The publisher's side of a session.
///
/// ```
/// use sk_core::flow::transport::datagram::{DatagramError, DatagramKey, DatagramReader, DatagramWriter};
///
/// let key = DatagramKey::new([7; 32]);
/// let mut writer = DatagramWriter::new(5, key.clone());
/// let mut reader = DatagramReader::new(5, key);
/// let datagram = writer.seal(b"a frame")?;
/// assert_eq!(reader.open(&datagram)?, b"a frame");
/// assert_eq!(reader.open(&datagram), Err(DatagramError::Replayed(1)));
/// # Ok::<(), DatagramError>(())
/// ```
#[derive(Debug)]
pub struct DatagramWriter {
    session: u64,
    key: DatagramKey,
    counter: u64,
}

impl DatagramWriter {
    /// The beginning of a session; each has a key of its own.
    pub fn new(session: u64, key: DatagramKey) -> DatagramWriter {
        DatagramWriter { session, key, counter: 0 }
    }

    /// The datagram of a frame.
    ///
    /// # Errors
    /// If the frame is empty or too long, or the session was used for 2^64 datagrams.
    pub fn seal(&mut self, frame: &[u8]) -> Result<Vec<u8>, DatagramError> {
        if frame.is_empty() || frame.len() > DATAGRAM_FRAME_BYTES_MAX {
            return Err(DatagramError::Length(frame.len() + HEAD_BYTES + PROOF_BYTES));
        }
        self.counter = self.counter.checked_add(1).ok_or(DatagramError::UsedUp)?;
        let mut datagram = Vec::with_capacity(HEAD_BYTES + frame.len() + PROOF_BYTES);
        datagram.extend(self.session.to_le_bytes());
        datagram.extend(self.counter.to_le_bytes());
        datagram.extend_from_slice(frame);
        let proof = self.key.prove(&datagram);
        datagram.extend(proof);
        Ok(datagram)
    }
}

/// The session that a datagram claims to belong to, to find its reader. Nothing else of it is looked at.
pub fn session_of(datagram: &[u8]) -> Option<u64> {
    let is_possible = (HEAD_BYTES + PROOF_BYTES + 1..=DATAGRAM_BYTES_MAX).contains(&datagram.len());
    datagram
        .first_chunk()
        .filter(|_| is_possible)
        .map(|bytes| u64::from_le_bytes(*bytes))
}

/// The hub's side of a session.
#[derive(Debug)]
pub struct DatagramReader {
    session: u64,
    key: DatagramKey,
    window: ReplayWindow,
}

impl DatagramReader {
    /// The beginning of a session.
    pub fn new(session: u64, key: DatagramKey) -> DatagramReader {
        DatagramReader { session, key, window: ReplayWindow::default() }
    }

    /// The frame in a datagram, if it is this session's, whole and new.
    ///
    /// # Errors
    /// What it is instead. Nothing that is not proven changes anything here.
    pub fn open<'a>(&mut self, datagram: &'a [u8]) -> Result<&'a [u8], DatagramError> {
        self.open_counted(datagram).map(|(_, frame)| frame)
    }

    /// The same with the counter, that tells the order in which datagrams were made.
    ///
    /// # Errors
    /// As [`open`](DatagramReader::open).
    pub fn open_counted<'a>(&mut self, datagram: &'a [u8]) -> Result<(u64, &'a [u8]), DatagramError> {
        let session = session_of(datagram).ok_or(DatagramError::Length(datagram.len()))?;
        if session != self.session {
            return Err(DatagramError::Session(session));
        }
        let length = DatagramError::Length(datagram.len());
        let (proven, proof) = datagram.split_last_chunk::<PROOF_BYTES>().ok_or(length)?;
        if !bool::from(self.key.prove(proven).ct_eq(proof)) {
            return Err(DatagramError::Forged);
        }
        let (head, frame) = proven.split_first_chunk::<HEAD_BYTES>().ok_or(length)?;
        let [_, _, _, _, _, _, _, _, counter @ ..] = *head;
        let counter = u64::from_le_bytes(counter);
        if self.window.take(counter) || is_planted(Bug::ReplayTaken) {
            Ok((counter, frame))
        } else {
            Err(DatagramError::Replayed(counter))
        }
    }
}

/// Which of the newest counters have come.
#[derive(Debug)]
struct ReplayWindow {
    /// The newest that has come; 0 before the first, and never itself one.
    newest: u64,
    /// One bit for each counter of the window, at its place modulo the window's length.
    seen: [u64; (REPLAY_WINDOW / 64) as usize],
}

impl Default for ReplayWindow {
    fn default() -> ReplayWindow {
        ReplayWindow { newest: 0, seen: [0; (REPLAY_WINDOW / 64) as usize] }
    }
}

impl ReplayWindow {
    /// Whether a counter is new; it is not any more then.
    fn take(&mut self, counter: u64) -> bool {
        if counter == 0 || self.newest.saturating_sub(counter) >= REPLAY_WINDOW {
            return false;
        }
        if counter > self.newest {
            let passed = counter - self.newest;
            if passed >= REPLAY_WINDOW {
                self.seen = [0; (REPLAY_WINDOW / 64) as usize];
            } else {
                (self.newest + 1..=counter).for_each(|new| *self.word(new) &= !bit(new));
            }
            self.newest = counter;
        }
        let word = self.word(counter);
        let is_new = *word & bit(counter) == 0;
        *word |= bit(counter);
        is_new
    }

    fn word(&mut self, counter: u64) -> &mut u64 {
        &mut self.seen[(counter % REPLAY_WINDOW / 64) as usize]
    }
}

fn bit(counter: u64) -> u64 {
    1 << (counter % 64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    fn pair() -> (DatagramWriter, DatagramReader) {
        let key = DatagramKey::new(std::array::from_fn(|index| index as u8));
        (DatagramWriter::new(9, key.clone()), DatagramReader::new(9, key))
    }

    #[test]
    fn the_bytes_are_as_another_implementation_computes_them() {
        // Python: d = struct.pack("<QQ", 9, 1) + b"pulse"
        //         d + hmac.new(bytes(range(32)), b"SpecialK flow 1 datagram" + d, "sha256").digest()[:16]
        let (mut writer, _) = pair();
        let hex: String = writer
            .seal(b"pulse")
            .expect("short")
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect();
        assert_eq!(hex, "0900000000000000010000000000000070756c7365f615f7bccd01a81282fbf82725a94bb0");
    }

    #[test]
    fn t24_every_flipped_bit_and_every_cut_is_found_and_changes_nothing() {
        let (mut writer, mut reader) = pair();
        let good = writer.seal(&[3; 40]).expect("short");
        for bit in 0..good.len() * 8 {
            let mut bytes = good.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(reader.open(&bytes).is_err(), "bit {bit}");
        }
        for length in 0..good.len() {
            assert!(reader.open(&good[..length]).is_err(), "{length} bytes");
        }
        assert_eq!(reader.open(&good), Ok(&[3; 40][..]));
    }

    #[test]
    fn another_sessions_datagram_and_another_key_are_refused() {
        let (mut writer, mut reader) = pair();
        let other = DatagramWriter::new(8, writer.key.clone()).seal(b"x").expect("short");
        assert_eq!(reader.open(&other), Err(DatagramError::Session(8)));
        let forged = DatagramWriter::new(9, DatagramKey::new([1; 32])).seal(b"x").expect("short");
        assert_eq!(reader.open(&forged), Err(DatagramError::Forged));
        assert_eq!(writer.seal(b""), Err(DatagramError::Length(32)));
        assert_eq!(writer.seal(&[0; 1169]), Err(DatagramError::Length(1201)));
        assert_eq!(writer.seal(&[0; 1168]).map(|datagram| datagram.len()), Ok(DATAGRAM_BYTES_MAX));
        writer.counter = u64::MAX;
        assert_eq!(writer.seal(b"x"), Err(DatagramError::UsedUp));
    }

    #[test]
    fn the_window_is_as_wide_as_it_says() {
        let mut window = ReplayWindow::default();
        assert!(!window.take(0) && window.take(5000));
        assert!(window.take(5000 - 1023) && !window.take(5000 - 1024));
        assert!(window.take(u64::MAX) && window.take(u64::MAX - 1023) && !window.take(5001));
    }

    proptest! {
        #[test]
        fn each_counter_is_taken_once_and_the_late_are_refused(
            steps in prop::collection::vec((0_u64..3000, any::<bool>()), 0..400),
        ) {
            let (mut window, mut taken, mut newest) = (ReplayWindow::default(), BTreeSet::new(), 0_u64);
            for (step, back) in steps {
                let counter = if back { newest.saturating_sub(step) } else { newest + step % 70 };
                let expected = counter > 0 && counter + REPLAY_WINDOW > newest && !taken.contains(&counter);
                prop_assert_eq!(window.take(counter), expected, "{} after {}", counter, newest);
                if expected {
                    taken.insert(counter);
                    newest = newest.max(counter);
                }
            }
        }
    }
}
