//! What must hold for every input of the two readers of variants. The fuzz targets and the test over
//! the committed seeds include this file.
#![allow(dead_code, reason = "each fuzz target uses one of the two")]

use bytes::Bytes;
use sk_flat::SkVariant;

/// A text is refused, or it gives a value that survives every form it can be written in.
pub fn text(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let Ok(value) = SkVariant::from_json(text) else { return };
    if let Ok(exact) = value.to_json_exact() {
        assert_eq!(SkVariant::from_json(&exact).as_ref(), Ok(&value), "by {exact}");
    }
    if let Ok(plain) = value.to_json() {
        let once = SkVariant::from_json(&plain).expect("what is written can be read");
        let again = once.to_json().expect("what was read can be written");
        assert_eq!(SkVariant::from_json(&again), Ok(once), "a second time changes nothing");
    }
    through_bytes(&value);
    assert!(!value.to_string().chars().any(char::is_control), "what is shown is one line");
}

/// Bytes are refused, or they are the one form of the value they give.
pub fn binary(data: &[u8]) {
    let Ok(value) = SkVariant::decode(data) else { return };
    assert_eq!(value.encode().as_deref(), Ok(data), "{value:?} has another form");
    through_bytes(&value);
    if let Ok(exact) = value.to_json_exact()
        && exact.len() <= 1024 * 1024
    {
        assert_eq!(SkVariant::from_json(&exact).as_ref(), Ok(&value), "by {exact}");
    }
}

fn through_bytes(value: &SkVariant) {
    let form = value.encode().expect("a value that was read is within the limits");
    assert_eq!(value.encoded_len(), Ok(form.len()));
    assert_eq!(SkVariant::decode(&form).as_ref(), Ok(value));
    assert_eq!(SkVariant::decode_from(&Bytes::from(form)).as_ref(), Ok(value));
}
