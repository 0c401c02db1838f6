//! What goes through the network interfaces: `/proc/net/dev`.

use crate::counter::rate;
use crate::devices::Counters;
use crate::{About, Kernel, Part, Sense, SenseError};
use sk_flat::{Instant, SkVariant};
use std::collections::BTreeMap;
use std::time::Duration;

const FILE: &str = "proc/net/dev";

/// The reader of the network interfaces that the hub's network namespace has.
#[derive(Debug, Default)]
pub struct Network {
    buffer: Vec<u8>,
    previous: Counters<InterfaceCounters>,
}

/// What went through the interfaces since the previous reading.
#[derive(Clone, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct NetworkReading {
    /// By the name of the interface. One that appeared, or whose counters began anew, since the previous
    /// reading is missing this time.
    pub interfaces: BTreeMap<String, InterfaceRates>,
    /// How many interfaces found no place, see [`DEVICES_MAX`](crate::DEVICES_MAX).
    pub left_out: u64,
}

/// What went through one interface, per second.
#[derive(Clone, Copy, Debug, PartialEq, SkVariant)]
#[variant(ignore_unknown)]
pub struct InterfaceRates {
    /// Bytes received per second.
    pub received_bytes: f64,
    /// Packets received per second.
    pub received_packets: f64,
    /// Bytes sent per second.
    pub sent_bytes: f64,
    /// Packets sent per second.
    pub sent_packets: f64,
}

/// What an interface counted since it came up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InterfaceCounters {
    /// Bytes received.
    pub received_bytes: u64,
    /// Packets received.
    pub received_packets: u64,
    /// Bytes sent.
    pub sent_bytes: u64,
    /// Packets sent.
    pub sent_packets: u64,
}

impl Sense for Network {
    type Reading = NetworkReading;

    const ABOUT: About = About {
        name: "network",
        doc: "What goes through each network interface",
        period: Duration::from_secs(1),
        parts: &[
            Part { key: "interfaces.*.received_bytes", unit: "B/s", doc: "bytes received" },
            Part { key: "interfaces.*.received_packets", unit: "1/s", doc: "packets received" },
            Part { key: "interfaces.*.sent_bytes", unit: "B/s", doc: "bytes sent" },
            Part { key: "interfaces.*.sent_packets", unit: "1/s", doc: "packets sent" },
            Part { key: "left_out", unit: "1", doc: "interfaces that found no place in the reading" },
        ],
    };

    fn read(&mut self, kernel: &Kernel, now: Instant) -> Result<Option<NetworkReading>, SenseError> {
        let present = parse_network(&kernel.read(FILE, &mut self.buffer)?);
        let rates = self.previous.rates(now, present, InterfaceCounters::rates);
        Ok(rates.map(|rates| NetworkReading { interfaces: rates.devices, left_out: rates.left_out }))
    }

    fn forget(&mut self) {
        self.previous.forget();
    }

    fn is_present(&self, kernel: &Kernel) -> bool {
        kernel.has(FILE)
    }
}

impl InterfaceCounters {
    fn rates(&self, now: &InterfaceCounters, span: Duration) -> Option<InterfaceRates> {
        Some(InterfaceRates {
            received_bytes: rate(self.received_bytes, now.received_bytes, span)?,
            received_packets: rate(self.received_packets, now.received_packets, span)?,
            sent_bytes: rate(self.sent_bytes, now.sent_bytes, span)?,
            sent_packets: rate(self.sent_packets, now.sent_packets, span)?,
        })
    }
}

/// Reads the text of `/proc/net/dev`. Lines that describe no interface, like the two at the head, are skipped.
pub fn parse_network(text: &str) -> BTreeMap<String, InterfaceCounters> {
    text.lines().filter_map(parse_line).collect()
}

/// An interface and its counters. Old kernels print no space behind the colon, and names of the kind `eth0:1`
/// have a colon inside.
fn parse_line(line: &str) -> Option<(String, InterfaceCounters)> {
    let (name, counters) = line.rsplit_once(':')?;
    let name = name.trim();
    let mut numbers = counters.split_ascii_whitespace().map(|word| word.parse::<u64>().ok());
    let counters = InterfaceCounters {
        received_bytes: numbers.next()??,
        received_packets: numbers.next()??,
        // Between them: errors, dropped, fifo, frame, compressed and multicast.
        sent_bytes: numbers.nth(6)??,
        sent_packets: numbers.next()??,
    };
    (!name.is_empty()).then(|| (name.to_owned(), counters))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const HEAD: &str = "Inter-|   Receive                                                |  Transmit\n \
        face |bytes    packets errs drop fifo frame compressed multicast|bytes    packets errs drop fifo colls carrier compressed\n";

    #[test]
    fn interfaces_are_read() {
        let text = format!(
            "{HEAD}    lo: 465143329   25736    0    0    0     0          0         0 465143329   25736    0    0    0     0       0          0\n  \
             eth0: 171989204   10856    1    2    3     4          5         6   836056    6987    0    0    0     0       0          0\n"
        );
        let interfaces = parse_network(&text);
        assert_eq!(interfaces.keys().collect::<Vec<_>>(), ["eth0", "lo"]);
        let expected = InterfaceCounters {
            received_bytes: 171_989_204,
            received_packets: 10_856,
            sent_bytes: 836_056,
            sent_packets: 6987,
        };
        assert_eq!(interfaces["eth0"], expected);
    }

    #[test]
    fn a_line_of_an_old_kernel_has_no_space_behind_the_colon() {
        let interfaces = parse_network("eth0:1:4294967295 2 0 0 0 0 0 0 5 6 0 0 0 0 0 0\n");
        assert_eq!(interfaces["eth0:1"].received_bytes, 4_294_967_295);
        assert_eq!(interfaces["eth0:1"].sent_packets, 6);
    }

    #[test]
    fn nonsense_is_left_out() {
        let text = "eth0: 1 2 3 4 5 6 7 8 9\neth1: x 2 3 4 5 6 7 8 9 10\n: 1 2 3 4 5 6 7 8 9 10\n\neth2\n\
                    eth3: -1 2 3 4 5 6 7 8 9 10\n";
        assert_eq!(parse_network(text), BTreeMap::new());
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "(\\PC{0,4}:( ?[0-9]{1,21}){8,18}\n){0,4}|\\PC*") {
            prop_assert!(parse_network(&text).len() <= text.lines().count());
        }
    }
}
