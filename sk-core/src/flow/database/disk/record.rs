//! The bytes of what is kept: every record begins with a check number over itself and its place, so that a
//! record that was turned into another, or stands in another's place, is found.

use crate::flow::Value;
use crate::flow::database::Saved;
use bytes::{Buf, BufMut};

/// The bytes of the check number.
const CHECK_BYTES: usize = 4;

fn check(place: &[&str], body: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    for part in place {
        hasher.update(&(part.len() as u32).to_le_bytes());
        hasher.update(part.as_bytes());
    }
    hasher.update(body);
    hasher.finalize()
}

fn seal(place: &[&str], body: &[u8]) -> Vec<u8> {
    let mut record = Vec::with_capacity(CHECK_BYTES + body.len());
    record.put_u32_le(check(place, body));
    record.put_slice(body);
    record
}

fn unseal<'a>(place: &[&str], mut record: &'a [u8]) -> Option<&'a [u8]> {
    let found = record.try_get_u32_le().ok()?;
    (found == check(place, record)).then_some(record)
}

/// A variable.
pub(super) fn variable(database: &str, key: &str, value: &Value) -> Vec<u8> {
    seal(&[database, key], value.encoded())
}

/// The value of a variable; none if the record is damaged.
pub(super) fn read_variable(database: &str, key: &str, record: &[u8]) -> Option<Value> {
    Value::from_encoded(unseal(&[database, key], record)?).ok()
}

/// What is to be known of a database.
pub(super) fn about(database: &str, about: &Saved) -> Vec<u8> {
    let mut body = Vec::new();
    body.put_u8(about.durable.into());
    body.put_u64_le(about.keys as u64);
    body.put_u64_le(about.bytes as u64);
    body.put_slice(about.account.as_bytes());
    seal(&[database], &body)
}

/// The same, read back; none if the record is damaged.
pub(super) fn read_about(database: &str, record: &[u8]) -> Option<Saved> {
    let mut body = unseal(&[database], record)?;
    let durable = body.try_get_u8().ok()? != 0;
    let keys = usize::try_from(body.try_get_u64_le().ok()?).ok()?;
    let bytes = usize::try_from(body.try_get_u64_le().ok()?).ok()?;
    let account = std::str::from_utf8(body).ok()?.into();
    Some(Saved { account, durable, keys, bytes })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_good_in_its_own_place_only_and_no_bit_may_turn() {
        let value = Value::new(&1.5.into()).expect("small");
        let record = variable("arm", "gain.p", &value);
        assert_eq!(read_variable("arm", "gain.p", &record), Some(value));
        assert_eq!(read_variable("arm", "gain.i", &record), None);
        assert_eq!(read_variable("arms", "gain.p", &record), None);
        let saved = Saved { account: "robot".into(), durable: true, keys: 3, bytes: 99 };
        let about = about("arm", &saved);
        assert_eq!(read_about("arm", &about), Some(saved));
        for (record, is_variable) in [(record, true), (about, false)] {
            for bit in 0..record.len() * 8 {
                let mut turned = record.clone();
                turned[bit / 8] ^= 1 << (bit % 8);
                let found = match is_variable {
                    true => read_variable("arm", "gain.p", &turned).is_none(),
                    false => read_about("arm", &turned).is_none(),
                };
                assert!(found, "bit {bit}");
            }
        }
    }
}
