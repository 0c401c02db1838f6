"""The modes of the pulse, and what is measured. No test here knows how fast this machine is."""

import socket
import unittest

from pysketch.clock import monotonic
from pysketch.links import SocketLink
from pysketch.measures import Histogram
from pysketch.pulse import COARSE, REALTIME, SOCKET, SYNCED, Pulse


class Modes(unittest.TestCase):
    """What each of them promises."""

    def setUp(self):
        near, self.far = socket.socketpair()
        self.link = SocketLink(near)
        self.addCleanup(self.far.close)
        self.addCleanup(self.link.close)

    def test_coarse_never_ticks_early_and_serves_meanwhile(self):
        pulse = Pulse(COARSE, 0.02)
        for _ in range(3):
            begun = monotonic()
            self.assertEqual(pulse.wait(self.link, False), (True, False, False))
            self.assertGreaterEqual(monotonic() - begun, 0.02)
        self.far.send(b"x")
        self.assertEqual(Pulse(COARSE, 3600).wait(self.link, False), (False, True, False))

    def test_realtime_keeps_its_schedule_and_counts_what_it_missed(self):
        pulse = Pulse(REALTIME, 0.005)
        pulse.wait(None, False)
        first = pulse.due
        for _ in range(9):
            pulse.wait(None, False)
        steps = (pulse.due - first) / 0.005
        self.assertAlmostEqual(steps, round(steps), 5)
        self.assertEqual(round(steps), 9 + pulse.statistics.missed)
        pulse.due -= 0.0501
        missed = pulse.statistics.missed
        pulse.wait(None, False)
        self.assertGreaterEqual(pulse.statistics.missed, missed + 9)
        self.assertGreaterEqual(pulse.statistics.overruns, 1)

    def test_traffic_makes_a_tick_in_the_socket_driven_mode(self):
        self.far.send(b"x")
        self.assertEqual(Pulse(SOCKET, 3600).wait(self.link, False), (True, True, False))
        self.assertEqual(Pulse(SOCKET, 3600).wait(self.link, True)[2], True)

    def test_synced_ticks_when_told_and_counts_silence(self):
        pulse = Pulse(SYNCED, 0.001)
        self.assertFalse(pulse.wait(self.link, False)[0])
        self.assertEqual(pulse.statistics.sync_lost, 1)
        pulse.sync()
        self.assertTrue(pulse.wait(self.link, False)[0])
        self.assertFalse(pulse.wait(self.link, False)[0])

    def test_a_clock_never_goes_back(self):
        last = monotonic()
        for _ in range(10000):
            now = monotonic()
            self.assertGreaterEqual(now, last)
            last = now


class Measures(unittest.TestCase):
    """The histogram."""

    def test_quantiles_are_within_a_bucket(self):
        histogram = Histogram()
        for nanos in range(1, 100001):
            histogram.add(nanos)
        for share in (0.5, 0.9, 0.99):
            self.assertTrue(1.0 <= histogram.quantile(share) / (share * 100000) <= 1.2)
        self.assertEqual((histogram.quantile(1.0), histogram.longest), (100000, 100000))
        self.assertEqual(Histogram().quantile(0.5), 0)


if __name__ == "__main__":
    unittest.main()
