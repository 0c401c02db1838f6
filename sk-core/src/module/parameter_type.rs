//! Which Rust types a parameter can have, and what JSON Schema says of each.

use sk_flat::{FromVariant, IntoVariant, Name, SkList, SkMap, SkVariant};
use std::collections::BTreeMap;
use std::time::Duration;

/// A type that a parameter can have: numbers, `bool`, `String`, lists and maps of them, `Option`, `Duration`
/// (seconds), `Name`, variants; and types of your own.
///
/// ```
/// use sk_core::module::*;
/// use sk_core::parameters;
///
/// #[derive(sk_flat::SkVariant, Clone, Debug, PartialEq)]
/// enum Side { Left, Right }
/// impl ParameterType for Side {}
///
/// parameters! { struct Wheel { side: Side = Side::Left; } }
/// let mut wheel = Wheel::default();
/// wheel.set("side", &"Right".into())?;
/// assert_eq!(wheel.side, Side::Right);
/// # Ok::<(), ParameterError>(())
/// ```
#[diagnostic::on_unimplemented(
    message = "a parameter cannot be of type `{Self}`",
    note = "a type with `IntoVariant` and `FromVariant` becomes one by `impl ParameterType for {Self} {{}}`"
)]
pub trait ParameterType: IntoVariant + FromVariant + Clone + 'static {
    /// The JSON Schema of the type; the empty one allows everything that the type itself can read.
    fn schema() -> SkVariant {
        SkVariant::map::<&str>([])
    }

    /// The JSON Schema of a list of these.
    fn list_schema() -> SkVariant {
        SkVariant::map([("type", "array".into()), ("items", Self::schema())])
    }
}

macro_rules! typed {
    ($($t:ty => $json:literal),* $(,)?) => { $(
        impl ParameterType for $t {
            fn schema() -> SkVariant {
                SkVariant::map([("type", $json.into())])
            }
        }
    )* };
}

typed! {
    bool => "boolean", String => "string", f32 => "number", f64 => "number",
    SkList => "array", SkMap => "object",
}

macro_rules! integers {
    ($($t:ident)*) => { $(
        impl ParameterType for $t {
            fn schema() -> SkVariant {
                let bounds = [("minimum", <$t>::MIN.into()), ("maximum", <$t>::MAX.into())];
                SkVariant::map([("type", "integer".into())].into_iter().chain(bounds))
            }
            integers!(@list $t);
        }
    )* };
    (@list u8) => {
        /// Bytes are written in a form of their own in JSON, and are read from a list of numbers too.
        fn list_schema() -> SkVariant {
            SkVariant::map::<&str>([])
        }
    };
    (@list $other:ident) => {};
}

integers!(i8 i16 i32 i64 isize u8 u16 u32 u64 usize);

impl ParameterType for SkVariant {}

impl ParameterType for Name {
    fn schema() -> SkVariant {
        let longest = sk_flat::NAME_BYTES_MAX.into();
        let pattern = "^[a-z0-9_.-]+$".into();
        SkVariant::map([("type", "string".into()), ("pattern", pattern), ("maxLength", longest)])
    }
}

impl ParameterType for Duration {
    fn schema() -> SkVariant {
        SkVariant::map([("type", "number".into()), ("minimum", 0.into())])
    }
}

impl<T: ParameterType> ParameterType for Vec<T> {
    fn schema() -> SkVariant {
        T::list_schema()
    }
}

impl<T: ParameterType> ParameterType for Option<T> {
    fn schema() -> SkVariant {
        let nothing = SkVariant::map([("type", "null".into())]);
        SkVariant::map([("anyOf", SkVariant::list([T::schema(), nothing]))])
    }
}

impl<T: ParameterType> ParameterType for BTreeMap<String, T> {
    fn schema() -> SkVariant {
        SkVariant::map([("type", "object".into()), ("additionalProperties", T::schema())])
    }
}
