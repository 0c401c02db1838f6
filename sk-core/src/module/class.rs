//! A kind of module as a value: what a registry lists and a configuration is checked against.

use crate::flow::Flow;
use crate::module::{
    AbstractModule, AnyRunner, ModuleError, ParameterError, ParameterInfo, Parameters, Runner,
};
use sk_flat::SkVariant;

type MakeRunner = fn(&str, Flow, &SkVariant) -> Result<Box<dyn AnyRunner>, ModuleError>;

/// A class of modules, without its type: `Copy` and `Send`, so that the module itself can be made on another
/// thread.
///
/// ```
/// use sk_core::{module::*, parameters, prelude::*};
///
/// parameters! { pub struct LampParameters { level: u8 = 5, 0..=10, "lm"; } }
/// struct Lamp;
/// object! { Lamp {} }
/// impl AbstractModule for Lamp {
///     const NAME: &'static str = "lamp";
///     type Parameters = LampParameters;
///     type Error = String;
///     fn new(_: &mut Cx, _: Handle<Self>, _: Flow, _: &LampParameters) -> Result<Self, String> { Ok(Lamp) }
///     fn reconfigure(&mut self, _: &mut Cx, _: &LampParameters) -> Result<(), String> { Ok(()) }
/// }
///
/// let class = ModuleClass::of::<Lamp>();
/// assert_eq!((class.name(), class.describe()[0].name), ("lamp", "level"));
/// let refused = class.check_one("level", &11.into()).unwrap_err();
/// assert_eq!(refused.to_string(), "parameter `level` takes u8 in 0..=10 lm, found 11");
/// ```
#[derive(Clone, Copy)]
pub struct ModuleClass {
    name: &'static str,
    describe: fn() -> &'static [ParameterInfo],
    schema: fn() -> SkVariant,
    complete: fn(&SkVariant) -> Result<SkVariant, ParameterError>,
    check_one: fn(&str, &SkVariant) -> Result<(), ParameterError>,
    runner: MakeRunner,
}

impl ModuleClass {
    /// That of `M`.
    pub fn of<M: AbstractModule>() -> ModuleClass {
        ModuleClass {
            name: M::NAME,
            describe: M::Parameters::describe,
            schema: M::Parameters::schema,
            complete: |values| Ok(M::Parameters::from_variant(values)?.to_variant()),
            check_one: |name, value| M::Parameters::default().set(name, value),
            runner: |name, flow, values| Ok(Runner::<M>::configured(flow, values)?.named(name).into()),
        }
    }

    /// What a module of the class is called where nobody says otherwise.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// What it can be told.
    pub fn describe(&self) -> &'static [ParameterInfo] {
        (self.describe)()
    }

    /// The JSON Schema of its parameters.
    pub fn schema(&self) -> SkVariant {
        (self.schema)()
    }

    /// All parameters: those of the map, and the defaults of those it lacks.
    ///
    /// # Errors
    /// A parameter is unknown, of another type or out of range.
    pub fn complete(&self, values: &SkVariant) -> Result<SkVariant, ParameterError> {
        (self.complete)(values)
    }

    /// Checks one parameter against its declaration.
    ///
    /// # Errors
    /// It is unknown, of another type or out of range.
    pub fn check_one(&self, name: &str, value: &SkVariant) -> Result<(), ParameterError> {
        (self.check_one)(name, value)
    }

    /// A runner for a module of this class under that name.
    ///
    /// # Errors
    /// A parameter is unknown, of another type or out of range.
    pub fn runner(
        &self,
        name: &str,
        flow: Flow,
        parameters: &SkVariant,
    ) -> Result<Box<dyn AnyRunner>, ModuleError> {
        (self.runner)(name, flow, parameters)
    }
}

impl std::fmt::Debug for ModuleClass {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "ModuleClass({})", self.name)
    }
}
