//! How the end of a pipe inside a process is told, in a simulated world, that something has come.

use super::Token;
use super::simulated::{Network, SimulatedShare};
use super::wire::SocketId;
use sk_flat::Instant;
use std::sync::Arc;

/// One end of a pipe, as the simulated network knows it: rung, it makes its source ready after the delay of
/// the simulator.
#[derive(Debug)]
pub(crate) struct SimulatedBell {
    network: Arc<Network>,
    id: SocketId,
}

impl SimulatedShare {
    /// A bell for a source of this loop.
    pub(crate) fn bell(&self, token: Token) -> SimulatedBell {
        let id = self.network().at_present().0.add_bell(self.number(), token);
        SimulatedBell { network: self.network().clone(), id }
    }
}

impl SimulatedBell {
    /// Whether the way takes time. Between two ends on one loop it does only if it was made late: without a wait
    /// in between, no round is a tick, as in the real world.
    pub(crate) fn takes_time(&self, on_one_loop: bool) -> bool {
        !on_one_loop || self.network.at_present().0.is_late_inside(self.id)
    }

    /// Rings: it is heard when what was sent last arrives, or later.
    pub(crate) fn ring(&self) {
        let (mut switch, now) = self.network.at_present();
        switch.ring(self.id, now);
    }

    /// When what is sent now arrives: never before what was sent earlier.
    pub(crate) fn next_arrival(&self) -> Instant {
        let (mut switch, now) = self.network.at_present();
        switch.next_arrival(self.id, now)
    }
}

impl Drop for SimulatedBell {
    fn drop(&mut self) {
        let (mut switch, now) = self.network.at_present();
        switch.close(self.id, now);
    }
}
