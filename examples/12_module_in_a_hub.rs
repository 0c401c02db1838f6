//! A hub of one's own with the battery inside, on a thread of its own. `13_module_as_satellite` runs the same module
//! source as a program of its own.
//! xtask: run by `s171_one_module_source_runs_in_a_hub_and_as_a_satellite`

use sk_examples::battery::Battery;
use sk_robot::Hub;
use sk_robot::config::{LoopMode, ThreadSection};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let hub = Hub::builder().no_tcp().module::<Battery>();
    // Without this it would live on the hub's loop; the module sees no difference.
    let hub = hub.change_module("battery", |battery| {
        battery.thread = Some(ThreadSection { mode: LoopMode::SelectIo, interval_us: 5_000 });
    });
    Ok(hub.run()?)
}
