//! Variant to bytes: one pass checks the limits and measures, a second one writes.

use crate::error::VariantError;
use crate::variant::limits::Budget;
use crate::variant::{Limits, SkVariant};

impl SkVariant {
    /// The binary form.
    ///
    /// # Errors
    /// [`VariantError::Limit`] if the value is so deep, so large or of so many parts that no
    /// decoder would take it.
    ///
    /// ```
    /// use sk_flat::SkVariant;
    ///
    /// let value = SkVariant::list([1u8, 2]);
    /// assert_eq!(value.encode()?, [14, 2, 0, 0, 0, 6, 1, 6, 2]);
    /// # Ok::<(), sk_flat::VariantError>(())
    /// ```
    pub fn encode(&self) -> Result<Vec<u8>, VariantError> {
        let mut out = Vec::new();
        self.encode_into(&mut out)?;
        Ok(out)
    }

    /// Appends the binary form.
    ///
    /// # Errors
    /// As [`encode`](SkVariant::encode); nothing is appended then.
    pub fn encode_into(&self, out: &mut Vec<u8>) -> Result<(), VariantError> {
        out.reserve(self.encoded_len()?);
        write(self, out);
        Ok(())
    }

    /// How many bytes the binary form has.
    ///
    /// # Errors
    /// As [`encode`](SkVariant::encode).
    pub fn encoded_len(&self) -> Result<usize, VariantError> {
        let budget = Budget::new(Limits::BINARY);
        budget.take_nodes(1)?;
        let mut len = 0;
        measure(self, &budget, 0, &mut len)?;
        Ok(len)
    }
}

fn measure(value: &SkVariant, budget: &Budget, depth: usize, len: &mut usize) -> Result<(), VariantError> {
    *len += match value {
        SkVariant::Null => 1,
        SkVariant::Bool(_) | SkVariant::I8(_) | SkVariant::U8(_) => 2,
        SkVariant::I16(_) | SkVariant::U16(_) => 3,
        SkVariant::I32(_) | SkVariant::U32(_) | SkVariant::F32(_) => 5,
        SkVariant::I64(_) | SkVariant::U64(_) | SkVariant::F64(_) => 9,
        SkVariant::String(text) => 5 + text.len(),
        SkVariant::Bytes(bytes) => 5 + bytes.len(),
        SkVariant::List(_) | SkVariant::Map(_) => 5,
    };
    // Checked at every value, so that the sum cannot overflow and a large tree is left early.
    Limits::BINARY.check_bytes(*len)?;
    match value {
        SkVariant::List(list) => {
            let inside = budget.enter(depth)?;
            budget.take_nodes(list.len())?;
            for item in list.iter() {
                measure(item, budget, inside, len)?;
            }
        }
        SkVariant::Map(map) => {
            let inside = budget.enter(depth)?;
            budget.take_nodes(map.len())?;
            for (key, item) in map.iter() {
                *len += 4 + key.len();
                measure(item, budget, inside, len)?;
            }
        }
        _ => {}
    }
    Ok(())
}

/// Writes a value that was measured, so depth and lengths are within their limits.
fn write(value: &SkVariant, out: &mut Vec<u8>) {
    out.push(value.kind() as u8);
    match value {
        SkVariant::Null => {}
        SkVariant::Bool(truth) => out.push(u8::from(*truth)),
        SkVariant::I8(n) => out.extend_from_slice(&n.to_le_bytes()),
        SkVariant::I16(n) => out.extend_from_slice(&n.to_le_bytes()),
        SkVariant::I32(n) => out.extend_from_slice(&n.to_le_bytes()),
        SkVariant::I64(n) => out.extend_from_slice(&n.to_le_bytes()),
        SkVariant::U8(n) => out.push(*n),
        SkVariant::U16(n) => out.extend_from_slice(&n.to_le_bytes()),
        SkVariant::U32(n) => out.extend_from_slice(&n.to_le_bytes()),
        SkVariant::U64(n) => out.extend_from_slice(&n.to_le_bytes()),
        SkVariant::F32(x) => out.extend_from_slice(&x.to_le_bytes()),
        SkVariant::F64(x) => out.extend_from_slice(&x.to_le_bytes()),
        SkVariant::String(text) => write_run(text.as_bytes(), out),
        SkVariant::Bytes(bytes) => write_run(bytes, out),
        SkVariant::List(list) => {
            write_len(list.len(), out);
            for item in list.iter() {
                write(item, out);
            }
        }
        SkVariant::Map(map) => {
            write_len(map.len(), out);
            for (key, item) in map.iter() {
                write_run(key.as_bytes(), out);
                write(item, out);
            }
        }
    }
}

fn write_run(bytes: &[u8], out: &mut Vec<u8>) {
    write_len(bytes.len(), out);
    out.extend_from_slice(bytes);
}

fn write_len(len: usize, out: &mut Vec<u8>) {
    debug_assert!(len <= super::super::VARIANT_BYTES_MAX, "measured before");
    out.extend_from_slice(&(len as u32).to_le_bytes());
}
