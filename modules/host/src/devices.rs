//! Counters of devices that come and go.

use sk_flat::Instant;
use std::collections::BTreeMap;
use std::time::Duration;

/// A reading names no more devices; the rest are counted as left out. A machine with many containers can have
/// thousands of network interfaces.
pub const DEVICES_MAX: usize = 512;

/// The counters of the devices at the previous reading.
#[derive(Debug)]
pub(crate) struct Counters<C>(Option<(Instant, BTreeMap<String, C>)>);

impl<C> Default for Counters<C> {
    fn default() -> Counters<C> {
        Counters(None)
    }
}

impl<C> Counters<C> {
    /// What `rate` makes of each device that is there now and was there before; `None` if there is no earlier
    /// reading. The counters of now take the place of those before.
    pub(crate) fn rates<R>(
        &mut self,
        now: Instant,
        present: BTreeMap<String, C>,
        rate: impl Fn(&C, &C, Duration) -> Option<R>,
    ) -> Option<Named<R>> {
        // No time has passed: the earlier counters stay, so that it can.
        if self.0.as_ref().is_some_and(|(before, _)| *before == now) {
            return None;
        }
        let (before, earlier) = self.0.replace((now, present))?;
        let span = now.since(before);
        // Time ran backwards: somebody changed the clock under us.
        if span.is_zero() {
            return None;
        }
        let (_, present) = self.0.as_ref()?;
        Some(Named::of(present.iter().filter_map(|(name, counters)| {
            let rates = rate(earlier.get(name)?, counters, span)?;
            Some((name.clone(), rates))
        })))
    }

    /// Forgets the previous reading.
    pub(crate) fn forget(&mut self) {
        self.0 = None;
    }
}

/// Devices by name, at most [`DEVICES_MAX`].
#[derive(Debug, PartialEq)]
pub(crate) struct Named<T> {
    pub(crate) devices: BTreeMap<String, T>,
    pub(crate) left_out: u64,
}

impl<T> Named<T> {
    pub(crate) fn of(devices: impl Iterator<Item = (String, T)>) -> Named<T> {
        let mut named = Named { devices: BTreeMap::new(), left_out: 0 };
        for (name, device) in devices {
            if named.devices.len() < DEVICES_MAX || named.devices.contains_key(&name) {
                named.devices.insert(name, device);
            } else {
                named.left_out += 1;
            }
        }
        named
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counter::rate;

    fn at(seconds: u64, devices: &[(&str, u64)]) -> (Instant, BTreeMap<String, u64>) {
        let devices = devices.iter().map(|(name, count)| ((*name).to_owned(), *count));
        (Instant::ZERO + Duration::from_secs(seconds), devices.collect())
    }

    fn read(
        counters: &mut Counters<u64>,
        seconds: u64,
        devices: &[(&str, u64)],
    ) -> Option<Vec<(String, f64)>> {
        let (now, present) = at(seconds, devices);
        let named = counters.rates(now, present, |before, now, span| rate(*before, *now, span))?;
        Some(named.devices.into_iter().collect())
    }

    #[test]
    fn a_device_has_a_rate_once_it_was_seen_twice() {
        let mut counters = Counters::default();
        assert_eq!(read(&mut counters, 1, &[("a", 10)]), None);
        assert_eq!(read(&mut counters, 3, &[("a", 30), ("b", 7)]).unwrap(), [("a".into(), 10.0)]);
        assert_eq!(read(&mut counters, 4, &[("b", 8)]).unwrap(), [("b".into(), 1.0)]);
        // It comes back, with counters that began anew.
        assert_eq!(read(&mut counters, 5, &[("a", 1), ("b", 3)]).unwrap(), []);
        assert_eq!(read(&mut counters, 6, &[("a", 2)]).unwrap(), [("a".into(), 1.0)]);
    }

    #[test]
    fn a_rate_needs_time() {
        let mut counters = Counters::default();
        assert_eq!(read(&mut counters, 5, &[("a", 10)]), None);
        assert_eq!(read(&mut counters, 5, &[("a", 99)]), None);
        assert_eq!(read(&mut counters, 6, &[("a", 11)]).unwrap(), [("a".into(), 1.0)]);
        assert_eq!(read(&mut counters, 2, &[("a", 12)]), None);
        assert_eq!(read(&mut counters, 3, &[("a", 13)]).unwrap(), [("a".into(), 1.0)]);
        counters.forget();
        assert_eq!(read(&mut counters, 9, &[("a", 99)]), None);
    }

    #[test]
    fn there_is_a_limit_to_names() {
        let named = Named::of((0..DEVICES_MAX + 3).map(|number| (number.to_string(), ())));
        assert_eq!((named.devices.len(), named.left_out), (DEVICES_MAX, 3));
    }
}
