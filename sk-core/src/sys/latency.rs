//! Keeping the processors out of deep sleep.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};

/// While it lives no processor of the machine enters an idle state that takes time to leave, which
/// halves the delay of a wake-up on an idle machine. Dropping it ends the request.
#[derive(Debug)]
pub(crate) struct WakeLatencyHeld {
    // The kernel keeps the request for as long as the device stays open.
    _device: File,
}

impl WakeLatencyHeld {
    /// Asks for a latency of 0 us. Needs the right to write `/dev/cpu_dma_latency` (usually root's), and
    /// costs power.
    pub(crate) fn zero() -> io::Result<WakeLatencyHeld> {
        let mut device = OpenOptions::new().write(true).open("/dev/cpu_dma_latency")?;
        device.write_all(&0_i32.to_ne_bytes())?;
        Ok(WakeLatencyHeld { _device: device })
    }
}
