//! `derive(SkVariant)`: a user's types as variants. Use it through `sk_flat::SkVariant`.
#![forbid(unsafe_code)]

mod attributes;
mod from;
mod input;
mod into;

use proc_macro::TokenStream;
use syn::{DeriveInput, parse_macro_input};

/// Makes a type convertible to and from a variant: `IntoVariant`, `FromVariant`, and with them
/// `From<T> for SkVariant` and `TryFrom<SkVariant> for T` (also from a reference).
///
/// | type | variant |
/// |---|---|
/// | struct with named fields | a map by field name |
/// | tuple struct of one field | that field |
/// | tuple struct of several fields | a list |
/// | unit struct | null |
/// | enum case without data | its name as a string |
/// | enum case with data | a map of one entry: the name, and the data as for a struct |
///
/// A key that the type does not know is an error, since it is most often a misspelt name; a missing
/// key is one too, unless the field is an `Option` or has a default. Errors name the place:
/// `pose.x: expected f64, found string`.
///
/// Attributes, all inside `#[variant(...)]`:
///
/// | on | attribute | effect |
/// |---|---|---|
/// | a named field, a case | `rename = "..."` | the name in the variant |
/// | a named field | `default` | a missing key gives `Default::default()` |
/// | a named field | `skip` | not written, not read, always `Default::default()` |
/// | the type | `ignore_unknown` | keys that the type does not know are passed over |
/// | the type | `crate = "..."` | the path of `sk_flat` where it is known under another name |
///
/// ```
/// use sk_flat::{SkVariant, VariantError};
///
/// #[derive(SkVariant, Debug, PartialEq)]
/// struct Pose {
///     x: f64,
///     y: f64,
///     #[variant(rename = "heading", default)]
///     theta: f64,
/// }
///
/// #[derive(SkVariant, Debug, PartialEq)]
/// enum Goal {
///     Stop,
///     GoTo(Pose),
/// }
///
/// let goal = Goal::try_from(SkVariant::from_json(r#"{"GoTo": {"x": 1, "y": 2.5}}"#)?)?;
/// assert_eq!(goal, Goal::GoTo(Pose { x: 1.0, y: 2.5, theta: 0.0 }));
/// assert_eq!(SkVariant::from(Goal::Stop), SkVariant::from("Stop"));
///
/// let wrong = SkVariant::from_json(r#"{"GoTo": {"x": "far", "y": 2.5}}"#)?;
/// let error = Goal::try_from(wrong).unwrap_err();
/// assert_eq!(error.to_string(), "GoTo.x: expected f64, found string");
/// # Ok::<(), VariantError>(())
/// ```
#[proc_macro_derive(SkVariant, attributes(variant))]
pub fn derive_sk_variant(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    let expanded = input::Input::read(input).map(|input| {
        let (into, from) = (into::implement(&input), from::implement(&input));
        quote::quote!(#into #from)
    });
    expanded.unwrap_or_else(syn::Error::into_compile_error).into()
}
