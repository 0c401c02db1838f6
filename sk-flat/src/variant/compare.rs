//! Equality of variants, without recursion: a tree may be deeper than the stack.

use super::SkVariant;

impl PartialEq for SkVariant {
    fn eq(&self, other: &SkVariant) -> bool {
        alike(self, other, Rule::Identity)
    }
}

impl Eq for SkVariant {}

impl PartialEq for super::SkList {
    fn eq(&self, other: &Self) -> bool {
        SkVariant::List(self.clone()) == SkVariant::List(other.clone())
    }
}

impl Eq for super::SkList {}

impl PartialEq for super::SkMap {
    fn eq(&self, other: &Self) -> bool {
        SkVariant::Map(self.clone()) == SkVariant::Map(other.clone())
    }
}

impl Eq for super::SkMap {}

impl SkVariant {
    /// Whether both hold the same value, numbers compared across kinds as mathematics does:
    /// `U8(1)`, `I64(1)` and `F32(1.0)` are the same, `0.0` is `-0.0`, and a NaN is no number's
    /// equal, not even its own. An integer and a float are the same only if exactly equal.
    ///
    /// ```
    /// use sk_flat::SkVariant;
    ///
    /// assert!(SkVariant::U8(7).same_value(&SkVariant::F64(7.0)));
    /// assert!(!SkVariant::I64(9_007_199_254_740_993).same_value(&SkVariant::F64(9_007_199_254_740_992.0)));
    /// ```
    pub fn same_value(&self, other: &SkVariant) -> bool {
        alike(self, other, Rule::Value)
    }

    /// The integer of any kind.
    pub(super) const fn integer(&self) -> Option<i128> {
        Some(match self {
            SkVariant::I8(n) => *n as i128,
            SkVariant::I16(n) => *n as i128,
            SkVariant::I32(n) => *n as i128,
            SkVariant::I64(n) => *n as i128,
            SkVariant::U8(n) => *n as i128,
            SkVariant::U16(n) => *n as i128,
            SkVariant::U32(n) => *n as i128,
            SkVariant::U64(n) => *n as i128,
            _ => return None,
        })
    }

    /// The float of either kind.
    pub(super) const fn float(&self) -> Option<f64> {
        Some(match self {
            SkVariant::F32(x) => *x as f64,
            SkVariant::F64(x) => *x,
            _ => return None,
        })
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Rule {
    Identity,
    Value,
}

impl Rule {
    fn scalars(self, a: &SkVariant, b: &SkVariant) -> bool {
        match self {
            Rule::Identity => identical(a, b),
            Rule::Value => same_number(a, b).unwrap_or_else(|| identical(a, b)),
        }
    }
}

fn alike(a: &SkVariant, b: &SkVariant, rule: Rule) -> bool {
    // Shared memory proves identity, but not sameness: a NaN inside differs from itself.
    let sharing_decides = rule == Rule::Identity;
    let mut next = Some((a, b));
    let mut waiting = Vec::new();
    while let Some((a, b)) = next {
        match (a, b) {
            (SkVariant::List(a), SkVariant::List(b)) => {
                if a.len() != b.len() {
                    return false;
                }
                if !(sharing_decides && a.same_memory(b)) {
                    waiting.extend(a.iter().zip(b.iter()));
                }
            }
            (SkVariant::Map(a), SkVariant::Map(b)) => {
                if a.len() != b.len() || !a.keys().eq(b.keys()) {
                    return false;
                }
                if !(sharing_decides && a.same_memory(b)) {
                    waiting.extend(a.values().zip(b.values()));
                }
            }
            (a, b) if !rule.scalars(a, b) => return false,
            _ => {}
        }
        next = waiting.pop();
    }
    true
}

fn identical(a: &SkVariant, b: &SkVariant) -> bool {
    match (a, b) {
        (SkVariant::Bool(a), SkVariant::Bool(b)) => a == b,
        (SkVariant::F32(a), SkVariant::F32(b)) => a.to_bits() == b.to_bits(),
        (SkVariant::F64(a), SkVariant::F64(b)) => a.to_bits() == b.to_bits(),
        (SkVariant::String(a), SkVariant::String(b)) => a == b,
        (SkVariant::Bytes(a), SkVariant::Bytes(b)) => a == b,
        _ => a.kind() == b.kind() && a.integer() == b.integer(),
    }
}

/// Whether two numbers are the same; `None` if one of them is no number.
fn same_number(a: &SkVariant, b: &SkVariant) -> Option<bool> {
    match (a.integer(), a.float(), b.integer(), b.float()) {
        (Some(a), _, Some(b), _) => Some(a == b),
        (_, Some(a), _, Some(b)) => Some(a == b),
        (Some(n), _, _, Some(x)) | (_, Some(x), Some(n), _) => Some(equals_integer(x, n)),
        _ => None,
    }
}

/// Whether a float is exactly this integer, which is at most 64 bits wide.
fn equals_integer(x: f64, n: i128) -> bool {
    // The cast truncates and saturates, far outside the 64 bits; the fraction is checked apart.
    x.trunc() == x && x as i128 == n
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SkList;

    #[test]
    fn identity_tells_kinds_and_bits_apart() {
        assert_ne!(SkVariant::I32(1), SkVariant::I64(1));
        assert_ne!(SkVariant::F64(0.0), SkVariant::F64(-0.0));
        assert_eq!(SkVariant::F64(f64::NAN), SkVariant::F64(f64::NAN));
        assert_ne!(SkVariant::Null, SkVariant::Bool(false));
        assert_ne!(SkVariant::list([1]), SkVariant::list([1, 2]));
        assert_ne!(SkVariant::map([("a", 1.into())]), SkVariant::map([("b", 1.into())]));
    }

    #[test]
    fn same_value_is_exact_between_integers_and_floats() {
        let big = SkVariant::U64(u64::MAX);
        assert!(!big.same_value(&SkVariant::F64(u64::MAX as f64)));
        assert!(!SkVariant::I64(1).same_value(&SkVariant::F64(1.5)));
        assert!(!SkVariant::I64(0).same_value(&SkVariant::F64(f64::INFINITY)));
        assert!(SkVariant::I8(-3).same_value(&SkVariant::F32(-3.0)));
        assert!(!SkVariant::U64(1).same_value(&SkVariant::Bool(true)));
        assert!(SkVariant::from("x").same_value(&SkVariant::from("x")));
    }

    #[test]
    fn a_shared_list_with_a_nan_is_identical_but_not_the_same_value() {
        let list = SkVariant::list([f64::NAN]);
        assert_eq!(list, list.clone());
        assert!(!list.same_value(&list.clone()));
    }

    #[test]
    fn deep_trees_compare_without_recursion() {
        let deep =
            || (0..100_000).fold(SkVariant::Null, |below, _| SkVariant::List(SkList::from(vec![below])));
        assert_eq!(deep(), deep());
        assert!(deep().same_value(&deep()));
    }
}
