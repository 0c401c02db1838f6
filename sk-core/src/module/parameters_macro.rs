//! `parameters!`: a struct of plain fields out of its declaration.

/// Declares the parameters of a module: a struct with plain public fields that is
/// [`Parameters`](crate::module::Parameters), `Clone`, `Debug`, `PartialEq` and has the defaults as `Default`.
///
/// Each line is `name: type = default;`, optionally with a range, a unit, or both behind the default:
/// `, 5..=1000, "ms"`. The range is one of `low..=high`, `low..` and `..=high`, both ends are allowed values,
/// and `low` is a literal. A default outside its range does not compile. The default of a `String` may be a
/// `&str`. The doc comment of a field is shown to the operator.
///
/// ```
/// use sk_core::module::*;
/// use sk_core::parameters;
///
/// parameters! {
///     /// What the battery watch can be told.
///     pub struct BatteryParameters {
///         /// Time between two readings.
///         period_ms: u64 = 20, 5..=1000, "ms";
///         /// Below this the alarm rings.
///         low: f64 = 11.0, 9.0..=13.0, "V";
///         channel: String = "volts";
///         cells: Vec<String> = vec!["a".into(), "b".into()];
///     }
/// }
///
/// let mut parameters = BatteryParameters::default();
/// assert_eq!(parameters.period_ms, 20);
/// parameters.set("low", &12.into())?;
/// assert_eq!(parameters.low, 12.0);
/// let refused = parameters.set("low", &20.0.into()).unwrap_err();
/// assert_eq!(refused.to_string(), "parameter `low` takes f64 in 9.0..=13.0 V, found 20.0");
/// assert_eq!(parameters.low, 12.0);
/// # Ok::<(), ParameterError>(())
/// ```
///
/// A default must keep to its own range:
///
/// ```compile_fail
/// sk_core::parameters! { struct Lamp { level: u8 = 11, 0..=10; } }
/// ```
#[macro_export]
macro_rules! parameters {
    ($(#[$meta:meta])* $vis:vis struct $name:ident { $($fields:tt)* }) => {
        $crate::__parameters! { @fields [$(#[$meta])* $vis $name] [] $($fields)* }
    };
}

/// Takes one declaration a step, so that a struct can have a hundred of them under the usual recursion
/// limit, and brings it to the form `{ [docs] name [type] [default] [low] [high] [unit] }`.
#[doc(hidden)]
#[macro_export]
macro_rules! __parameters {
    (@fields $head:tt [$($done:tt)*]
        $(#[doc = $doc:expr])* $name:ident : String = $default:expr $(, $unit:literal)? ; $($rest:tt)*
    ) => {
        $crate::__parameters! { @fields $head [$($done)* {
            [$($doc)*] $name [String] [::std::string::String::from($default)] [] [] [$($unit)?]
        }] $($rest)* }
    };
    (@fields $head:tt [$($done:tt)*]
        $(#[doc = $doc:expr])* $name:ident : $type:ty = $default:expr $(, $unit:literal)? ; $($rest:tt)*
    ) => {
        $crate::__parameters! { @fields $head [$($done)* {
            [$($doc)*] $name [$type] [$default] [] [] [$($unit)?]
        }] $($rest)* }
    };
    (@fields $head:tt [$($done:tt)*]
        $(#[doc = $doc:expr])* $name:ident : $type:ty = $default:expr,
            $low:literal ..= $high:expr $(, $unit:literal)? ; $($rest:tt)*
    ) => {
        $crate::__parameters! { @fields $head [$($done)* {
            [$($doc)*] $name [$type] [$default] [$low] [$high] [$($unit)?]
        }] $($rest)* }
    };
    (@fields $head:tt [$($done:tt)*]
        $(#[doc = $doc:expr])* $name:ident : $type:ty = $default:expr,
            $low:literal .. $(, $unit:literal)? ; $($rest:tt)*
    ) => {
        $crate::__parameters! { @fields $head [$($done)* {
            [$($doc)*] $name [$type] [$default] [$low] [] [$($unit)?]
        }] $($rest)* }
    };
    (@fields $head:tt [$($done:tt)*]
        $(#[doc = $doc:expr])* $name:ident : $type:ty = $default:expr,
            ..= $high:expr $(, $unit:literal)? ; $($rest:tt)*
    ) => {
        $crate::__parameters! { @fields $head [$($done)* {
            [$($doc)*] $name [$type] [$default] [] [$high] [$($unit)?]
        }] $($rest)* }
    };

    (@fields [$(#[$meta:meta])* $vis:vis $struct:ident] [$({
        [$($doc:expr)*] $name:ident [$type:ty] [$default:expr] [$($low:expr)?] [$($high:expr)?] [$($unit:literal)?]
    })*]) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        $vis struct $struct {
            $($(#[doc = $doc])* pub $name: $type,)*
        }

        impl ::core::default::Default for $struct {
            fn default() -> Self {
                $struct { $($name: $default,)* }
            }
        }

        $($crate::__parameters! { @check $name [$type] [$default] [$($low)?] [$($high)?] })*

        #[allow(unused_variables, unused_comparisons, clippy::absurd_extreme_comparisons)]
        impl $crate::module::Parameters for $struct {
            fn describe() -> &'static [$crate::module::ParameterInfo] {
                static ALL: ::std::sync::LazyLock<::std::vec::Vec<$crate::module::ParameterInfo>> =
                    ::std::sync::LazyLock::new(|| ::std::vec![$(
                        $crate::module::ParameterInfo::new::<$type>(
                            ::core::stringify!($name),
                            ::core::stringify!($type),
                            ::core::concat!($($unit)?),
                            &[$($doc),*],
                            $default,
                            [$crate::__parameters!(@end $($low)?), $crate::__parameters!(@end $($high)?)],
                        ),
                    )*]);
                &ALL
            }

            fn get(&self, name: &str) -> ::core::option::Option<$crate::SkVariant> {
                $(if name == $crate::macro_support::plain_name(::core::stringify!($name)) {
                    return Some($crate::macro_support::IntoVariant::into_variant(
                        ::core::clone::Clone::clone(&self.$name),
                    ));
                })*
                None
            }

            fn set(
                &mut self,
                name: &str,
                value: &$crate::SkVariant,
            ) -> ::core::result::Result<(), $crate::module::ParameterError> {
                $(if name == $crate::macro_support::plain_name(::core::stringify!($name)) {
                    self.$name = $crate::macro_support::checked::<Self, $type>(name, value, |value| {
                        true $(&& *value >= $low)? $(&& *value <= $high)?
                    })?;
                    return Ok(());
                })*
                Err($crate::module::ParameterError::unknown::<Self>(name))
            }
        }
    };

    (@end) => { None };
    (@end $value:expr) => { Some($value) };

    (@check $name:ident [$type:ty] [$default:expr] [] []) => {};
    (@check $name:ident [$type:ty] [$default:expr] [$($low:expr)?] [$($high:expr)?]) => {
        #[allow(unused_comparisons, clippy::absurd_extreme_comparisons)]
        const _: () = {
            const DEFAULT: $type = $default;
            ::core::assert!(
                true $(&& DEFAULT >= $low)? $(&& DEFAULT <= $high)?,
                ::core::concat!("the default of `", ::core::stringify!($name), "` is outside its range")
            );
        };
    };
}
