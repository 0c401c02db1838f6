//! Bytes to variant. Everything announced is checked against what is there before it is believed.

use crate::error::VariantError;
use crate::variant::limits::Budget;
use crate::variant::{Kind, Limits, SkVariant};
use bytes::Bytes;
use std::collections::BTreeMap;
use std::sync::Arc;

impl SkVariant {
    /// Reads a binary form that fills the whole slice.
    ///
    /// # Errors
    /// Any other bytes than those [`encode`](SkVariant::encode) writes.
    ///
    /// ```
    /// use sk_flat::SkVariant;
    ///
    /// assert_eq!(SkVariant::decode(&[6, 42])?, SkVariant::U8(42));
    /// assert!(SkVariant::decode(&[1, 2]).is_err()); // a bool is 0 or 1
    /// # Ok::<(), sk_flat::VariantError>(())
    /// ```
    pub fn decode(form: &[u8]) -> Result<SkVariant, VariantError> {
        SkVariant::decode_with(form, &Limits::BINARY)
    }

    /// As [`decode`](SkVariant::decode), with limits of one's own.
    ///
    /// # Errors
    /// As [`decode`](SkVariant::decode).
    pub fn decode_with(form: &[u8], limits: &Limits) -> Result<SkVariant, VariantError> {
        decode(form, None, limits)
    }

    /// As [`decode`](SkVariant::decode), but `Bytes` inside share the memory of `form` instead of
    /// being copied. As long as one of them lives, so does all of `form`.
    ///
    /// # Errors
    /// As [`decode`](SkVariant::decode).
    pub fn decode_from(form: &Bytes) -> Result<SkVariant, VariantError> {
        SkVariant::decode_from_with(form, &Limits::BINARY)
    }

    /// As [`decode_from`](SkVariant::decode_from), with limits of one's own.
    ///
    /// # Errors
    /// As [`decode`](SkVariant::decode).
    pub fn decode_from_with(form: &Bytes, limits: &Limits) -> Result<SkVariant, VariantError> {
        decode(form, Some(form), limits)
    }
}

fn decode(form: &[u8], shared: Option<&Bytes>, limits: &Limits) -> Result<SkVariant, VariantError> {
    limits.check_bytes(form.len())?;
    let mut reader = Reader { form, at: 0, shared, budget: Budget::new(*limits) };
    reader.budget.take_nodes(1)?;
    let value = reader.value(0)?;
    if reader.at != form.len() {
        return Err(reader.malformed("bytes follow the value"));
    }
    Ok(value)
}

struct Reader<'a> {
    form: &'a [u8],
    at: usize,
    shared: Option<&'a Bytes>,
    budget: Budget,
}

impl<'a> Reader<'a> {
    fn value(&mut self, depth: usize) -> Result<SkVariant, VariantError> {
        let [kind] = self.array()?;
        let Some(kind) = Kind::ALL.get(usize::from(kind)) else {
            self.at -= 1;
            return Err(self.malformed("unknown kind"));
        };
        Ok(match kind {
            Kind::Null => SkVariant::Null,
            Kind::Bool => SkVariant::Bool(self.truth()?),
            Kind::I8 => SkVariant::I8(i8::from_le_bytes(self.array()?)),
            Kind::I16 => SkVariant::I16(i16::from_le_bytes(self.array()?)),
            Kind::I32 => SkVariant::I32(i32::from_le_bytes(self.array()?)),
            Kind::I64 => SkVariant::I64(i64::from_le_bytes(self.array()?)),
            Kind::U8 => SkVariant::U8(u8::from_le_bytes(self.array()?)),
            Kind::U16 => SkVariant::U16(u16::from_le_bytes(self.array()?)),
            Kind::U32 => SkVariant::U32(u32::from_le_bytes(self.array()?)),
            Kind::U64 => SkVariant::U64(u64::from_le_bytes(self.array()?)),
            Kind::F32 => SkVariant::F32(f32::from_le_bytes(self.array()?)),
            Kind::F64 => SkVariant::F64(f64::from_le_bytes(self.array()?)),
            Kind::String => SkVariant::String(self.text()?.into()),
            Kind::Bytes => SkVariant::Bytes(Arc::new(self.payload()?)),
            Kind::List => self.list(depth)?,
            Kind::Map => self.map(depth)?,
        })
    }

    fn list(&mut self, depth: usize) -> Result<SkVariant, VariantError> {
        const ITEM_BYTES_MIN: usize = 1;
        let inside = self.budget.enter(depth)?;
        let count = self.count(ITEM_BYTES_MIN)?;
        let mut items = Vec::with_capacity(count);
        for _ in 0..count {
            items.push(self.value(inside)?);
        }
        Ok(SkVariant::List(items.into()))
    }

    fn map(&mut self, depth: usize) -> Result<SkVariant, VariantError> {
        const ENTRY_BYTES_MIN: usize = 5;
        let inside = self.budget.enter(depth)?;
        let count = self.count(ENTRY_BYTES_MIN)?;
        let mut entries = Vec::with_capacity(count);
        let mut last: Option<&str> = None;
        for _ in 0..count {
            let key_at = self.at;
            let key = self.text()?;
            if last.is_some_and(|last| last >= key) {
                self.at = key_at;
                return Err(self.malformed("a key is repeated or out of order"));
            }
            last = Some(key);
            entries.push((key.to_owned(), self.value(inside)?));
        }
        // From sorted entries the tree is built in one go.
        Ok(SkVariant::Map(entries.into_iter().collect::<BTreeMap<_, _>>().into()))
    }

    /// A count of parts, each at least `bytes_min` long, charged to the budget.
    fn count(&mut self, bytes_min: usize) -> Result<usize, VariantError> {
        let count = self.length()?;
        self.need(count.saturating_mul(bytes_min))?;
        self.budget.take_nodes(count)?;
        Ok(count)
    }

    fn truth(&mut self) -> Result<bool, VariantError> {
        match self.array()? {
            [0] => Ok(false),
            [1] => Ok(true),
            _ => {
                self.at -= 1;
                Err(self.malformed("a bool is 0 or 1"))
            }
        }
    }

    fn text(&mut self) -> Result<&'a str, VariantError> {
        let text_at = self.at;
        let run = self.run()?;
        std::str::from_utf8(run).map_err(|error| VariantError::Malformed {
            at: text_at + 4 + error.valid_up_to(),
            what: "a text is not UTF-8",
        })
    }

    fn payload(&mut self) -> Result<Bytes, VariantError> {
        let run = self.run()?;
        Ok(match self.shared {
            Some(shared) => shared.slice(self.at - run.len()..self.at),
            None => Bytes::copy_from_slice(run),
        })
    }

    fn run(&mut self) -> Result<&'a [u8], VariantError> {
        let len = self.length()?;
        self.take(len)
    }

    fn length(&mut self) -> Result<usize, VariantError> {
        // A length that the machine cannot count is certainly longer than what is there.
        Ok(usize::try_from(u32::from_le_bytes(self.array()?)).unwrap_or(usize::MAX))
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], VariantError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    fn take(&mut self, len: usize) -> Result<&'a [u8], VariantError> {
        self.need(len)?;
        let run = &self.form[self.at..self.at + len];
        self.at += len;
        Ok(run)
    }

    fn need(&self, needed: usize) -> Result<(), VariantError> {
        let left = self.form.len() - self.at;
        if needed > left {
            return Err(VariantError::Truncated { at: self.at, needed, left });
        }
        Ok(())
    }

    fn malformed(&self, what: &'static str) -> VariantError {
        VariantError::Malformed { at: self.at, what }
    }
}
