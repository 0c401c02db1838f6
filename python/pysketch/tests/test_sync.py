"""Sync channels: a source, targets, and the hub's report."""

import unittest

from hub import HubTest


class Sync(HubTest):
    """A satellite's pulse is everybody's."""

    def test_a_target_ticks_when_its_source_does_and_is_measured(self):
        source, target = self.sat(interval=0.02), self.sat(interval=0.02)
        ticks, reports = [], []
        target.loop = lambda: ticks.append(target.tick)
        source.on_tick_report = reports.append
        source.sync_source("beat")
        target.sync_to("robot.beat", 1)
        self.assertEqual(target.pulse.mode, "synced")
        with self.pulsing(source):
            self.until(lambda: len(ticks) >= 10 and reports, target)
        self.assertEqual(ticks, sorted(set(ticks)))
        self.assertEqual((reports[0].channel.name, reports[0].divisor), (u"robot.beat", 1))
        self.assertGreater(reports[0].done, 0)
        self.assertGreaterEqual(reports[0].lag, 0)
        target.sync_stop()
        self.assertEqual(target.pulse.mode, "coarse")

    def test_a_divisor_halves_the_beat(self):
        source, target, ticks = self.sat(interval=0.01), self.sat(interval=0.01), []
        target.loop = lambda: ticks.append(target.tick)
        source.sync_source("half")
        target.sync_to("robot.half", 2)
        with self.pulsing(source):
            self.until(lambda: len(ticks) >= 5, target)
        self.assertEqual([tick % 2 for tick in ticks], [0] * len(ticks))
        self.assertRaises(ValueError, target.sync_to, "robot.half", 3)


if __name__ == "__main__":
    unittest.main()
