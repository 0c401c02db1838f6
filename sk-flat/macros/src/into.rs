//! `IntoVariant` and `From<T> for SkVariant`.

use crate::input::{Body, Case, Input, Shape, binding};
use proc_macro2::TokenStream;
use quote::quote;
use syn::Type;

pub(crate) fn implement(input: &Input) -> TokenStream {
    let Input { ident, flat, .. } = input;
    let generics = input.bounded(&quote!(#flat::IntoVariant));
    let (parameters, arguments, conditions) = generics.split_for_impl();
    let body = match &input.body {
        Body::Struct(shape) => {
            let (pattern, value) = (shape.pattern(), value(shape, flat));
            quote! {
                let Self #pattern = self;
                #value
            }
        }
        Body::Enum(cases) if cases.is_empty() => quote!(match self {}),
        Body::Enum(cases) => {
            let arms = cases.iter().map(|case| arm(case, flat));
            quote!(match self { #(#arms)* })
        }
    };
    quote! {
        #[automatically_derived]
        impl #parameters #flat::IntoVariant for #ident #arguments #conditions {
            fn into_variant(self) -> #flat::SkVariant {
                #body
            }
        }

        #[automatically_derived]
        impl #parameters ::core::convert::From<#ident #arguments> for #flat::SkVariant #conditions {
            fn from(value: #ident #arguments) -> #flat::SkVariant {
                #flat::IntoVariant::into_variant(value)
            }
        }
    }
}

fn arm(case: &Case, flat: &TokenStream) -> TokenStream {
    let Case { ident, name, shape } = case;
    let (pattern, value) = (shape.pattern(), value(shape, flat));
    match shape {
        Shape::Unit => quote!(Self::#ident => #flat::IntoVariant::into_variant(#name),),
        _ => quote!(Self::#ident #pattern => #flat::derived::case(#name, #value),),
    }
}

/// The bound fields as one variant.
fn value(shape: &Shape, flat: &TokenStream) -> TokenStream {
    // The type is written out so that the message for one that is no variant points at it.
    let converted = |index: usize, ty: &Type| {
        let binding = binding(index);
        quote!(<#ty as #flat::IntoVariant>::into_variant(#binding))
    };
    match shape {
        Shape::Unit => quote!(#flat::SkVariant::Null),
        Shape::Tuple(types) => match &types[..] {
            [] => quote!(#flat::SkVariant::Null),
            [only] => converted(0, only),
            several => {
                let items = several.iter().enumerate().map(|(index, ty)| converted(index, ty));
                quote!(#flat::SkVariant::list::<#flat::SkVariant>([#(#items),*]))
            }
        },
        Shape::Named(fields) => {
            let written = fields.iter().enumerate().filter(|(_, field)| !field.skip);
            let entries = written.map(|(index, field)| {
                let (name, value) = (&field.name, converted(index, &field.ty));
                quote!((#name, #value))
            });
            quote!(#flat::SkVariant::map::<&str>([#(#entries),*]))
        }
    }
}
