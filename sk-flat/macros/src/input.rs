//! The user's type, checked.

use crate::attributes::{self, Part};
use proc_macro2::{Ident, Span, TokenStream};
use quote::{ToTokens, format_ident, quote};
use syn::ext::IdentExt;
use syn::{Data, DeriveInput, Fields, Generics, LitStr, Type, parse_quote};

pub(crate) struct Input {
    pub(crate) ident: Ident,
    pub(crate) generics: Generics,
    /// The path of `sk_flat`.
    pub(crate) flat: TokenStream,
    pub(crate) ignore_unknown: bool,
    pub(crate) body: Body,
}

pub(crate) enum Body {
    Struct(Shape),
    Enum(Vec<Case>),
}

pub(crate) struct Case {
    pub(crate) ident: Ident,
    pub(crate) name: LitStr,
    pub(crate) shape: Shape,
}

/// The fields of a struct or of a case.
pub(crate) enum Shape {
    Unit,
    Tuple(Vec<Type>),
    Named(Vec<Field>),
}

pub(crate) struct Field {
    pub(crate) ident: Ident,
    pub(crate) ty: Type,
    pub(crate) name: LitStr,
    pub(crate) default: bool,
    pub(crate) skip: bool,
}

impl Input {
    pub(crate) fn read(input: DeriveInput) -> syn::Result<Input> {
        let attributes = attributes::of_type(&input.attrs)?;
        let flat = attributes.crate_path.map_or(quote!(::sk_flat), |path| path.into_token_stream());
        let body = match &input.data {
            Data::Struct(data) => Body::Struct(Shape::read(&data.fields)?),
            Data::Enum(data) => {
                let cases = data.variants.iter().map(|case| {
                    let attributes = attributes::of_part(&case.attrs, Part::Case)?;
                    let name = named(&case.ident, attributes.rename);
                    Ok(Case { ident: case.ident.clone(), name, shape: Shape::read(&case.fields)? })
                });
                let cases = cases.collect::<syn::Result<Vec<_>>>()?;
                distinct(cases.iter().map(|case| &case.name))?;
                Body::Enum(cases)
            }
            Data::Union(data) => {
                return Err(syn::Error::new(
                    data.union_token.span,
                    "a union does not know which of its fields is valid, so it cannot become a variant",
                ));
            }
        };
        let ignore_unknown = attributes.ignore_unknown;
        Ok(Input { ident: input.ident, generics: input.generics, flat, ignore_unknown, body })
    }

    /// The generics with `bound` on every type parameter.
    pub(crate) fn bounded(&self, bound: &TokenStream) -> Generics {
        let mut generics = self.generics.clone();
        for parameter in generics.type_params_mut() {
            parameter.bounds.push(parse_quote!(#bound));
        }
        generics
    }
}

impl Shape {
    fn read(fields: &Fields) -> syn::Result<Shape> {
        match fields {
            Fields::Unit => Ok(Shape::Unit),
            Fields::Unnamed(fields) => {
                for field in &fields.unnamed {
                    attributes::of_part(&field.attrs, Part::TupleField)?;
                }
                Ok(Shape::Tuple(fields.unnamed.iter().map(|field| field.ty.clone()).collect()))
            }
            Fields::Named(fields) => {
                let read = fields.named.iter().map(|field| {
                    let attributes = attributes::of_part(&field.attrs, Part::NamedField)?;
                    let Some(ident) = field.ident.clone() else {
                        return Err(syn::Error::new_spanned(field, "a named field has a name"));
                    };
                    let name = named(&ident, attributes.rename);
                    Ok(Field {
                        ident,
                        ty: field.ty.clone(),
                        name,
                        default: attributes.default,
                        skip: attributes.skip,
                    })
                });
                let read = read.collect::<syn::Result<Vec<_>>>()?;
                distinct(read.iter().filter(|field| !field.skip).map(|field| &field.name))?;
                Ok(Shape::Named(read))
            }
        }
    }

    /// The pattern behind the type's or the case's name that binds what is written.
    pub(crate) fn pattern(&self) -> TokenStream {
        match self {
            Shape::Unit => quote!(),
            Shape::Tuple(types) => {
                let bound = (0..types.len()).map(binding);
                quote!((#(#bound),*))
            }
            Shape::Named(fields) => {
                let bound = fields.iter().enumerate().map(|(index, Field { ident, skip, .. })| {
                    let binding = binding(index);
                    if *skip { quote!(#ident: _) } else { quote!(#ident: #binding) }
                });
                quote!({ #(#bound),* })
            }
        }
    }
}

/// The variable that holds the field with this number: it cannot meet a name of the user's.
pub(crate) fn binding(index: usize) -> Ident {
    format_ident!("__field_{index}", span = Span::mixed_site())
}

fn named(ident: &Ident, rename: Option<LitStr>) -> LitStr {
    rename.unwrap_or_else(|| LitStr::new(&ident.unraw().to_string(), ident.span()))
}

fn distinct<'a>(names: impl Iterator<Item = &'a LitStr>) -> syn::Result<()> {
    let mut seen = std::collections::BTreeSet::new();
    for name in names {
        if !seen.insert(name.value()) {
            return Err(syn::Error::new(name.span(), format!("the name {:?} is taken", name.value())));
        }
    }
    Ok(())
}
