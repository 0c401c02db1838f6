//! What stands in `#[variant(...)]`.

use syn::meta::ParseNestedMeta;
use syn::{Attribute, LitStr, Path};

/// The attributes of a whole type.
#[derive(Default)]
pub(crate) struct TypeAttributes {
    pub(crate) crate_path: Option<Path>,
    pub(crate) ignore_unknown: bool,
}

/// The attributes of a field or of a case.
#[derive(Default)]
pub(crate) struct PartAttributes {
    pub(crate) rename: Option<LitStr>,
    pub(crate) default: bool,
    pub(crate) skip: bool,
}

/// What a part may carry.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    NamedField,
    TupleField,
    Case,
}

pub(crate) fn of_type(attributes: &[Attribute]) -> syn::Result<TypeAttributes> {
    let mut read = TypeAttributes::default();
    each(attributes, |meta| {
        if meta.path.is_ident("crate") {
            read.crate_path = Some(meta.value()?.parse::<LitStr>()?.parse()?);
        } else if meta.path.is_ident("ignore_unknown") {
            read.ignore_unknown = true;
        } else {
            return Err(meta.error("a type takes `ignore_unknown` and `crate = \"...\"`"));
        }
        Ok(())
    })?;
    Ok(read)
}

pub(crate) fn of_part(attributes: &[Attribute], part: Part) -> syn::Result<PartAttributes> {
    let mut read = PartAttributes::default();
    each(attributes, |meta| {
        if part != Part::TupleField && meta.path.is_ident("rename") {
            read.rename = Some(meta.value()?.parse()?);
        } else if part == Part::NamedField && meta.path.is_ident("default") {
            read.default = true;
        } else if part == Part::NamedField && meta.path.is_ident("skip") {
            read.skip = true;
        } else {
            return Err(meta.error(match part {
                Part::NamedField => "a field takes `rename = \"...\"`, `default` and `skip`",
                Part::TupleField => "a field without a name takes no attribute",
                Part::Case => "a case takes `rename = \"...\"`",
            }));
        }
        if read.skip && (read.default || read.rename.is_some()) {
            return Err(meta.error("a skipped field is neither named nor read: `skip` stands alone"));
        }
        Ok(())
    })?;
    Ok(read)
}

fn each(
    attributes: &[Attribute],
    mut read: impl FnMut(ParseNestedMeta<'_>) -> syn::Result<()>,
) -> syn::Result<()> {
    let ours = attributes.iter().filter(|attribute| attribute.path().is_ident("variant"));
    for attribute in ours {
        attribute.parse_nested_meta(&mut read)?;
    }
    Ok(())
}
