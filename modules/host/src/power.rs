//! Where the power comes from: batteries and mains in `/sys/class/power_supply`.

use crate::counter::number;
use crate::devices::Named;
use crate::{About, Kernel, Part, Sense, SenseError};
use sk_flat::{Instant, SkVariant};
use std::collections::BTreeMap;
use std::time::Duration;

const FOLDER: &str = "sys/class/power_supply";

/// The reader of the power supplies. Like a temperature, a battery may be asked through a slow bus.
#[derive(Debug, Default)]
pub struct Power {
    buffer: Vec<u8>,
}

/// The power supplies of the machine.
#[derive(Clone, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct PowerReading {
    /// By the kernel's name. Batteries of other devices, such as a mouse, are no supplies of the machine.
    pub supplies: BTreeMap<String, Supply>,
    /// How many supplies found no place, see [`DEVICES_MAX`](crate::DEVICES_MAX).
    pub left_out: u64,
}

/// One supply; what it does not say is `None`.
#[derive(Clone, Debug, Default, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct Supply {
    /// `Battery`, `Mains`, `USB`, `UPS`, `Wireless`.
    pub kind: Option<String>,
    /// `Charging`, `Discharging`, `Not charging`, `Full` or `Unknown`.
    pub status: Option<String>,
    /// Whether mains give power.
    pub online: Option<bool>,
    /// How full the battery is, 0 to 1.
    pub charge: Option<f64>,
    /// The voltage in volts.
    pub voltage: Option<f64>,
    /// The current in amperes. Drivers do not agree on its sign, so it has none: the status says which way.
    pub current: Option<f64>,
    /// The power in watts, without a sign as well.
    pub power: Option<f64>,
}

impl Sense for Power {
    type Reading = PowerReading;

    const ABOUT: About = About {
        name: "power",
        doc: "Batteries and mains",
        period: Duration::from_secs(10),
        parts: &[
            Part { key: "supplies.*.kind", unit: "", doc: "Battery, Mains, USB, UPS or Wireless" },
            Part { key: "supplies.*.status", unit: "", doc: "Charging, Discharging, Not charging or Full" },
            Part { key: "supplies.*.online", unit: "", doc: "whether mains give power" },
            Part { key: "supplies.*.charge", unit: "1", doc: "how full the battery is, 0 to 1" },
            Part { key: "supplies.*.voltage", unit: "V", doc: "the voltage" },
            Part { key: "supplies.*.current", unit: "A", doc: "the current; the status says which way" },
            Part { key: "supplies.*.power", unit: "W", doc: "the power; the status says which way" },
            Part { key: "left_out", unit: "1", doc: "supplies that found no place in the reading" },
        ],
    };

    fn read(&mut self, kernel: &Kernel, _now: Instant) -> Result<Option<PowerReading>, SenseError> {
        let mut found = Vec::new();
        for name in kernel.list(FOLDER)? {
            // One file has all there is to say, but older kernels leave the kind out of it.
            let Ok(text) = kernel.read(&format!("{FOLDER}/{name}/uevent"), &mut self.buffer) else {
                continue;
            };
            let Some(mut supply) = parse_supply(&text) else { continue };
            if supply.kind.is_none() {
                let kind = kernel.word(&format!("{FOLDER}/{name}/type"), &mut self.buffer);
                supply.kind = kind.map(|kind| kind.into_owned());
            }
            found.push((name, supply));
        }
        let Named { devices: supplies, left_out } = Named::of(found.into_iter());
        Ok((!supplies.is_empty()).then_some(PowerReading { supplies, left_out }))
    }

    fn is_present(&self, kernel: &Kernel) -> bool {
        Power::default()
            .read(kernel, Instant::ZERO)
            .is_ok_and(|reading| reading.is_some())
    }
}

/// Reads the file `uevent` of a supply; `None` if it is not there or belongs to another device than the machine.
/// The kernel counts in millionths of volts, amperes and watts.
pub fn parse_supply(text: &str) -> Option<Supply> {
    let entries: BTreeMap<&str, &str> = text
        .lines()
        .filter_map(|line| line.strip_prefix("POWER_SUPPLY_")?.split_once('='))
        .map(|(key, value)| (key, value.trim()))
        .filter(|(_, value)| !value.is_empty())
        .collect();
    // Unplugged mains are not present either, but they are asked whether they are online.
    let is_empty_bay = entries.get("PRESENT") == Some(&"0") && !entries.contains_key("ONLINE");
    if entries.get("SCOPE") == Some(&"Device") || is_empty_bay {
        return None;
    }
    let amount = |key: &str| Some(number(entries.get(key)?)?.abs());
    let millionths = |key: &str| amount(key).map(|micro| micro / 1e6);
    let (voltage, current) = (millionths("VOLTAGE_NOW"), millionths("CURRENT_NOW"));
    let ratio = |now: &str, full: &str| {
        amount(full)
            .filter(|full| *full > 0.0)
            .and_then(|full| Some(amount(now)? / full))
    };
    let percent = amount("CAPACITY").map(|percent| percent / 100.0);
    let charge = ratio("ENERGY_NOW", "ENERGY_FULL")
        .or_else(|| ratio("CHARGE_NOW", "CHARGE_FULL"))
        .or(percent);
    let word = |key: &str| entries.get(key).map(|word| (*word).to_owned());
    Some(Supply {
        kind: word("TYPE"),
        status: word("STATUS"),
        online: amount("ONLINE").map(|online| online > 0.0),
        charge: charge.map(|share| share.clamp(0.0, 1.0)),
        voltage,
        current,
        power: millionths("POWER_NOW").or_else(|| Some(voltage? * current?)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// In the format of a notebook whose firmware counts energy; written by hand like the next.
    const ENERGY: &str = "POWER_SUPPLY_NAME=BAT0\nPOWER_SUPPLY_TYPE=Battery\nPOWER_SUPPLY_STATUS=Discharging\n\
                          POWER_SUPPLY_PRESENT=1\nPOWER_SUPPLY_VOLTAGE_NOW=11700000\n\
                          POWER_SUPPLY_POWER_NOW=8190000\nPOWER_SUPPLY_ENERGY_FULL=48000000\n\
                          POWER_SUPPLY_ENERGY_NOW=36000000\nPOWER_SUPPLY_CAPACITY=75\n";
    /// One on an older kernel whose firmware counts charge, with a current that has a sign.
    const CHARGE: &str = "POWER_SUPPLY_NAME=BAT1\nPOWER_SUPPLY_STATUS=Charging\nPOWER_SUPPLY_PRESENT=1\n\
                          POWER_SUPPLY_VOLTAGE_NOW=8000000\nPOWER_SUPPLY_CURRENT_NOW=-1500000\n\
                          POWER_SUPPLY_CHARGE_FULL=4000000\nPOWER_SUPPLY_CHARGE_NOW=1000000\n";

    #[test]
    fn a_battery_that_counts_energy() {
        let supply = parse_supply(ENERGY).unwrap();
        assert_eq!(
            (supply.kind.as_deref(), supply.status.as_deref()),
            (Some("Battery"), Some("Discharging"))
        );
        assert_eq!((supply.charge, supply.voltage, supply.power), (Some(0.75), Some(11.7), Some(8.19)));
        assert_eq!((supply.current, supply.online), (None, None));
    }

    #[test]
    fn a_battery_that_counts_charge() {
        let supply = parse_supply(CHARGE).unwrap();
        assert_eq!((supply.kind, supply.charge), (None, Some(0.25)));
        assert_eq!((supply.current, supply.power), (Some(1.5), Some(12.0)));
    }

    #[test]
    fn mains_are_online_or_not() {
        let mains = parse_supply("POWER_SUPPLY_NAME=AC\nPOWER_SUPPLY_ONLINE=1\n").unwrap();
        assert_eq!(mains, Supply { online: Some(true), ..Supply::default() });
    }

    #[test]
    fn a_mouse_and_an_empty_bay_are_no_supplies() {
        assert_eq!(parse_supply("POWER_SUPPLY_SCOPE=Device\nPOWER_SUPPLY_CAPACITY=50\n"), None);
        assert_eq!(parse_supply("POWER_SUPPLY_PRESENT=0\n"), None);
    }

    #[test]
    fn nonsense_is_left_out() {
        let text = "POWER_SUPPLY_CAPACITY=900\nPOWER_SUPPLY_ENERGY_NOW=5\nPOWER_SUPPLY_ENERGY_FULL=0\n\
                    POWER_SUPPLY_VOLTAGE_NOW=x\nPOWER_SUPPLY_STATUS=\nNAME=1\nPOWER_SUPPLY_\n";
        assert_eq!(parse_supply(text).unwrap(), Supply { charge: Some(1.0), ..Supply::default() });
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "(POWER_SUPPLY_(CAPACITY|(ENERGY|VOLTAGE|CHARGE)_(NOW|FULL)|\\PC{0,4})=-?[0-9e.]{0,9}\n){0,6}|\\PC*") {
            let charge = parse_supply(&text).and_then(|supply| supply.charge);
            prop_assert!(charge.is_none_or(|charge| (0.0..=1.0).contains(&charge)));
        }
    }
}
