//! Modules: what lives inside a hub, is told what to do by declared parameters, and is kept running.

mod parameter_type;
mod parameters;
mod parameters_macro;

pub use parameter_type::ParameterType;
pub use parameters::{ParameterError, ParameterInfo, Parameters};
#[doc(hidden)]
pub use parameters::{checked, plain_name};
