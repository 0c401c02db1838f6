//! What is read from and written to the disks: `/proc/diskstats`.

use crate::counter::{gained, rate};
use crate::devices::Counters;
use crate::{About, Kernel, Part, Sense, SenseError};
use sk_flat::{Instant, SkVariant};
use std::collections::BTreeMap;
use std::time::Duration;

const FILE: &str = "proc/diskstats";
/// The folder that has an entry for each whole device and none for partitions.
const FOLDER: &str = "sys/block";
/// The kernel counts in sectors of this size, whatever the disk's own are.
const SECTOR_BYTES: f64 = 512.0;

/// The reader of the disks.
#[derive(Debug, Default)]
pub struct Disk {
    buffer: Vec<u8>,
    previous: Counters<DiskCounters>,
}

/// What went to and from the disks since the previous reading.
#[derive(Clone, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct DiskReading {
    /// By the name of the device; a slash in it is an exclamation mark. A volume made of disks (`dm-0`, `md0`)
    /// stands beside them, so sums count its bytes twice. A device that appeared since the previous reading is
    /// missing this time, one that was never used always.
    pub disks: BTreeMap<String, DiskRates>,
    /// How many disks found no place, see [`DEVICES_MAX`](crate::DEVICES_MAX).
    pub left_out: u64,
}

/// What went to and from one disk, per second.
#[derive(Clone, Copy, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct DiskRates {
    /// Bytes read per second.
    pub read_bytes: f64,
    /// Reads completed per second.
    pub reads: f64,
    /// Bytes written per second.
    pub written_bytes: f64,
    /// Writes completed per second.
    pub writes: f64,
    /// The share of the time in which the disk had something to do, 0 to 1.
    pub busy: f64,
}

/// What a disk counted since it appeared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DiskCounters {
    /// Reads completed.
    pub reads: u64,
    /// Sectors of 512 bytes read.
    pub read_sectors: u64,
    /// Writes completed.
    pub writes: u64,
    /// Sectors of 512 bytes written.
    pub written_sectors: u64,
    /// Milliseconds in which there was something to do.
    pub busy_ms: u64,
}

impl Sense for Disk {
    type Reading = DiskReading;

    const ABOUT: About = About {
        name: "disk",
        doc: "What is read from and written to each disk",
        period: Duration::from_secs(1),
        parts: &[
            Part { key: "disks.*.read_bytes", unit: "B/s", doc: "bytes read" },
            Part { key: "disks.*.reads", unit: "1/s", doc: "reads completed" },
            Part { key: "disks.*.written_bytes", unit: "B/s", doc: "bytes written" },
            Part { key: "disks.*.writes", unit: "1/s", doc: "writes completed" },
            Part { key: "disks.*.busy", unit: "1", doc: "the share of time with something to do, 0 to 1" },
            Part { key: "left_out", unit: "1", doc: "disks that found no place in the reading" },
        ],
    };

    fn read(&mut self, kernel: &Kernel, now: Instant) -> Result<Option<DiskReading>, SenseError> {
        let mut present = parse_disk(&kernel.read(FILE, &mut self.buffer)?);
        let whole = kernel.list(FOLDER)?;
        present.retain(|name, _| is_whole_disk(name, &whole));
        let rates = self.previous.rates(now, present, DiskCounters::rates);
        Ok(rates.map(|rates| DiskReading { disks: rates.devices, left_out: rates.left_out }))
    }

    fn forget(&mut self) {
        self.previous.forget();
    }

    fn is_present(&self, kernel: &Kernel) -> bool {
        kernel.has(FILE)
    }
}

impl DiskCounters {
    fn rates(&self, now: &DiskCounters, span: Duration) -> Option<DiskRates> {
        // Linux keeps many devices ready that nobody uses: empty drives, sixteen network block devices.
        if now.reads == 0 && now.writes == 0 {
            return None;
        }
        let busy_ms = gained(self.busy_ms, now.busy_ms)? as f64;
        Some(DiskRates {
            read_bytes: rate(self.read_sectors, now.read_sectors, span)? * SECTOR_BYTES,
            reads: rate(self.reads, now.reads, span)?,
            written_bytes: rate(self.written_sectors, now.written_sectors, span)? * SECTOR_BYTES,
            writes: rate(self.writes, now.writes, span)?,
            busy: (busy_ms / 1e3 / span.as_secs_f64()).clamp(0.0, 1.0),
        })
    }
}

/// Reads the text of `/proc/diskstats`, partitions included. Lines without all counters are skipped; kernels
/// before 2.6.25 wrote such lines for partitions.
pub fn parse_disk(text: &str) -> BTreeMap<String, DiskCounters> {
    text.lines().filter_map(parse_line).collect()
}

/// A device and its counters, from `major minor name` and ten numbers or more.
fn parse_line(line: &str) -> Option<(String, DiskCounters)> {
    let mut words = line.split_ascii_whitespace();
    // In sysfs a slash in the name is an exclamation mark.
    let name = words.nth(2)?.replace('/', "!");
    let mut numbers = words.map(|word| word.parse::<u64>().ok());
    let counters = DiskCounters {
        reads: numbers.next()??,
        // Past the merged reads.
        read_sectors: numbers.nth(1)??,
        // Past the milliseconds of the reads.
        writes: numbers.nth(1)??,
        written_sectors: numbers.nth(1)??,
        // Past the milliseconds of the writes and what is in flight.
        busy_ms: numbers.nth(2)??,
    };
    Some((name, counters))
}

/// Whether a device is a disk as a whole: no partition, no loop over a file and no disk in memory.
///
/// `whole` are the names below `/sys/block`, among which partitions are not. Where that folder is hidden the
/// name alone decides.
pub fn is_whole_disk(name: &str, whole: &[String]) -> bool {
    let family = name.trim_end_matches(|c: char| c.is_ascii_digit());
    if ["loop", "ram", "zram"].contains(&family) {
        return false;
    }
    if !whole.is_empty() {
        return whole.iter().any(|disk| disk == name);
    }
    let numbered = family.len() < name.len();
    let lettered = ["sd", "hd", "vd", "xvd"].iter().any(|kind| family.starts_with(kind));
    // `nvme0n1p2`, `mmcblk0p1`: a disk whose own name ends with a digit has a `p` before the partition.
    let after_digit = family
        .strip_suffix('p')
        .is_some_and(|disk| disk.ends_with(|c: char| c.is_ascii_digit()));
    !(numbered && (lettered || after_digit))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn counters_are_read_from_new_and_old_kernels() {
        // The first line was captured on Linux 6.18. The others are written by hand: the format of 2.6.32, and a
        // device with a slash in its name.
        let text = " 254       0 vda 193055 41840 27000674 335087 35359 65055 15470264 64488 0 39292 404701 31988 75 9186120 4926 3676 199\n   \
                    8       0 sda 10 1 80 4 20 2 160 8 0 12 12\n 104       0 cciss/c0d0 1 2 3 4 5 6 7 8 9 10 11\n";
        let disks = parse_disk(text);
        assert_eq!(disks.keys().collect::<Vec<_>>(), ["cciss!c0d0", "sda", "vda"]);
        let vda = DiskCounters {
            reads: 193_055,
            read_sectors: 27_000_674,
            writes: 35_359,
            written_sectors: 15_470_264,
            busy_ms: 39_292,
        };
        assert_eq!(disks["vda"], vda);
        let slashed = DiskCounters { reads: 1, read_sectors: 3, writes: 5, written_sectors: 7, busy_ms: 10 };
        assert_eq!(disks["cciss!c0d0"], slashed);
    }

    #[test]
    fn sectors_become_bytes_and_time_a_share() {
        let before = DiskCounters { reads: 1, busy_ms: u64::from(u32::MAX) - 99, ..DiskCounters::default() };
        let now = DiskCounters { reads: 5, read_sectors: 16, writes: 2, written_sectors: 4, busy_ms: 900 };
        let rates = before.rates(&now, Duration::from_secs(2)).unwrap();
        assert_eq!((rates.read_bytes, rates.reads), (4096.0, 2.0));
        assert_eq!((rates.written_bytes, rates.writes, rates.busy), (1024.0, 1.0, 0.5));
        assert_eq!(before.rates(&now, Duration::from_millis(10)).unwrap().busy, 1.0);
        assert_eq!(DiskCounters::default().rates(&DiskCounters::default(), Duration::from_secs(1)), None);
        assert_eq!(now.rates(&before, Duration::from_secs(1)), None);
    }

    #[test]
    fn partitions_loops_and_memory_are_no_disks() {
        let whole = ["sda", "nvme0n1", "loop0", "zram0", "dm-0", "xvda1"].map(str::to_owned);
        let asked = ["sda", "sda1", "nvme0n1", "nvme0n1p1", "loop0", "zram0", "dm-0", "ram3", "xvda1"];
        let found: Vec<_> = asked.into_iter().filter(|name| is_whole_disk(name, &whole)).collect();
        assert_eq!(found, ["sda", "nvme0n1", "dm-0", "xvda1"]);
    }

    #[test]
    fn without_sysfs_the_name_decides() {
        let disks =
            ["sda", "sdaa", "nvme0n1", "mmcblk0", "mmcblk0boot0", "dm-0", "md127", "sr0", "nbd3", "9"];
        assert!(disks.iter().all(|name| is_whole_disk(name, &[])));
        let others = ["sda1", "sdaa12", "vdb3", "xvda1", "nvme0n1p1", "mmcblk0p2", "md0p1", "loop7", "ram0"];
        assert!(others.iter().all(|name| !is_whole_disk(name, &[])));
    }

    #[test]
    fn nonsense_is_left_out() {
        // The second line is a partition of an old kernel.
        let text = "8 0 sda 1 2 3 4 5 6 7 8 9\n8 1 sda1 35486 0 35496 38030\n8 0 sda x 2 3 4 5 6 7 8 9 10 11\n\n8 0\n";
        assert_eq!(parse_disk(text), BTreeMap::new());
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "([0-9]{1,3} [0-9]{1,3} \\PC{0,5}( [0-9]{1,21}){3,20}\n){0,4}|\\PC*") {
            for (name, counters) in parse_disk(&text) {
                let _ = is_whole_disk(&name, &[]);
                let rates = DiskCounters::default().rates(&counters, Duration::from_secs(1));
                prop_assert!(rates.is_none_or(|rates| (0.0..=1.0).contains(&rates.busy)));
            }
        }
    }
}
