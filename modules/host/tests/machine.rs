//! The senses of the machine that the test runs on: only what holds on every Linux.

use sk_flat::{Instant, SkVariant};
use sk_host::{Cpu, Disk, Kernel, Load, Memory, Network, Sense, Uptime, senses};
use std::time::Duration;

#[test]
fn the_real_kernel_is_read() {
    let (kernel, now) = (Kernel::default(), Instant::ZERO);
    let memory = Memory::default().read(&kernel, now).unwrap().unwrap();
    assert!(memory.total > 0 && memory.available <= memory.total && memory.swap_used <= memory.swap_total);
    let load = Load::default().read(&kernel, now).unwrap().unwrap();
    assert!(load.threads >= 1 && load.processes >= 1);
    assert!(Uptime::default().read(&kernel, now).unwrap().unwrap().seconds > 0.0);
}

#[test]
fn the_cores_of_the_real_machine_have_shares() {
    let (kernel, mut cpu) = (Kernel::default(), Cpu::default());
    assert_eq!(cpu.read(&kernel, Instant::ZERO).unwrap(), None);
    // The kernel counts in ticks: reading on makes them pass, because reading is work.
    let reading = loop {
        if let Some(reading) = cpu.read(&kernel, Instant::ZERO).unwrap() {
            break reading;
        }
    };
    assert!((0.0..=1.0).contains(&reading.busy));
    assert!(!reading.cores.is_empty());
}

#[test]
fn the_devices_of_the_real_machine_have_rates() {
    let (kernel, later) = (Kernel::default(), Instant::ZERO + Duration::from_secs(1));
    let (mut network, mut disk) = (Network::default(), Disk::default());
    assert_eq!(network.read(&kernel, Instant::ZERO).unwrap(), None);
    let interfaces = network.read(&kernel, later).unwrap().unwrap().interfaces;
    assert!(
        interfaces
            .values()
            .all(|rates| rates.received_bytes >= 0.0 && rates.sent_packets >= 0.0)
    );
    if Sense::is_present(&disk, &kernel) {
        assert_eq!(disk.read(&kernel, Instant::ZERO).unwrap(), None);
        let disks = disk.read(&kernel, later).unwrap().unwrap().disks;
        assert!(!disks.keys().any(|name| name.starts_with("loop") || name.starts_with("ram")), "{disks:?}");
    }
}

#[test]
fn what_is_present_can_be_read_as_a_map() {
    let kernel = Kernel::default();
    let mut present = senses();
    present.retain(|sense| sense.is_present(&kernel));
    assert!(present.len() >= 4);
    for sense in &mut present {
        let reading = sense.read_variant(&kernel, Instant::ZERO).unwrap();
        assert!(
            reading.is_none_or(|reading| matches!(reading, SkVariant::Map(_))),
            "{}",
            sense.about().name
        );
    }
}
