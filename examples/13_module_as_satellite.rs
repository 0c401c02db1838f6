//! The battery as a satellite of a hub that runs already. `12_module_in_a_hub` has the same module source inside.
//! xtask: run by `s171_one_module_source_runs_in_a_hub_and_as_a_satellite`

use sk_core::SkFlowSat;
use sk_examples::battery::Battery;
use sk_robot::places::Places;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let hub = Places::find(None)?.address();
    Ok(SkFlowSat::run::<Battery>(&hub.to_string())?)
}
