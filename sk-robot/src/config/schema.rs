//! The JSON Schema of a configuration, for editors and for whoever writes one by program.

use super::{HubSection, ListenSection, LoopSection, ModuleSection, RestartSection, ThreadSection};
use sk_core::module::{ModuleClass, Parameters};
use sk_core::prelude::*;

/// The schema for a hub with these modules. It is made from the declarations that the file is checked against.
pub fn schema(classes: &[ModuleClass]) -> SkVariant {
    let modules = classes.iter().map(|class| (class.name(), module(class)));
    let modules = object("The modules, by name.", SkVariant::map(modules));
    let mut whole = with::<HubSection>(
        "The configuration of skrobot. Everything has a default.",
        [
            ("$schema", SkVariant::map([("type", "string".into())])),
            ("listen", with::<ListenSection>("Where the hub listens.", [])),
            ("loop", with::<LoopSection>("How the hub's own loop keeps time.", [])),
            ("modules", modules),
        ],
    );
    if let Some(whole) = whole.as_map_mut() {
        whole.insert("$schema".to_owned(), "https://json-schema.org/draft/2020-12/schema".into());
        whole.insert("title".to_owned(), "skrobot".into());
    }
    whole
}

fn module(class: &ModuleClass) -> SkVariant {
    let mut parameters = class.schema();
    describe(&mut parameters, "What the module can be told.");
    let thread = with::<ThreadSection>("", []);
    let nothing = SkVariant::map([("type", "null".into())]);
    let thread = SkVariant::map([
        ("anyOf", SkVariant::list([thread, nothing])),
        ("default", SkVariant::Null),
        ("description", "A thread of the module's own; null is the hub's loop.".into()),
    ]);
    with::<ModuleSection>(
        &format!("The module {}.", class.name()),
        [
            ("thread", thread),
            ("restart", with::<RestartSection>("What follows a failure.", [])),
            ("parameters", parameters),
        ],
    )
}

/// A declared section with further entries.
fn with<P: Parameters>(
    description: &str,
    further: impl IntoIterator<Item = (&'static str, SkVariant)>,
) -> SkVariant {
    let mut section = P::schema();
    describe(&mut section, description);
    let properties = section.as_map_mut().and_then(|section| section.get_mut("properties"));
    if let Some(properties) = properties.and_then(SkVariant::as_map_mut) {
        properties.extend(further.into_iter().map(|(name, schema)| (name.to_owned(), schema)));
    }
    section
}

fn object(description: &str, properties: SkVariant) -> SkVariant {
    let mut object = SkVariant::map([
        ("type", "object".into()),
        ("additionalProperties", false.into()),
        ("properties", properties),
    ]);
    describe(&mut object, description);
    object
}

fn describe(schema: &mut SkVariant, description: &str) {
    if let Some(schema) = schema.as_map_mut().filter(|_| !description.is_empty()) {
        schema.insert("description".to_owned(), description.into());
    }
}
