//! The senses of the machine the hub runs on, read from the files of the Linux kernel.
//!
//! Each sense has a file of its own: a parser of the kernel's text, a reader that keeps the previous counters,
//! and the reading with its keys and units. [`senses`] is the table of all of them. No reader keeps a clock:
//! the present is handed in, so that readings repeat exactly in a simulated world.
//!
//! Files of procfs and sysfs live in the kernel's memory, so reading them never waits for a disk and may happen
//! on a loop. Measured by the example `senses` in a release build on a virtual machine (two shared cores of an
//! AMD EPYC, Linux 6.18, 80 processes, 4 interfaces), a reading costs: uptime 6 µs, memory and cpu 16 µs, network
//! 22 µs, disk 32 µs, frequency 64 µs, load 69 µs. The load grows with the number of processes, the frequency
//! with that of the cores. Temperatures and batteries were not there to be measured; some are asked through a
//! slow bus and take milliseconds.
//!
//! The README of this crate lists the channels, their units and samples.
//!
//! ```
//! use sk_flat::Instant;
//! use sk_host::{Cpu, Kernel, Sense};
//!
//! let (kernel, mut cpu) = (Kernel::default(), Cpu::default());
//! // Shares are those of the time since the previous reading, so the first gives none.
//! assert_eq!(cpu.read(&kernel, Instant::ZERO)?, None);
//! # Ok::<(), sk_host::SenseError>(())
//! ```
#![forbid(unsafe_code)]

mod channel;
mod counter;
mod cpu;
mod devices;
mod disk;
mod error;
mod frequency;
mod host;
mod kernel;
mod load;
mod memory;
mod network;
mod power;
mod pulse;
mod sense;
mod sense_source;
mod temperature;
mod uptime;

pub use channel::HostChannel;
pub use cpu::{CORES_MAX, Cpu, CpuReading, CpuTicks, parse_cpu};
pub use devices::DEVICES_MAX;
pub use disk::{Disk, DiskCounters, DiskRates, DiskReading, is_whole_disk, parse_disk};
pub use error::SenseError;
pub use frequency::{Frequency, FrequencyReading, parse_cpuinfo};
pub use host::{Host, HostParameters};
pub use kernel::{FILE_BYTES_MAX, FOLDER_ENTRIES_MAX, Kernel};
pub use load::{Load, LoadReading, parse_load};
pub use memory::{Memory, MemoryReading, parse_memory};
pub use network::{InterfaceCounters, InterfaceRates, Network, NetworkReading, parse_network};
pub use power::{Power, PowerReading, Supply, parse_supply};
pub use sense::{About, AnySense, Part, Sense, senses};
pub use temperature::{Temperature, TemperatureReading, parse_temperature};
pub use uptime::{Uptime, UptimeReading, parse_uptime};
