//! `FromVariant` and `TryFrom<SkVariant> for T`.

use crate::input::{Body, Case, Input, Shape};
use proc_macro2::TokenStream;
use quote::quote;

pub(crate) fn implement(input: &Input) -> TokenStream {
    let Input { ident, flat, .. } = input;
    let generics = input.bounded(&quote!(#flat::FromVariant));
    let (parameters, arguments, conditions) = generics.split_for_impl();
    let body = match &input.body {
        Body::Struct(shape) => read(shape, &quote!(Self), input),
        Body::Enum(cases) => read_case(cases, input),
    };
    let result = |error: TokenStream| quote!(::core::result::Result<Self, #error>);
    let (result, own_result) = (result(quote!(#flat::VariantError)), result(quote!(Self::Error)));
    let twins = [quote!(#flat::SkVariant), quote!(&#flat::SkVariant)].map(|source| {
        let borrowed = if source.to_string().starts_with('&') { quote!(value) } else { quote!(&value) };
        quote! {
            #[automatically_derived]
            impl #parameters ::core::convert::TryFrom<#source> for #ident #arguments #conditions {
                type Error = #flat::VariantError;
                fn try_from(value: #source) -> #own_result {
                    #flat::FromVariant::from_variant(#borrowed)
                }
            }
        }
    });
    quote! {
        #[automatically_derived]
        impl #parameters #flat::FromVariant for #ident #arguments #conditions {
            fn from_variant(value: &#flat::SkVariant) -> #result {
                #body
            }
        }
        #(#twins)*
    }
}

fn read_case(cases: &[Case], input: &Input) -> TokenStream {
    let flat = &input.flat;
    let names = cases.iter().map(|case| &case.name);
    let arms = cases.iter().map(|case| {
        let Case { ident, name, shape } = case;
        let constructor = quote!(Self::#ident);
        if let Shape::Unit = shape {
            return quote!(#name => case.without_data().map(|()| #constructor),);
        }
        let read = read(shape, &constructor, input);
        quote!(#name => case.with_data(|value| { #read }),)
    });
    quote! {
        const CASES: &[&str] = &[#(#names),*];
        let case = #flat::derived::Case::of(value)?;
        match case.name() {
            #(#arms)*
            _ => ::core::result::Result::Err(case.unknown(CASES)),
        }
    }
}

/// An expression of type `Result<Self, VariantError>` that reads `value`.
fn read(shape: &Shape, constructor: &TokenStream, input: &Input) -> TokenStream {
    let flat = &input.flat;
    let ok = |made: TokenStream| quote!(::core::result::Result::Ok(#made));
    match shape {
        Shape::Unit => {
            let made = ok(quote!(#constructor));
            quote!(<() as #flat::FromVariant>::from_variant(value)?; #made)
        }
        Shape::Tuple(types) => match &types[..] {
            [] => {
                let made = ok(quote!(#constructor()));
                quote!(<() as #flat::FromVariant>::from_variant(value)?; #made)
            }
            [only] => ok(quote!(#constructor(<#only as #flat::FromVariant>::from_variant(value)?))),
            several => {
                let count = several.len();
                let items = several.iter().enumerate();
                let items = items.map(|(index, ty)| quote!(items.read::<#ty>(#index)?));
                let made = ok(quote!(#constructor(#(#items),*)));
                quote!(let items = #flat::derived::Items::of(value, #count)?; #made)
            }
        },
        Shape::Named(fields) => {
            let names: Vec<_> = fields.iter().filter(|field| !field.skip).map(|field| &field.name).collect();
            let opener = if input.ignore_unknown { quote!(open) } else { quote!(of) };
            let members = fields.iter().map(|field| {
                let (ident, ty, name) = (&field.ident, &field.ty, &field.name);
                let value = match (field.skip, field.default) {
                    (true, _) => quote!(::core::default::Default::default()),
                    (false, true) => quote!(fields.read_or_default::<#ty>(#name)?),
                    (false, false) => quote!(fields.read::<#ty>(#name)?),
                };
                quote!(#ident: #value)
            });
            let made = ok(quote!(#constructor { #(#members),* }));
            quote! {
                const KNOWN: &[&str] = &[#(#names),*];
                let fields = #flat::derived::Fields::#opener(value, KNOWN)?;
                #made
            }
        }
    }
}
