//! How warm the machine is: the thermal zones and the hardware monitors of sysfs.

use crate::counter::number;
use crate::devices::Named;
use crate::{About, Kernel, Part, Sense, SenseError};
use sk_flat::{Instant, SkVariant};
use std::collections::BTreeMap;
use std::time::Duration;

const ZONES: &str = "sys/class/thermal";
const MONITORS: &str = "sys/class/hwmon";
/// What lies outside is a sensor without a wire, not a temperature.
const PLAUSIBLE_CELSIUS: std::ops::RangeInclusive<f64> = -100.0..=250.0;

/// The reader of the temperatures.
///
/// Most sensors answer at once, but some are asked through a bus, an NVMe disk for one: a reading may then take
/// some milliseconds, and a module with a fast loop reads this sense on a thread of its own.
#[derive(Debug, Default)]
pub struct Temperature {
    buffer: Vec<u8>,
}

/// The temperatures in degrees Celsius.
#[derive(Clone, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct TemperatureReading {
    /// The highest of all.
    pub hottest: f64,
    /// By the name of the sensor: the zone (`x86_pkg_temp`), or the chip and its input (`coretemp/Core 0`). A
    /// name that is there already gets a number behind it (`nvme/Composite #2`). A chip may be seen both ways.
    pub sensors: BTreeMap<String, f64>,
    /// How many sensors found no place, see [`DEVICES_MAX`](crate::DEVICES_MAX).
    pub left_out: u64,
}

impl Sense for Temperature {
    type Reading = TemperatureReading;

    const ABOUT: About = About {
        name: "temperature",
        doc: "How warm the parts of the machine are",
        period: Duration::from_secs(2),
        parts: &[
            Part { key: "hottest", unit: "°C", doc: "the highest of all temperatures" },
            Part { key: "sensors.*", unit: "°C", doc: "the temperature of each sensor" },
            Part { key: "left_out", unit: "1", doc: "sensors that found no place in the reading" },
        ],
    };

    fn read(&mut self, kernel: &Kernel, _now: Instant) -> Result<Option<TemperatureReading>, SenseError> {
        let mut found = Vec::new();
        self.zones(kernel, &mut found)?;
        self.monitors(kernel, &mut found)?;
        number_twins(&mut found);
        let Named { devices: sensors, left_out } = Named::of(found.into_iter());
        let hottest = sensors.values().copied().reduce(f64::max);
        Ok(hottest.map(|hottest| TemperatureReading { hottest, sensors, left_out }))
    }

    fn is_present(&self, kernel: &Kernel) -> bool {
        Temperature::default()
            .read(kernel, Instant::ZERO)
            .is_ok_and(|reading| reading.is_some())
    }
}

impl Temperature {
    fn zones(&mut self, kernel: &Kernel, found: &mut Vec<(String, f64)>) -> Result<(), SenseError> {
        for zone in kernel.list(ZONES)? {
            if zone.starts_with("thermal_zone")
                && let Some(celsius) = self.celsius(kernel, &format!("{ZONES}/{zone}/temp"))
            {
                let kind = kernel.word(&format!("{ZONES}/{zone}/type"), &mut self.buffer);
                found.push((kind.map_or(zone, |kind| kind.into_owned()), celsius));
            }
        }
        Ok(())
    }

    fn monitors(&mut self, kernel: &Kernel, found: &mut Vec<(String, f64)>) -> Result<(), SenseError> {
        for monitor in kernel.list(MONITORS)? {
            let folder = format!("{MONITORS}/{monitor}");
            let chip = kernel.word(&format!("{folder}/name"), &mut self.buffer);
            let chip = chip.map_or(monitor, |chip| chip.into_owned());
            for file in kernel.list(&folder)? {
                let Some(input) = file.strip_suffix("_input").filter(|input| input.starts_with("temp"))
                else {
                    continue;
                };
                if let Some(celsius) = self.celsius(kernel, &format!("{folder}/{file}")) {
                    let label = kernel.word(&format!("{folder}/{input}_label"), &mut self.buffer);
                    found.push((format!("{chip}/{}", label.as_deref().unwrap_or(input)), celsius));
                }
            }
        }
        Ok(())
    }

    fn celsius(&mut self, kernel: &Kernel, file: &str) -> Option<f64> {
        parse_temperature(&kernel.word(file, &mut self.buffer)?)
    }
}

/// Reads a temperature in thousandths of a degree, as degrees; `None` if no part of a machine can be so warm.
pub fn parse_temperature(text: &str) -> Option<f64> {
    let celsius = number(text.trim())? / 1000.0;
    PLAUSIBLE_CELSIUS.contains(&celsius).then_some(celsius)
}

/// Puts a number behind every name that stands in the list already.
fn number_twins(found: &mut [(String, f64)]) {
    let mut counts: BTreeMap<String, u32> = BTreeMap::new();
    for (name, _) in found {
        let count = counts.entry(name.clone()).or_default();
        *count += 1;
        if *count > 1 {
            name.push_str(&format!(" #{count}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn thousandths_become_degrees() {
        assert_eq!(parse_temperature("45850\n"), Some(45.85));
        assert_eq!(parse_temperature("-5000"), Some(-5.0));
        for text in ["", "x", "-273200", "2147483647", "nan", "1e300"] {
            assert_eq!(parse_temperature(text), None, "{text}");
        }
    }

    #[test]
    fn twins_are_numbered() {
        let mut found = ["nvme", "acpitz", "nvme", "nvme"].map(|name| (name.to_owned(), 1.0));
        number_twins(&mut found);
        assert_eq!(found.map(|(name, _)| name), ["nvme", "acpitz", "nvme #2", "nvme #3"]);
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "[-+0-9.e]{0,24}|\\PC*") {
            prop_assert!(parse_temperature(&text).is_none_or(|celsius| celsius.is_finite()));
        }
    }
}
