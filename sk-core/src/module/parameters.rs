//! Declared parameters: what a module can be told, with type, default, range, unit and meaning.

use sk_flat::{Kind, SkVariant, VariantError};
use std::fmt;

/// How many characters of a refused value an error repeats.
const FOUND_CHARS_MAX: usize = 80;

/// A set of named, checked settings; [`parameters!`](crate::parameters) makes one.
///
/// The fields of such a struct are plain and public, and the code that reads them does no look-up. What
/// comes from outside (a configuration, an operator, a peer) goes through [`set`](Parameters::set) and
/// [`from_variant`](Parameters::from_variant), which check it against the declaration.
pub trait Parameters: Clone + Default + PartialEq + fmt::Debug + 'static {
    /// The declarations, in their order.
    fn describe() -> &'static [ParameterInfo];

    /// The present value of a parameter; `None` if there is none of that name.
    fn get(&self, name: &str) -> Option<SkVariant>;

    /// Checks a value and takes it over. Conversion is strict, as in [`sk_flat::FromVariant`].
    ///
    /// # Errors
    /// There is no such parameter, or the value is of another type or out of range. Nothing has changed then.
    fn set(&mut self, name: &str, value: &SkVariant) -> Result<(), ParameterError>;

    /// All values, as a map from name to value.
    fn to_variant(&self) -> SkVariant {
        let value = |info: &'static ParameterInfo| Some((info.name, self.get(info.name)?));
        SkVariant::map(Self::describe().iter().filter_map(value))
    }

    /// A set from a map of values; what the map lacks has its default.
    ///
    /// # Errors
    /// The value is no map, or as [`set`](Parameters::set) for one of its entries.
    fn from_variant(values: &SkVariant) -> Result<Self, ParameterError> {
        let mut set = Self::default();
        let map = values.as_map().ok_or(ParameterError::NotAMap { found: values.kind() })?;
        for (name, value) in map {
            set.set(name, value)?;
        }
        Ok(set)
    }

    /// The JSON Schema of such a map.
    ///
    /// ```
    /// use sk_core::module::*;
    /// sk_core::parameters! { struct Lamp { level: u8 = 5, 0..=10, "lm"; } }
    /// let level = Lamp::schema().get("properties").and_then(|all| all.get("level")).cloned();
    /// assert_eq!(
    ///     level.unwrap_or_default().to_json()?,
    ///     r#"{"default":5,"maximum":10,"minimum":0,"type":"integer","unit":"lm"}"#,
    /// );
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    fn schema() -> SkVariant {
        let properties = Self::describe().iter().map(|info| (info.name, info.schema()));
        SkVariant::map([
            ("type", "object".into()),
            ("additionalProperties", false.into()),
            ("properties", SkVariant::map(properties)),
        ])
    }
}

/// For what has nothing to be told: only the empty map is one of these.
impl Parameters for () {
    fn describe() -> &'static [ParameterInfo] {
        &[]
    }

    fn get(&self, _name: &str) -> Option<SkVariant> {
        None
    }

    fn set(&mut self, name: &str, _value: &SkVariant) -> Result<(), ParameterError> {
        Err(ParameterError::unknown::<()>(name))
    }
}

/// The declaration of one parameter.
#[derive(Clone, PartialEq)]
#[non_exhaustive]
pub struct ParameterInfo {
    /// Its name.
    pub name: &'static str,
    /// Its Rust type, as it was written.
    pub type_name: &'static str,
    /// What it counts in, such as `ms`; empty if that has no name.
    pub unit: &'static str,
    /// Its value where nobody says otherwise.
    pub default: SkVariant,
    /// The smallest value allowed, if there is one.
    pub low: Option<SkVariant>,
    /// The largest value allowed, if there is one.
    pub high: Option<SkVariant>,
    /// What it means: the doc comment, as one line.
    pub doc: String,
    type_schema: SkVariant,
}

impl ParameterInfo {
    /// For `parameters!`.
    #[doc(hidden)]
    pub fn new<T: crate::module::ParameterType>(
        name: &'static str,
        type_name: &'static str,
        unit: &'static str,
        doc: &[&str],
        default: T,
        [low, high]: [Option<T>; 2],
    ) -> ParameterInfo {
        let doc: Vec<&str> = doc.iter().map(|line| line.trim()).filter(|line| !line.is_empty()).collect();
        ParameterInfo {
            name: plain_name(name),
            type_name,
            unit,
            default: default.into_variant(),
            low: low.map(T::into_variant),
            high: high.map(T::into_variant),
            doc: doc.join(" "),
            type_schema: T::schema(),
        }
    }

    /// The JSON Schema of one value.
    pub fn schema(&self) -> SkVariant {
        let mut schema = self.type_schema.clone();
        let Some(entries) = schema.as_map_mut() else { return schema };
        let text = |text: &str| (!text.is_empty()).then(|| SkVariant::from(text));
        let known = [
            ("default", Some(self.default.clone())),
            ("minimum", self.low.clone()),
            ("maximum", self.high.clone()),
            ("unit", text(self.unit)),
            ("description", text(&self.doc)),
        ];
        let known = known.into_iter().filter_map(|(key, value)| Some((key.to_owned(), value?)));
        entries.extend(known);
        schema
    }

    fn of<P: Parameters>(name: &str) -> Option<&'static ParameterInfo> {
        P::describe().iter().find(|info| info.name == name)
    }
}

/// What it takes, as errors print it: `f64 in 9.0..=13.0 V`.
impl fmt::Display for ParameterInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.type_name)?;
        if self.low.is_some() || self.high.is_some() {
            f.write_str(" in ")?;
            self.low.iter().try_for_each(|low| write!(f, "{low}"))?;
            f.write_str("..")?;
            self.high.iter().try_for_each(|high| write!(f, "={high}"))?;
        }
        if !self.unit.is_empty() {
            write!(f, " {}", self.unit)?;
        }
        Ok(())
    }
}

/// One readable line: name, what it takes, default, meaning.
impl fmt::Debug for ParameterInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {self} = {}", self.name, self.default)?;
        if !self.doc.is_empty() {
            write!(f, "  ({})", self.doc)?;
        }
        Ok(())
    }
}

/// Why a value was not taken over. Nothing has changed then.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ParameterError {
    /// There is no parameter of that name.
    #[error("no parameter `{}`; the known ones are {}", shortened(name), known_names(known))]
    Unknown {
        /// What was asked for.
        name: Box<str>,
        /// The parameters there are.
        known: &'static [ParameterInfo],
    },
    /// The value cannot be read as the parameter's type.
    #[error("parameter `{}` takes {info}: {cause}", info.name)]
    Type {
        /// The declaration.
        info: &'static ParameterInfo,
        /// What was expected and what came.
        cause: VariantError,
    },
    /// The value is of the right type but outside the range.
    #[error("parameter `{}` takes {info}, found {}", info.name, shortened(&found.to_string()))]
    Range {
        /// The declaration.
        info: &'static ParameterInfo,
        /// What came.
        found: SkVariant,
    },
    /// Parameters come as a map from name to value.
    #[error("parameters are a map of names and values, found {found}")]
    NotAMap {
        /// What came.
        found: Kind,
    },
}

impl ParameterError {
    /// The error for a name that the set does not have.
    pub fn unknown<P: Parameters>(name: &str) -> ParameterError {
        ParameterError::Unknown { name: name.into(), known: P::describe() }
    }
}

/// What `parameters!` does to take one value over.
#[doc(hidden)]
pub fn checked<P: Parameters, T: sk_flat::FromVariant>(
    name: &str,
    value: &SkVariant,
    is_in_range: impl FnOnce(&T) -> bool,
) -> Result<T, ParameterError> {
    let Some(info) = ParameterInfo::of::<P>(name) else { return Err(ParameterError::unknown::<P>(name)) };
    let read = T::from_variant(value).map_err(|cause| ParameterError::Type { info, cause })?;
    if is_in_range(&read) { Ok(read) } else { Err(ParameterError::Range { info, found: value.clone() }) }
}

/// The name of a field that had to be written `r#type`.
#[doc(hidden)]
pub fn plain_name(name: &'static str) -> &'static str {
    name.strip_prefix("r#").unwrap_or(name)
}

fn known_names(known: &[ParameterInfo]) -> String {
    if known.is_empty() {
        return "none".to_owned();
    }
    let names: Vec<&str> = known.iter().map(|info| info.name).collect();
    names.join(", ")
}

/// A peer's value in an error must not become a peer's page in a log.
pub(super) fn shortened(text: &str) -> String {
    let mut chars = text.chars();
    let mut short = String::new();
    for char in chars.by_ref().take(FOUND_CHARS_MAX) {
        match char {
            '"' | '\'' | '\\' => short.push(char),
            _ => short.extend(char.escape_debug()),
        }
    }
    if chars.next().is_some() {
        short.push('…');
    }
    short
}
