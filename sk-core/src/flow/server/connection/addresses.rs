//! What is known of the addresses that connections come from: how many come, and how many fail to log in.

use super::super::Origin;
use crate::flow::limits::{
    ADDRESSES_MAX, CONNECTIONS_PER_ADDRESS_BURST, CONNECTIONS_PER_ADDRESS_PER_SECOND, FAILED_LOGINS_FREE,
    FAILED_LOGINS_WINDOW,
};
use rustc_hash::FxHashMap;
use sk_flat::Instant;
use std::net::{IpAddr, Ipv6Addr};

/// Who is held to account: an address of IPv4, a network of IPv6 (a host there has as many addresses as it
/// likes), or a local user.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum Place {
    Network(IpAddr),
    User(u32),
}

impl Place {
    pub(super) fn of(origin: Origin) -> Option<Place> {
        match origin {
            Origin::Network(IpAddr::V6(address)) => {
                let network = u128::from(address) >> 64 << 64;
                Some(Place::Network(IpAddr::V6(Ipv6Addr::from(network))))
            }
            Origin::Network(address) => Some(Place::Network(address)),
            Origin::Unix { uid } => Some(Place::User(uid)),
            Origin::Line | Origin::Inside { .. } => None,
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Known {
    /// Connections that may come at once, in thousandths.
    tokens: u64,
    counted: Instant,
    failures: u32,
    /// When the minute of these failures began.
    since: Instant,
}

impl Known {
    fn new(now: Instant) -> Known {
        Known { tokens: FULL, counted: now, failures: 0, since: now }
    }

    fn pass(&mut self, now: Instant) {
        let millis = now.since(self.counted).as_millis().min(u128::from(FULL)) as u64;
        self.tokens = (self.tokens + millis * CONNECTIONS_PER_ADDRESS_PER_SECOND).min(FULL);
        self.counted = now;
        if now.since(self.since) >= FAILED_LOGINS_WINDOW {
            (self.failures, self.since) = (0, now);
        }
    }

    /// Whether it is as if it had never been seen.
    fn is_forgettable(&self) -> bool {
        self.tokens == FULL && self.failures == 0
    }
}

const FULL: u64 = CONNECTIONS_PER_ADDRESS_BURST * 1000;

/// The places that connections come from, a bounded number of them.
#[derive(Debug, Default)]
pub(in super::super) struct Addresses {
    known: FxHashMap<Place, Known>,
}

impl Addresses {
    /// Whether one more connection may come from there now.
    pub(in super::super) fn admit(&mut self, origin: Origin, now: Instant) -> bool {
        let Some(known) = self.known(origin, now) else { return true };
        let admitted = known.tokens >= 1000;
        known.tokens -= if admitted { 1000 } else { 0 };
        admitted
    }

    /// Notes a login that failed. Answers whether so many did that the answer is to be delayed.
    pub(in super::super) fn failed(&mut self, origin: Origin, now: Instant) -> bool {
        let Some(known) = self.known(origin, now) else { return false };
        known.failures = known.failures.saturating_add(1);
        known.failures > FAILED_LOGINS_FREE
    }

    fn known(&mut self, origin: Origin, now: Instant) -> Option<&mut Known> {
        let place = Place::of(origin)?;
        if !self.known.contains_key(&place) && self.known.len() >= ADDRESSES_MAX {
            self.forget_some(now);
        }
        let known = self.known.entry(place).or_insert_with(|| Known::new(now));
        known.pass(now);
        Some(known)
    }

    /// Forgets those of whom there is nothing to remember, and if that is not enough, the quarter that was silent
    /// for longest: many at once, so that it need not be done for each newcomer.
    fn forget_some(&mut self, now: Instant) {
        self.known.retain(|_, known| {
            let mut seen = *known;
            seen.pass(now);
            !seen.is_forgettable()
        });
        if self.known.len() < ADDRESSES_MAX {
            return;
        }
        let mut by_age: Vec<(Instant, Place)> =
            self.known.iter().map(|(place, known)| (known.counted, *place)).collect();
        by_age.sort_unstable();
        for (_, place) in by_age.into_iter().take(ADDRESSES_MAX / 4) {
            self.known.remove(&place);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn at(ms: u64) -> Instant {
        Instant::ZERO + Duration::from_millis(ms)
    }

    fn host(last: u8) -> Origin {
        Origin::Network([10, 0, 0, last].into())
    }

    #[test]
    fn one_address_may_send_so_many_connections_at_once_and_so_many_a_second_and_others_more() {
        let mut all = Addresses::default();
        let admitted = (0..CONNECTIONS_PER_ADDRESS_BURST + 1)
            .filter(|_| all.admit(host(1), at(0)))
            .count();
        assert_eq!(admitted as u64, CONNECTIONS_PER_ADDRESS_BURST);
        assert!(all.admit(host(2), at(0)));
        let later = (0..CONNECTIONS_PER_ADDRESS_PER_SECOND + 1)
            .filter(|_| all.admit(host(1), at(1000)))
            .count();
        assert_eq!(later as u64, CONNECTIONS_PER_ADDRESS_PER_SECOND);
        assert!(all.admit(Origin::Inside { rights: crate::flow::Rights::ALL }, at(0)));
    }

    #[test]
    fn failures_are_free_up_to_a_number_each_minute() {
        let mut all = Addresses::default();
        let late = |all: &mut Addresses, ms| (0..7).filter(|_| all.failed(host(1), at(ms))).count() as u32;
        assert_eq!(late(&mut all, 0), 7 - FAILED_LOGINS_FREE);
        assert!(!all.failed(host(2), at(0)));
        assert_eq!(late(&mut all, 59_000), 7, "within the minute");
        assert_eq!(late(&mut all, 60_000), 7 - FAILED_LOGINS_FREE, "a new minute");
    }

    #[test]
    fn a_network_of_ipv6_is_one_place_and_the_number_of_places_is_bounded() {
        let mut all = Addresses::default();
        let address = |network: u64, host: u64| {
            let bits = u128::from(network) << 64 | u128::from(host);
            Origin::Network(IpAddr::V6(Ipv6Addr::from(bits)))
        };
        for host in 0..=FAILED_LOGINS_FREE {
            assert_eq!(all.failed(address(1, host.into()), at(0)), host == FAILED_LOGINS_FREE);
        }
        for network in 0..ADDRESSES_MAX as u64 + 10 {
            all.failed(address(network, 0), at(1 + network));
        }
        assert_eq!(all.known.len(), 3 * ADDRESSES_MAX / 4 + 10, "the oldest quarter made room");
        for network in 0..3 * ADDRESSES_MAX as u64 {
            all.admit(address(network, 0), at(600_000));
            assert!(all.known.len() <= ADDRESSES_MAX);
        }
    }
}
