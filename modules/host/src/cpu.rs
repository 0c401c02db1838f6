//! How busy the processor is: the ticks of `/proc/stat`.

use crate::{About, Kernel, Part, Sense, SenseError};
use sk_flat::{Instant, SkVariant};
use std::time::Duration;

const FILE: &str = "proc/stat";

/// Cores with a number from here on are left out: Linux itself knows no more than 8192.
pub const CORES_MAX: usize = 8192;

/// The reader of the processor's load.
#[derive(Debug, Default)]
pub struct Cpu {
    buffer: Vec<u8>,
    previous: Option<CpuTicks>,
}

/// Shares of the time since the previous reading, each 0 to 1.
#[derive(Clone, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct CpuReading {
    /// Doing anything, all cores together; 1 means that all of them were busy all the time.
    pub busy: f64,
    /// Running programs, the nice ones and virtual machines included.
    pub user: f64,
    /// Running the kernel, interrupts included.
    pub system: f64,
    /// Idle while a disk was waited for.
    pub waiting: f64,
    /// Taken by the host of this virtual machine.
    pub stolen: f64,
    /// Doing anything, by the number of the core; `None` for a core that is off, or was.
    pub cores: Vec<Option<f64>>,
}

/// Where the time went since the start, counted in ticks of usually 10 ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Ticks {
    user: u64,
    system: u64,
    idle: u64,
    waiting: u64,
    stolen: u64,
}

/// The ticks of all cores together and of each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CpuTicks {
    all: Ticks,
    cores: Vec<Option<Ticks>>,
}

impl Sense for Cpu {
    type Reading = CpuReading;

    const ABOUT: About = About {
        name: "cpu",
        doc: "How busy the processor was since the previous reading, in all and per core",
        period: Duration::from_secs(1),
        parts: &[
            Part { key: "busy", unit: "1", doc: "the busy share of all cores together, 0 to 1" },
            Part { key: "user", unit: "1", doc: "the share spent in programs" },
            Part { key: "system", unit: "1", doc: "the share spent in the kernel" },
            Part { key: "waiting", unit: "1", doc: "the share idle while a disk was waited for" },
            Part { key: "stolen", unit: "1", doc: "the share taken by the host of a virtual machine" },
            Part { key: "cores.[]", unit: "1", doc: "the busy share per core number, null if it was off" },
        ],
    };

    fn read(&mut self, kernel: &Kernel, _now: Instant) -> Result<Option<CpuReading>, SenseError> {
        let text = kernel.read(FILE, &mut self.buffer)?;
        let present = parse_cpu(&text).ok_or_else(|| kernel.malformed(FILE, "line `cpu`"))?;
        // Within one tick nothing is spent, so two readings at once give none and lose nothing.
        let reading = self.previous.as_ref().and_then(|previous| present.since(previous));
        self.previous = Some(present);
        Ok(reading)
    }

    fn forget(&mut self) {
        self.previous = None;
    }

    fn is_present(&self, kernel: &Kernel) -> bool {
        kernel.has(FILE)
    }
}

impl CpuTicks {
    /// The shares of the time between two readings; `None` if no tick passed.
    pub fn since(&self, earlier: &CpuTicks) -> Option<CpuReading> {
        let spent = self.all.since(earlier.all);
        let total = spent.total();
        let share = |ticks: u64| ticks as f64 / total as f64;
        let core = |(number, ticks): (usize, &Option<Ticks>)| {
            let before = earlier.cores.get(number).copied().flatten()?;
            ticks.as_ref()?.since(before).busy_share()
        };
        Some(CpuReading {
            busy: spent.busy_share()?,
            user: share(spent.user),
            system: share(spent.system),
            waiting: share(spent.waiting),
            stolen: share(spent.stolen),
            cores: self.cores.iter().enumerate().map(core).collect(),
        })
    }
}

impl Ticks {
    /// What was spent between two readings. The kernel corrects its idle times now and then, so single
    /// counters can go backwards a little; that counts as nothing.
    fn since(self, earlier: Ticks) -> Ticks {
        Ticks {
            user: self.user.saturating_sub(earlier.user),
            system: self.system.saturating_sub(earlier.system),
            idle: self.idle.saturating_sub(earlier.idle),
            waiting: self.waiting.saturating_sub(earlier.waiting),
            stolen: self.stolen.saturating_sub(earlier.stolen),
        }
    }

    fn busy(self) -> u64 {
        self.user.saturating_add(self.system).saturating_add(self.stolen)
    }

    fn total(self) -> u64 {
        self.busy().saturating_add(self.idle).saturating_add(self.waiting)
    }

    fn busy_share(self) -> Option<f64> {
        let total = self.total();
        (total > 0).then(|| self.busy() as f64 / total as f64)
    }
}

/// Reads the lines `cpu …` and `cpu0 …` at the head of `/proc/stat`; `None` without the first, which stands for
/// all cores together. Other lines are skipped, and so are cores that no kernel can have.
pub fn parse_cpu(text: &str) -> Option<CpuTicks> {
    let mut all = None;
    let mut cores = Vec::new();
    for line in text.lines().take_while(|line| line.starts_with("cpu")) {
        let Some((name, ticks)) = parse_line(line) else { continue };
        if name.is_empty() {
            all = Some(ticks);
        } else if let Some(number) = name.parse::<usize>().ok().filter(|number| *number < CORES_MAX) {
            if cores.len() <= number {
                cores.resize(number + 1, None);
            }
            cores[number] = Some(ticks);
        }
    }
    Some(CpuTicks { all: all?, cores })
}

/// The number of the core, as text, and its ticks: user, nice, system and idle at least. Linux 2.6 and later
/// add waiting, interrupts, soft interrupts and stolen; what follows is contained in the first two.
fn parse_line(line: &str) -> Option<(&str, Ticks)> {
    let mut words = line.strip_prefix("cpu")?.split(' ');
    let name = words.next()?;
    let mut numbers = words.filter(|word| !word.is_empty()).map(|word| word.parse::<u64>().ok());
    let mut must = || numbers.next().flatten();
    let (user, nice, system, idle) = (must()?, must()?, must()?, must()?);
    let mut may = || must().unwrap_or(0);
    let (waiting, interrupts, soft, stolen) = (may(), may(), may(), may());
    let ticks = Ticks {
        user: user.saturating_add(nice),
        system: system.saturating_add(interrupts).saturating_add(soft),
        idle,
        waiting,
        stolen,
    };
    Some((name, ticks))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Captured on Linux 6.18 with two cores, shortened.
    const EARLIER: &str = "cpu  116149 0 25349 492189 2381 0 292 707 0 0\n\
                           cpu0 51185 0 11609 254868 488 0 44 360 0 0\n\
                           cpu1 64963 0 13739 237321 1893 0 248 346 0 0\n\
                           intr 1039333 0 0 1 1 14\nctxt 1631705\nbtime 1795323804\n";
    /// The same with 200 ticks added by hand, half of them on each core.
    const LATER: &str = "cpu  116199 0 25359 492319 2391 0 292 707 0 0\n\
                         cpu0 51235 0 11619 254898 498 0 44 360 0 0\n\
                         cpu1 64963 0 13739 237421 1893 0 248 346 0 0\n\
                         intr 1039333 0 0 1 1 14\n";
    /// Written by hand in the format of Linux 2.4, which knew four counters only.
    const OLD: &str = "cpu  1000 20 300 4000\ncpu0 1000 20 300 4000\npage 5 6\n";

    #[test]
    fn shares_are_those_of_the_time_between() {
        let reading = parse_cpu(LATER).unwrap().since(&parse_cpu(EARLIER).unwrap()).unwrap();
        assert_eq!((reading.busy, reading.user, reading.system), (0.3, 0.25, 0.05));
        assert_eq!((reading.waiting, reading.stolen), (0.05, 0.0));
        assert_eq!(reading.cores, [Some(0.6), Some(0.0)]);
    }

    #[test]
    fn an_old_kernel_is_read() {
        let reading = parse_cpu(OLD).unwrap().since(&CpuTicks::default()).unwrap();
        assert_eq!((reading.user, reading.cores), (1020.0 / 5320.0, vec![None]));
    }

    #[test]
    fn a_core_that_was_off_has_no_share() {
        let with_two_off = "cpu  10 0 0 10\ncpu0 5 0 0 5\ncpu3 5 0 0 5\n";
        let later = parse_cpu("cpu  20 0 0 20\ncpu0 15 0 0 5\ncpu1 5 0 0 5\ncpu3 5 0 0 15\n").unwrap();
        let reading = later.since(&parse_cpu(with_two_off).unwrap()).unwrap();
        assert_eq!(reading.cores, [Some(1.0), None, None, Some(0.0)]);
    }

    #[test]
    fn a_counter_that_goes_backwards_counts_as_nothing() {
        let earlier = parse_cpu("cpu  10 0 10 100 50 0 0 0\n").unwrap();
        let reading = parse_cpu("cpu  20 0 10 110 40 0 0 0\n").unwrap().since(&earlier).unwrap();
        assert_eq!((reading.busy, reading.waiting), (0.5, 0.0));
        assert_eq!(earlier.since(&earlier), None);
    }

    #[test]
    fn nonsense_is_left_out() {
        for text in ["", "cpu", "cpu 1 2 3", "cpu  1 2 x 4", "intr 1\ncpu  1 2 3 4\n", "cpu0 1 2 3 4\n"] {
            assert_eq!(parse_cpu(text), None, "{text}");
        }
        let text = "cpu  1 2 3 4\ncpu99999999 1 2 3 4\ncpu8192 1 2 3 4\ncpux 1 2 3 4\ncpu1 1 2\n";
        assert!(parse_cpu(text).unwrap().cores.is_empty());
    }

    proptest! {
        #[test]
        fn no_text_panics(texts in prop::array::uniform2("(cpu[0-9]{0,4}( {1,2}[0-9]{1,20}){3,11}\n){0,4}\\PC{0,9}")) {
            if let (Some(earlier), Some(later)) = (parse_cpu(&texts[0]), parse_cpu(&texts[1]))
                && let Some(reading) = later.since(&earlier)
            {
                prop_assert!((0.0..=1.0).contains(&reading.busy));
                prop_assert!(reading.cores.iter().flatten().all(|busy| (0.0..=1.0).contains(busy)));
            }
        }
    }
}
