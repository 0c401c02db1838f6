//! What the code made by `derive(SkVariant)` calls. It is no part of the interface for people.

use crate::error::VariantError;
use crate::variant::{FromVariant, SkMap, SkVariant};
use std::collections::BTreeMap;

/// An enum's case with data: a map of one entry.
pub fn case(name: &str, data: SkVariant) -> SkVariant {
    SkVariant::Map(SkMap::from(BTreeMap::from([(name.to_owned(), data)])))
}

/// The entries of a struct with named fields.
pub struct Fields<'a>(&'a BTreeMap<String, SkVariant>);

impl<'a> Fields<'a> {
    /// The entries, all of which are known.
    pub fn of(v: &'a SkVariant, known: &'static [&'static str]) -> Result<Fields<'a>, VariantError> {
        let fields = Fields::open(v, known)?;
        match fields.0.keys().find(|key| !known.contains(&key.as_str())) {
            Some(key) => Err(VariantError::UnknownField { known }.in_field(key)),
            None => Ok(fields),
        }
    }

    /// The entries, of which some may be unknown.
    pub fn open(v: &'a SkVariant, _known: &'static [&'static str]) -> Result<Fields<'a>, VariantError> {
        v.as_map()
            .map(Fields)
            .ok_or(VariantError::Expected { expected: "map", found: v.kind() })
    }

    /// The field of this name.
    pub fn read<T: FromVariant>(&self, name: &str) -> Result<T, VariantError> {
        self.0
            .get(name)
            .map_or_else(T::from_missing, T::from_variant)
            .map_err(|error| error.in_field(name))
    }

    /// The field of this name, or its default if it is missing.
    pub fn read_or_default<T: FromVariant + Default>(&self, name: &str) -> Result<T, VariantError> {
        if self.0.contains_key(name) { self.read(name) } else { Ok(T::default()) }
    }
}

/// The items of a tuple struct.
pub struct Items<'a>(&'a [SkVariant]);

impl<'a> Items<'a> {
    /// The items, exactly as many as the struct has fields.
    pub fn of(v: &'a SkVariant, expected: usize) -> Result<Items<'a>, VariantError> {
        let items = v
            .as_list()
            .ok_or(VariantError::Expected { expected: "list", found: v.kind() })?;
        if items.len() != expected {
            return Err(VariantError::Length { expected, found: items.len() });
        }
        Ok(Items(items))
    }

    /// The item at a place below the number of fields.
    pub fn read<T: FromVariant>(&self, index: usize) -> Result<T, VariantError> {
        T::from_variant(&self.0[index]).map_err(|error| error.in_item(index))
    }
}

/// An enum's case.
#[derive(Clone, Copy)]
pub struct Case<'a> {
    name: &'a str,
    data: Option<&'a SkVariant>,
}

impl<'a> Case<'a> {
    /// A string is a case without data, a map of one entry a case with data.
    pub fn of(v: &'a SkVariant) -> Result<Case<'a>, VariantError> {
        let wrong = VariantError::Expected {
            expected: "the name of a case, or a map of its name and data",
            found: v.kind(),
        };
        match v {
            SkVariant::String(name) => Ok(Case { name, data: None }),
            SkVariant::Map(map) => match map.first_key_value() {
                Some((name, data)) if map.len() == 1 => Ok(Case { name, data: Some(data) }),
                _ => Err(VariantError::Custom(
                    format!("expected a map of one entry for a case, found {} entries", map.len()).into(),
                )),
            },
            _ => Err(wrong),
        }
    }

    /// The name.
    pub fn name(&self) -> &'a str {
        self.name
    }

    /// Checks that there is no data.
    pub fn without_data(self) -> Result<(), VariantError> {
        match self.data {
            None => Ok(()),
            Some(_) => {
                let problem = "this case carries no data: expected its name as a string";
                Err(VariantError::Custom(problem.into()).in_field(self.name))
            }
        }
    }

    /// Reads the data.
    pub fn with_data<T>(
        self,
        read: impl FnOnce(&SkVariant) -> Result<T, VariantError>,
    ) -> Result<T, VariantError> {
        let missing = || VariantError::Custom("this case carries data, and none came".into());
        self.data
            .ok_or_else(missing)
            .and_then(read)
            .map_err(|error| error.in_field(self.name))
    }

    /// The error for a name that no case has.
    pub fn unknown(&self, known: &'static [&'static str]) -> VariantError {
        VariantError::UnknownCase { found: self.name.into(), known }
    }
}
