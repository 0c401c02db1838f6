//! Between variants and the containers of the standard library.
//!
//! Sequences and sets are lists, tuples are lists of fixed length, maps with text keys are maps, and
//! an `Option` is its value or `Null`. Hashed containers are sorted on the way in, so that their
//! accidental order never shows. `Vec<u8>`, `[u8; N]` and `&[u8]` are `Bytes`.

use super::{FromVariant, IntoVariant, SkList, SkMap, SkVariant};
use crate::error::VariantError;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet, LinkedList, VecDeque};
use std::hash::{BuildHasher, Hash};
use std::rc::Rc;
use std::sync::Arc;

impl<T: IntoVariant> IntoVariant for Vec<T> {
    fn into_variant(self) -> SkVariant {
        T::vec_into_variant(self)
    }
}

impl<T: FromVariant> FromVariant for Vec<T> {
    fn from_variant(v: &SkVariant) -> Result<Vec<T>, VariantError> {
        T::vec_from_variant(v)
    }
}

impl<T: IntoVariant + Clone> IntoVariant for &[T] {
    fn into_variant(self) -> SkVariant {
        T::vec_into_variant(self.to_vec())
    }
}

impl<T: IntoVariant, const N: usize> IntoVariant for [T; N] {
    fn into_variant(self) -> SkVariant {
        T::vec_into_variant(Vec::from(self))
    }
}

impl<T: FromVariant, const N: usize> FromVariant for [T; N] {
    fn from_variant(v: &SkVariant) -> Result<[T; N], VariantError> {
        let items = T::vec_from_variant(v)?;
        <[T; N]>::try_from(items).map_err(|items| VariantError::Length { expected: N, found: items.len() })
    }
}

impl<T: IntoVariant> IntoVariant for Option<T> {
    fn into_variant(self) -> SkVariant {
        self.map_or(SkVariant::Null, T::into_variant)
    }
}

/// `Null` is `None`. So `Option<Option<T>>` and `Option<()>` do not tell their empty forms apart.
impl<T: FromVariant> FromVariant for Option<T> {
    fn from_variant(v: &SkVariant) -> Result<Option<T>, VariantError> {
        if v.is_null() { Ok(None) } else { T::from_variant(v).map(Some) }
    }

    fn from_missing() -> Result<Option<T>, VariantError> {
        Ok(None)
    }
}

macro_rules! pointers {
    ($($pointer:ident),*) => { $(
        impl<T: FromVariant> FromVariant for $pointer<T> {
            fn from_variant(v: &SkVariant) -> Result<$pointer<T>, VariantError> {
                T::from_variant(v).map($pointer::new)
            }

            fn from_missing() -> Result<$pointer<T>, VariantError> {
                T::from_missing().map($pointer::new)
            }
        }
    )* };
}

pointers!(Box, Arc, Rc);

impl<T: IntoVariant> IntoVariant for Box<T> {
    fn into_variant(self) -> SkVariant {
        (*self).into_variant()
    }
}

impl<T: IntoVariant + Clone> IntoVariant for Arc<T> {
    fn into_variant(self) -> SkVariant {
        Arc::unwrap_or_clone(self).into_variant()
    }
}

impl<T: IntoVariant + Clone> IntoVariant for Rc<T> {
    fn into_variant(self) -> SkVariant {
        Rc::unwrap_or_clone(self).into_variant()
    }
}

macro_rules! sequences {
    ($($name:ident where [$($bound:tt)*]),*) => { $(
        impl<T: IntoVariant> IntoVariant for $name<T> {
            fn into_variant(self) -> SkVariant {
                T::vec_into_variant(self.into_iter().collect())
            }
        }

        impl<T: FromVariant $($bound)*> FromVariant for $name<T> {
            fn from_variant(v: &SkVariant) -> Result<$name<T>, VariantError> {
                T::vec_from_variant(v).map(|items| items.into_iter().collect())
            }
        }
    )* };
}

sequences!(VecDeque where [], LinkedList where [], BTreeSet where [+ Ord]);

impl<T: IntoVariant + Ord, S> IntoVariant for HashSet<T, S> {
    fn into_variant(self) -> SkVariant {
        let mut items: Vec<T> = self.into_iter().collect();
        items.sort_unstable();
        T::vec_into_variant(items)
    }
}

impl<T: FromVariant + Eq + Hash, S: BuildHasher + Default> FromVariant for HashSet<T, S> {
    fn from_variant(v: &SkVariant) -> Result<HashSet<T, S>, VariantError> {
        T::vec_from_variant(v).map(|items| items.into_iter().collect())
    }
}

fn entries_of<T: FromVariant, M: FromIterator<(String, T)>>(v: &SkVariant) -> Result<M, VariantError> {
    let entries = v.as_map().ok_or(VariantError::Expected { expected: "map", found: v.kind() })?;
    let read = |(key, value): (&String, &SkVariant)| match T::from_variant(value) {
        Ok(value) => Ok((key.clone(), value)),
        Err(error) => Err(error.in_field(key)),
    };
    entries.iter().map(read).collect()
}

impl<T: IntoVariant> IntoVariant for BTreeMap<String, T> {
    fn into_variant(self) -> SkVariant {
        SkVariant::map(self.into_iter().map(|(key, value)| (key, value.into_variant())))
    }
}

impl<T: FromVariant> FromVariant for BTreeMap<String, T> {
    fn from_variant(v: &SkVariant) -> Result<BTreeMap<String, T>, VariantError> {
        entries_of(v)
    }
}

impl<T: IntoVariant, S> IntoVariant for HashMap<String, T, S> {
    fn into_variant(self) -> SkVariant {
        SkVariant::map(self.into_iter().map(|(key, value)| (key, value.into_variant())))
    }
}

impl<T: FromVariant, S: BuildHasher + Default> FromVariant for HashMap<String, T, S> {
    fn from_variant(v: &SkVariant) -> Result<HashMap<String, T, S>, VariantError> {
        entries_of(v)
    }
}

impl IntoVariant for SkList {
    fn into_variant(self) -> SkVariant {
        SkVariant::List(self)
    }
}

impl FromVariant for SkList {
    fn from_variant(v: &SkVariant) -> Result<SkList, VariantError> {
        match v {
            SkVariant::List(list) => Ok(list.clone()),
            other => Err(VariantError::Expected { expected: "list", found: other.kind() }),
        }
    }
}

impl IntoVariant for SkMap {
    fn into_variant(self) -> SkVariant {
        SkVariant::Map(self)
    }
}

impl FromVariant for SkMap {
    fn from_variant(v: &SkVariant) -> Result<SkMap, VariantError> {
        match v {
            SkVariant::Map(map) => Ok(map.clone()),
            other => Err(VariantError::Expected { expected: "map", found: other.kind() }),
        }
    }
}

macro_rules! tuples {
    ($($length:literal: $($t:ident $index:tt),+;)*) => { $(
        impl<$($t: IntoVariant),+> IntoVariant for ($($t,)+) {
            fn into_variant(self) -> SkVariant {
                SkVariant::List(SkList::from(vec![$(self.$index.into_variant()),+]))
            }
        }

        impl<$($t: FromVariant),+> FromVariant for ($($t,)+) {
            fn from_variant(v: &SkVariant) -> Result<Self, VariantError> {
                let items = v.as_list().ok_or(VariantError::Expected { expected: "list", found: v.kind() })?;
                if items.len() != $length {
                    return Err(VariantError::Length { expected: $length, found: items.len() });
                }
                Ok(($($t::from_variant(&items[$index]).map_err(|error| error.in_item($index))?,)+))
            }
        }

        impl<$($t: IntoVariant),+> From<($($t,)+)> for SkVariant {
            fn from(value: ($($t,)+)) -> SkVariant {
                value.into_variant()
            }
        }
    )* };
}

tuples! {
    1: A 0;
    2: A 0, B 1;
    3: A 0, B 1, C 2;
    4: A 0, B 1, C 2, D 3;
    5: A 0, B 1, C 2, D 3, E 4;
    6: A 0, B 1, C 2, D 3, E 4, F 5;
    7: A 0, B 1, C 2, D 3, E 4, F 5, G 6;
    8: A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7;
}

/// `From` and `TryFrom` over the two traits. An `Option` has no `TryFrom`: the standard library
/// already says how anything becomes an `Option` of itself. `FromVariant` reads it.
macro_rules! std_twins {
    (from: $([$($generics:tt)*] $t:ty;)*) => { $(
        impl<$($generics)*> From<$t> for SkVariant {
            fn from(value: $t) -> SkVariant {
                value.into_variant()
            }
        }
    )* };
    (try_from: $([$($generics:tt)*] $t:ty;)*) => { $(
        impl<$($generics)*> TryFrom<SkVariant> for $t {
            type Error = VariantError;
            fn try_from(v: SkVariant) -> Result<$t, VariantError> {
                <$t>::from_variant(&v)
            }
        }
        impl<$($generics)*> TryFrom<&SkVariant> for $t {
            type Error = VariantError;
            fn try_from(v: &SkVariant) -> Result<$t, VariantError> {
                <$t>::from_variant(v)
            }
        }
    )* };
}

std_twins! { from:
    [T: IntoVariant] Vec<T>;
    [T: IntoVariant + Clone] &[T];
    [T: IntoVariant, const N: usize] [T; N];
    [T: IntoVariant] Option<T>;
    [T: IntoVariant] VecDeque<T>;
    [T: IntoVariant] LinkedList<T>;
    [T: IntoVariant] BTreeSet<T>;
    [T: IntoVariant + Ord, S] HashSet<T, S>;
    [T: IntoVariant] BTreeMap<String, T>;
    [T: IntoVariant, S] HashMap<String, T, S>;
    [] SkList;
    [] SkMap;
}

std_twins! { try_from:
    [T: FromVariant] Vec<T>;
    [T: FromVariant, const N: usize] [T; N];
    [T: FromVariant] VecDeque<T>;
    [T: FromVariant] LinkedList<T>;
    [T: FromVariant + Ord] BTreeSet<T>;
    [T: FromVariant + Eq + Hash, S: BuildHasher + Default] HashSet<T, S>;
    [T: FromVariant] BTreeMap<String, T>;
    [T: FromVariant, S: BuildHasher + Default] HashMap<String, T, S>;
    [] SkList;
    [] SkMap;
}
