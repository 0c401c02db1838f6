//! A bounded number of seeds of the network in a box.
//!
//! They are the same at each run of the gate, so that a failure is the change's. The endless search is
//! `cargo xtask sim --forever`.

use super::Gate;
use crate::process::{self, Failure};
use crate::sim;

/// More seeds than can be run in the time.
const SEEDS_MAX: &str = "1000000";

/// Runs seeds for the time asked for.
pub(super) fn short_run(gate: &mut Gate<'_>) -> Result<String, Failure> {
    if gate.options.quick {
        return Ok("left out by --quick".into());
    }
    let mut command = sim::program(&gate.workspace, false)?;
    command.args(["--seeds", SEEDS_MAX, "--jobs", &sim::cores().to_string()]);
    command.args(["--seconds", &gate.options.sim_seconds.to_string()]);
    let lines = process::run_and_listen(&mut command)?;
    gate.passed += 1;
    Ok(lines.last().cloned().unwrap_or_default())
}
