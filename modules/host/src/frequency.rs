//! How fast the cores are clocked: `cpufreq` in sysfs, or else `/proc/cpuinfo`.

use crate::counter::number;
use crate::cpu::CORES_MAX;
use crate::{About, Kernel, Part, Sense, SenseError};
use sk_flat::{Instant, SkVariant};
use std::time::Duration;

const FOLDER: &str = "sys/devices/system/cpu";
const FILE: &str = "proc/cpuinfo";

/// The reader of the clock frequencies.
///
/// It is apart from [`Cpu`](crate::Cpu) because it costs more: some kernels interrupt every core to learn how
/// fast it is.
#[derive(Debug, Default)]
pub struct Frequency {
    buffer: Vec<u8>,
}

/// The clock frequencies in hertz.
#[derive(Clone, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct FrequencyReading {
    /// By the number of the core; `None` for a core that is off or does not say.
    pub cores: Vec<Option<f64>>,
}

impl Sense for Frequency {
    type Reading = FrequencyReading;

    const ABOUT: About = About {
        name: "frequency",
        doc: "How fast the cores are clocked",
        period: Duration::from_secs(5),
        parts: &[Part { key: "cores.[]", unit: "Hz", doc: "per core number, null if it does not say" }],
    };

    fn read(&mut self, kernel: &Kernel, _now: Instant) -> Result<Option<FrequencyReading>, SenseError> {
        let mut cores = self.sysfs(kernel)?;
        // Virtual machines mostly have no cpufreq, and ARM machines no frequency in cpuinfo.
        if cores.is_empty() && kernel.has(FILE) {
            cores = parse_cpuinfo(&kernel.read(FILE, &mut self.buffer)?);
        }
        Ok((!cores.is_empty()).then_some(FrequencyReading { cores }))
    }

    fn is_present(&self, kernel: &Kernel) -> bool {
        Frequency::default()
            .read(kernel, Instant::ZERO)
            .is_ok_and(|reading| reading.is_some())
    }
}

impl Frequency {
    fn sysfs(&mut self, kernel: &Kernel) -> Result<Vec<Option<f64>>, SenseError> {
        let mut cores = Vec::new();
        for name in kernel.list(FOLDER)? {
            let Some(core) = name.strip_prefix("cpu").and_then(|core| core.parse().ok()) else { continue };
            let file = format!("{FOLDER}/{name}/cpufreq/scaling_cur_freq");
            let kilohertz = kernel.word(&file, &mut self.buffer).and_then(|word| number(&word));
            place(&mut cores, core, kilohertz.map(|kilohertz| kilohertz * 1e3));
        }
        Ok(cores)
    }
}

/// Reads the frequencies in hertz, by the number of the core, from the text of `/proc/cpuinfo`. On machines
/// whose cores do not say there are none.
pub fn parse_cpuinfo(text: &str) -> Vec<Option<f64>> {
    let mut cores = Vec::new();
    let mut core = None;
    for (key, value) in text.lines().filter_map(|line| line.split_once(':')) {
        match key.trim() {
            "processor" => core = value.trim().parse().ok(),
            "cpu MHz" => {
                let hertz = number(value.trim()).map(|megahertz| megahertz * 1e6);
                if let Some(core) = core {
                    place(&mut cores, core, hertz);
                }
            }
            _ => {}
        }
    }
    cores
}

/// Puts a frequency at the place of its core, if it is one.
fn place(cores: &mut Vec<Option<f64>>, core: usize, hertz: Option<f64>) {
    let plausible = hertz.filter(|hertz| hertz.is_finite() && *hertz > 0.0);
    if plausible.is_none() || core >= CORES_MAX {
        return;
    }
    if cores.len() <= core {
        cores.resize(core + 1, None);
    }
    cores[core] = plausible;
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn megahertz_become_hertz() {
        let text = "processor\t: 0\nvendor_id\t: GenuineIntel\ncpu MHz\t\t: 2596.122\ncache size\t: 8192 KB\n\n\
                    processor\t: 2\ncpu MHz\t\t: 800.000\n";
        assert_eq!(parse_cpuinfo(text), [Some(2_596_122_000.0), None, Some(800_000_000.0)]);
    }

    #[test]
    fn cores_that_do_not_say_are_left_out() {
        let arm = "processor\t: 0\nBogoMIPS\t: 108.00\nFeatures\t: fp asimd evtstrm\nCPU part\t: 0xd0b\n";
        for text in
            [arm, "", "cpu MHz : 100\n", "processor : 0\ncpu MHz : nan\n", "processor : 9999\ncpu MHz : 1\n"]
        {
            assert!(parse_cpuinfo(text).is_empty(), "{text}");
        }
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "((processor|cpu MHz)\t: [0-9.e-]{0,10}\n){0,6}|\\PC*") {
            prop_assert!(parse_cpuinfo(&text).iter().flatten().all(|hertz| *hertz > 0.0 && hertz.is_finite()));
        }
    }
}
