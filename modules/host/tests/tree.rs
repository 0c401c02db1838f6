//! The senses of a machine that is made up of files: every sense reads, every key has a unit.

use sk_flat::{FromVariant, Instant, SkVariant};
use sk_host::{AnySense, CpuReading, DiskReading, FrequencyReading, Kernel, LoadReading, MemoryReading};
use sk_host::{NetworkReading, PowerReading, Sense, SenseError, TemperatureReading, UptimeReading, senses};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::time::Duration;
use std::{fs, io};

/// The files of a notebook at rest.
const FILES: &[(&str, &str)] = &[
    ("proc/stat", "cpu  100 0 100 800 0 0 0 0 0 0\ncpu0 50 0 50 400 0 0 0 0 0 0\nintr 5\n"),
    (
        "proc/meminfo",
        "MemTotal: 1000 kB\nMemAvailable: 750 kB\nSwapTotal: 10 kB\nSwapFree: 4 kB\n",
    ),
    ("proc/loadavg", "0.50 0.25 0.10 2/300 4242\n"),
    ("proc/uptime", "12.5 20.0\n"),
    ("proc/1/comm", "init\n"),
    ("proc/42/comm", "hub\n"),
    ("proc/net/dev", "head\n eth0: 1000 10 0 0 0 0 0 0 2000 20 0 0 0 0 0 0\n"),
    (
        "proc/diskstats",
        "8 0 sda 1 0 8 0 1 0 16 0 0 0 0\n8 1 sda1 1 0 8 0 1 0 16 0 0 0 0\n7 0 loop0 5 0 5 0 0 0 0 0 0 0 0\n",
    ),
    ("sys/block/sda/size", "1000\n"),
    ("sys/block/loop0/size", "1000\n"),
    ("sys/devices/system/cpu/cpu0/cpufreq/scaling_cur_freq", "1800000\n"),
    ("sys/devices/system/cpu/cpufreq/boost", "1\n"),
    ("sys/class/thermal/thermal_zone0/type", "acpitz\n"),
    ("sys/class/thermal/thermal_zone0/temp", "41000\n"),
    ("sys/class/thermal/thermal_zone1/type", "asleep\n"),
    ("sys/class/thermal/cooling_device0/type", "Fan\n"),
    ("sys/class/hwmon/hwmon0/name", "nvme\n"),
    ("sys/class/hwmon/hwmon0/temp1_input", "38850\n"),
    ("sys/class/hwmon/hwmon0/temp1_label", "Composite\n"),
    ("sys/class/hwmon/hwmon0/fan1_input", "2000\n"),
    ("sys/class/hwmon/hwmon1/name", "nvme\n"),
    ("sys/class/hwmon/hwmon1/temp1_input", "55850\n"),
    ("sys/class/hwmon/hwmon1/temp1_label", "Composite\n"),
    ("sys/class/hwmon/hwmon1/temp2_input", "50000\n"),
    (
        "sys/class/power_supply/BAT0/uevent",
        "POWER_SUPPLY_STATUS=Charging\nPOWER_SUPPLY_CAPACITY=50\n",
    ),
    ("sys/class/power_supply/BAT0/type", "Battery\n"),
    ("sys/class/power_supply/AC/uevent", "POWER_SUPPLY_TYPE=Mains\nPOWER_SUPPLY_ONLINE=1\n"),
    (
        "sys/class/power_supply/hid-mouse/uevent",
        "POWER_SUPPLY_SCOPE=Device\nPOWER_SUPPLY_CAPACITY=9\n",
    ),
];

/// What is different two seconds later.
const LATER: &[(&str, &str)] = &[
    ("proc/stat", "cpu  150 0 150 900 0 0 0 0 0 0\ncpu0 75 0 75 450 0 0 0 0 0 0\nintr 5\n"),
    (
        "proc/net/dev",
        "head\n eth0: 3000 14 0 0 0 0 0 0 2000 20 0 0 0 0 0 0\n wlan0: 1 1 0 0 0 0 0 0 1 1 0 0 0 0 0 0\n",
    ),
    (
        "proc/diskstats",
        "8 0 sda 5 0 24 0 1 0 16 0 0 500 0\n8 1 sda1 5 0 24 0 1 0 16 0 0 500 0\n",
    ),
];

/// A folder of this test alone, which goes when the test ends.
struct Machine(PathBuf);

impl Machine {
    fn new(name: &str) -> Machine {
        let root = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()));
        fs::create_dir_all(&root).unwrap();
        Machine(root)
    }

    fn write(&self, files: &[(&str, &str)]) -> Kernel {
        for (name, text) in files {
            let path = self.0.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        Kernel::at(&self.0)
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// The second reading of each sense of the notebook, two seconds after the first.
fn second_readings(machine: &Machine) -> BTreeMap<&'static str, SkVariant> {
    let mut all = senses();
    let first = Instant::from_nanos(7);
    let kernel = machine.write(FILES);
    for sense in &mut all {
        assert!(sense.is_present(&kernel), "{}", sense.about().name);
        sense.read_variant(&kernel, first).unwrap();
    }
    machine.write(LATER);
    let read = |sense: &mut Box<dyn AnySense>| {
        let reading = sense.read_variant(&kernel, first + Duration::from_secs(2)).unwrap();
        (sense.about().name, reading.unwrap())
    };
    all.iter_mut().map(read).collect()
}

fn typed<S: Sense<Reading: FromVariant>>(readings: &BTreeMap<&str, SkVariant>) -> S::Reading {
    S::Reading::from_variant(&readings[S::ABOUT.name]).unwrap()
}

#[test]
fn every_sense_reads_the_machine() {
    let machine = Machine::new("reads");
    let readings = second_readings(&machine);
    let cpu: CpuReading = typed::<sk_host::Cpu>(&readings);
    assert_eq!((cpu.busy, cpu.user, cpu.cores), (0.5, 0.25, vec![Some(0.5)]));
    let frequency: FrequencyReading = typed::<sk_host::Frequency>(&readings);
    assert_eq!(frequency.cores, [Some(1.8e9)]);
    let memory: MemoryReading = typed::<sk_host::Memory>(&readings);
    assert_eq!((memory.used, memory.swap_used), (250 * 1024, 6 * 1024));
    let load: LoadReading = typed::<sk_host::Load>(&readings);
    assert_eq!((load.average_1min, load.running, load.threads, load.processes), (0.5, 2, 300, 2));
    let uptime: UptimeReading = typed::<sk_host::Uptime>(&readings);
    assert_eq!(uptime.seconds, 12.5);

    let network: NetworkReading = typed::<sk_host::Network>(&readings);
    // The radio came up since the first reading, so it has no rate yet.
    assert_eq!(network.interfaces.keys().collect::<Vec<_>>(), ["eth0"]);
    assert_eq!(
        (network.interfaces["eth0"].received_bytes, network.interfaces["eth0"].received_packets),
        (1000.0, 2.0)
    );
    let disk: DiskReading = typed::<sk_host::Disk>(&readings);
    assert_eq!(disk.disks.keys().collect::<Vec<_>>(), ["sda"]);
    let sda = disk.disks["sda"];
    assert_eq!((sda.read_bytes, sda.reads, sda.written_bytes, sda.busy), (4096.0, 2.0, 0.0, 0.25));
}

#[test]
fn devices_of_sysfs_are_found_and_named() {
    let machine = Machine::new("devices");
    let readings = second_readings(&machine);
    let temperature: TemperatureReading = typed::<sk_host::Temperature>(&readings);
    let sensors: Vec<_> = temperature
        .sensors
        .iter()
        .map(|(name, celsius)| (name.as_str(), *celsius))
        .collect();
    let expected =
        [("acpitz", 41.0), ("nvme/Composite", 38.85), ("nvme/Composite #2", 55.85), ("nvme/temp2", 50.0)];
    assert_eq!((sensors.as_slice(), temperature.hottest), (expected.as_slice(), 55.85));
    let power: PowerReading = typed::<sk_host::Power>(&readings);
    assert_eq!(power.supplies.keys().collect::<Vec<_>>(), ["AC", "BAT0"]);
    assert_eq!(power.supplies["AC"].online, Some(true));
    let battery = &power.supplies["BAT0"];
    assert_eq!((battery.kind.as_deref(), battery.charge), (Some("Battery"), Some(0.5)));
}

/// The keys of a reading: names of devices become `*`, items of lists `[]`.
fn keys(documented: &BTreeSet<&str>, path: &str, value: &SkVariant, found: &mut BTreeSet<String>) {
    let below = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    match value {
        SkVariant::Map(map) => {
            let is_of_devices = documented.iter().any(|key| key.starts_with(&below("*")));
            for (key, value) in map.iter() {
                keys(documented, &below(if is_of_devices { "*" } else { key }), value, found);
            }
        }
        SkVariant::List(list) => list.iter().for_each(|item| keys(documented, &below("[]"), item, found)),
        _ => {
            found.insert(path.to_owned());
        }
    }
}

#[test]
fn every_key_of_a_reading_is_described_and_every_described_key_is_there() {
    let machine = Machine::new("keys");
    let readings = second_readings(&machine);
    for sense in senses() {
        let about = sense.about();
        let documented: BTreeSet<_> = about.parts.iter().map(|part| part.key).collect();
        let mut found = BTreeSet::new();
        keys(&documented, "", &readings[about.name], &mut found);
        assert!(
            documented.iter().eq(&found),
            "{}: {documented:?} are described, {found:?} are there",
            about.name
        );
        assert!(about.parts.iter().all(|part| !part.doc.is_empty()), "{}", about.name);
        let with_unit = about.parts.iter().filter(|part| !part.unit.is_empty()).count();
        assert_eq!(about.units().as_map().unwrap().len(), with_unit, "{}", about.name);
    }
}

#[test]
fn channel_names_are_good_and_different() {
    let names: BTreeSet<_> = senses().iter().map(|sense| sense.about().name).collect();
    assert_eq!(names.len(), senses().len());
    assert!(names.iter().all(|name| name.bytes().all(|byte| byte.is_ascii_lowercase())), "{names:?}");
    assert!(senses().iter().all(|sense| sense.about().period >= Duration::from_secs(1)));
}

#[test]
fn the_readme_lists_every_channel_with_its_parts_and_units() {
    let readme = include_str!("../README.md");
    for sense in senses() {
        let about = sense.about();
        let head = format!("| `{}` | {} s |", about.name, about.period.as_secs());
        let row = readme
            .lines()
            .find(|line| line.starts_with(&head))
            .unwrap_or_else(|| panic!("no {head}"));
        for part in about.parts {
            let listed = format!("`{}` {}", part.key, part.unit);
            assert!(row.contains(listed.trim()), "{}: {listed}", about.name);
        }
    }
}

#[test]
fn a_rate_is_forgotten_with_its_reader() {
    let machine = Machine::new("forgets");
    let kernel = machine.write(FILES);
    let mut all = senses();
    all.iter_mut()
        .for_each(|sense| drop(sense.read_variant(&kernel, Instant::ZERO).unwrap()));
    machine.write(LATER);
    all.iter_mut().for_each(|sense| sense.forget());
    let silent = all.iter_mut().filter_map(|sense| {
        let reading = sense.read_variant(&kernel, Instant::ZERO + Duration::from_secs(9)).unwrap();
        reading.is_none().then_some(sense.about().name)
    });
    assert_eq!(silent.collect::<Vec<_>>(), ["cpu", "network", "disk"]);
}

#[test]
fn a_machine_without_files_has_no_senses() {
    let machine = Machine::new("bare");
    let kernel = machine.write(&[]);
    for mut sense in senses() {
        let name = sense.about().name;
        assert!(!sense.is_present(&kernel), "{name}");
        match sense.read_variant(&kernel, Instant::ZERO) {
            Ok(reading) => assert_eq!(reading, None, "{name}"),
            Err(SenseError::Unreadable { path, source }) => {
                assert!(path.starts_with(kernel.root()), "{name}");
                assert_eq!(source.kind(), io::ErrorKind::NotFound, "{name}");
            }
            Err(error) => panic!("{name}: {error}"),
        }
    }
}

#[test]
fn garbage_in_the_files_is_an_error_or_nothing() {
    let machine = Machine::new("garbage");
    for text in ["", "\0\u{fffd}", "a b c d\n: : :\n= = =", "-1 -1 -1 -1/-1 -1"] {
        let files: Vec<_> = FILES.iter().map(|(name, _)| (*name, text)).collect();
        let kernel = machine.write(&files);
        for mut sense in senses() {
            let name = sense.about().name;
            for second in 0..2 {
                let now = Instant::ZERO + Duration::from_secs(second);
                match sense.read_variant(&kernel, now) {
                    Ok(Some(reading)) => {
                        // No rate, no temperature: at most maps of devices without contents.
                        assert!(["network", "disk", "power"].contains(&name), "{name}: {reading}");
                    }
                    Ok(None) => {}
                    Err(error) => assert!(matches!(error, SenseError::Malformed { .. }), "{name}: {error}"),
                }
            }
        }
    }
}
