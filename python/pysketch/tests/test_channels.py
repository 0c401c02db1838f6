"""Streams beyond the plain ones: latch, credit, header, replicas, polling, batches, and what the hub tells of them."""

import unittest

from hub import HubTest
from pysketch import FlowSat, Refused, connect


class Channels(HubTest):
    """Each with a hub of its own account, `robot`."""

    def test_a_late_listener_gets_what_is_latched(self):
        owner, late = self.sat(), self.sat()
        stream, got = owner.stream("map", latch=True), []
        self.until(lambda: stream.opened, owner)
        self.assertTrue(stream.publish(u"the newest map"))
        self.until(lambda: not owner.waiting, owner)
        late.subscribe("robot.map", lambda message: got.append(message.value))
        self.until(lambda: got, owner, late)
        self.assertEqual(got, [u"the newest map"])

    def test_a_reliable_stream_waits_for_its_listener_and_loses_nothing(self):
        owner, listener = self.sat(), self.sat()
        stream = owner.stream("ore", delivery="reliable", format="bytes")
        sent, got, payload = [0], [0], b"\x07" * 50000
        subscription = listener.subscribe("robot.ore", on_batch=lambda channel, some: got.__setitem__(0, got[0] + len(some)))
        self.until(lambda: stream.listened and stream.wanted, owner, listener)
        while stream.publish_bytes(payload):
            sent[0] += 1
        self.assertFalse(stream.wanted)
        self.until(lambda: stream.wanted and not owner.waiting, owner, listener)
        while stream.publish_bytes(payload):
            sent[0] += 1
        self.until(lambda: got[0] == sent[0], owner, listener)
        # 1 MiB of credit is twenty messages; there was more than one round of it.
        self.assertGreater(sent[0], 21)
        self.assertEqual(subscription.dropped, {})

    def test_everybody_hears_a_changed_header(self):
        owner, other, heard = self.sat(), self.sat(), []
        other.on_header = heard.append
        stream = owner.stream("probe", unit="C")
        self.until(lambda: "robot.probe" in [channel.name for channel in other.channels], owner, other)
        stream.change(unit="K")
        self.until(lambda: heard, owner, other)
        self.assertEqual((heard[0].name, heard[0].properties[u"unit"]), (u"robot.probe", u"K"))

    def test_a_replica_repeats_its_source_and_finds_it_again(self):
        owner, repeater, listener, got = self.sat(), self.sat(), self.sat(), []
        all_ = (owner, repeater, listener)
        listener.subscribe("robot.copy", lambda message: got.append(message.value))
        copy = repeater.repeat("copy", "robot.original")
        for round_ in (1, 2):
            original = owner.stream("original")
            self.until(lambda: copy.repeating and original.listened, *all_)
            self.assertFalse(copy.publish(u"not while it repeats"))
            original.publish(round_)
            self.until(lambda: len(got) == round_, *all_)
            original.remove()
            self.until(lambda: not copy.repeating, *all_)
        self.assertEqual(got, [1, 2])

    def test_a_value_is_polled_without_a_flow(self):
        owner = self.sat()
        stream = owner.stream("volts")
        self.until(lambda: stream.opened, owner)
        with connect(self.hub.unix) as hub:
            self.assertIsNone(hub.poll("robot.volts"))
            self.until(lambda: stream.listened, owner)
            stream.publish_bytes(b"12.6")
            self.until(lambda: not owner.waiting, owner)
            self.patiently(lambda: hub.poll("robot.volts") == b"12.6")
            hub.poll_stop("robot.volts")
            self.until(lambda: not stream.listened, owner)

    def test_many_small_messages_come_in_batches_and_in_order(self):
        owner, listener, got, sizes = self.sat(), self.sat(), [], []
        stream = owner.stream("count", format="bytes")

        def batch(channel, payloads):
            self.assertEqual(channel.name, "robot.count")
            sizes.append(len(payloads))
            got.extend(payloads)
        listener.subscribe("robot.count", on_batch=batch, depth=1024, policy="all")
        self.until(lambda: stream.listened, owner, listener)
        sent = [(u"%d" % number).encode("ascii") for number in range(900)]
        for payload in sent:
            self.assertTrue(stream.publish_bytes(payload))
        self.until(lambda: len(got) == len(sent), owner, listener)
        self.assertEqual(got, sent)
        self.assertGreater(max(sizes), 1)

    def test_what_flows_through_the_hub_finds_its_memory_again(self):
        owner, listener, got = self.sat(), self.sat(), [0]
        stream = owner.stream("flowing", delivery="reliable", format="bytes")
        listener.subscribe("robot.flowing", on_batch=lambda channel, some: got.__setitem__(0, got[0] + len(some)))
        self.until(lambda: stream.listened and stream.wanted, owner, listener)

        def pages():
            with open("/proc/%d/stat" % self.hub.process.pid) as file:
                return int(file.read().rpartition(")")[2].split()[7])

        def burst(count):
            before, sent = pages(), got[0]
            for number in range(sent, sent + count):
                self.until(lambda: stream.wanted, owner, listener)
                stream.publish_bytes(b"\7" * 65536)
            self.until(lambda: got[0] == sent + count, owner, listener)
            return pages() - before
        burst(100)
        # Each message has sixteen pages.
        self.assertLess(burst(400), 400)

    def test_what_is_dropped_is_told(self):
        owner, listener, told = self.sat(), self.sat(), []
        stream = owner.stream("flood", format="bytes")
        listener.on_dropped = lambda *what: told.append(what)
        subscription = listener.subscribe("robot.flood", lambda message: None, depth=1)
        self.until(lambda: stream.listened, owner, listener)
        for _ in range(300):
            stream.publish_bytes(b"\0" * 60000)
            owner.pulse_once()
        self.until(lambda: told, owner, listener)
        self.assertEqual(told[0][:2], ("robot.flood", "NewestWins"))
        self.assertGreater(subscription.dropped["NewestWins"], 0)

    def test_unsubscribing_ends_hearing(self):
        owner, got = self.sat(), []
        stream = owner.stream("radio")
        owner.subscribe("robot.radio", got.append)
        self.until(lambda: stream.listened, owner)
        owner.unsubscribe("robot.radio")
        self.until(lambda: not stream.listened, owner)
        self.assertEqual(got, [])

    def test_the_hub_is_asked_about_itself(self):
        owner = self.sat()
        stream = owner.stream("seen")
        owner.subscribe("robot.seen", lambda message: None)
        self.until(lambda: stream.listened, owner)
        with connect(self.hub.unix) as hub:
            self.assertIn(u"version", hub.inspect())
            graph = hub.inspect("graph")
            self.assertIn(u"robot.seen", repr(graph))
            self.assertEqual(hub.inspect("channel robot.seen")[u"kind"], u"stream")
            with self.assertRaises(Refused) as caught:
                hub.inspect("weather")
            self.assertEqual(caught.exception.code, "NoSuchSubject")

    def test_a_taken_name_is_asked_for_again_and_said_once(self):
        one, two, told = self.sat(), self.sat(), []
        first = one.stream("taken")
        self.until(lambda: first.opened, one)
        two.on_refused = told.append
        second = two.stream("taken")
        self.until(lambda: told, two)
        for _ in range(3):
            second.create()
        # The hub answers in order: what comes next shows that all three were refused.
        third = two.stream("free")
        self.until(lambda: third.opened, one, two)
        self.assertEqual([refusal.code for refusal in told], ["Exists"])
        one.close()
        self.until(lambda: second.opened, two)

    def test_wishes_that_cannot_be_are_said_at_once(self):
        sat = FlowSat(self.hub.unix)
        self.assertRaises(ValueError, sat.subscribe, "robot.x", policy="some")
        self.assertRaises(ValueError, sat.subscribe, "robot.x", depth=5000)
        self.assertRaises(ValueError, FlowSat, self.hub.unix, mode="hurried")
        self.assertRaises(ValueError, FlowSat, self.hub.unix, form="xml")
        sat.stream("one")
        self.assertRaises(ValueError, sat.serve, "one", None)


if __name__ == "__main__":
    unittest.main()
