//! `cargo xtask schema`: the published JSON Schema of the hub's configuration, made anew from the declarations.

use crate::process::{self, Failure};

/// The test that compares the published schema with the present one, and writes it when it is told to.
const TEST: &str = "the_published_schema_is_the_present_one";

/// Writes `docs/skrobot.schema.json`.
pub(crate) fn run() -> Result<(), Failure> {
    let arguments = ["test", "--quiet", "--package", "skrobot", "--test", "config", "--", "--exact", TEST];
    process::run(process::cargo().args(arguments).env("SK_REWRITE", "1"))
}
