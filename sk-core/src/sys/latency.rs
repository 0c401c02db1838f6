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

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::fd::AsRawFd;

    #[test]
    fn the_device_is_held_until_the_drop() {
        match WakeLatencyHeld::zero() {
            Ok(held) => {
                let open = format!("/proc/self/fd/{}", held._device.as_raw_fd());
                assert_eq!(std::fs::read_link(open).unwrap().to_str(), Some("/dev/cpu_dma_latency"));
            }
            // A container need not have the device at all.
            Err(refused) => assert!(matches!(
                refused.kind(),
                io::ErrorKind::PermissionDenied | io::ErrorKind::NotFound | io::ErrorKind::ReadOnlyFilesystem
            )),
        }
    }
}
