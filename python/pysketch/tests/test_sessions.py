"""Broken links: a satellite that comes back takes its own place."""

import unittest

from hub import HubTest, Hub, Patience
from proxy import Proxy
from pysketch import FlowSat, LinkError, Sketch, Token, connect


class Resumption(HubTest):
    """The link breaks, and the hub does not know it yet."""

    def test_the_session_is_resumed_with_channels_and_subscriptions(self):
        proxy = Proxy(self.hub.tcp)
        self.addCleanup(proxy.close)
        roamer = self.keep(FlowSat(proxy.address, "roamer", Token.read(self.hub.token), interval=0.01))
        listener, got, heard, lost = self.sat(), [], [], []
        roamer.on_lost = lost.append
        stream = roamer.stream("position")
        roamer.subscribe("robot.orders", lambda message: got.append(message.value))
        listener.subscribe("robot.position", lambda message: heard.append(message.value))
        orders = listener.stream("orders")
        both = (roamer, listener)
        self.until(lambda: stream.listened and orders.listened, *both)
        went = []
        listener.on_channel = lambda channel, exists: went.append((channel.name, exists))
        proxy.cut()
        self.until(lambda: lost, roamer)
        self.until(lambda: roamer.ready and stream.listened, *both)
        self.assertTrue(roamer.flow.resumed)
        self.assertEqual((roamer.flow_name, went), (u"robot.roamer", []))
        seen = listener.flow.channels.by_name[u"robot.position"]
        self.until(lambda: seen.owner == roamer.flow.connection.number, *both)
        stream.publish(2)
        orders.publish(u"go home")
        self.until(lambda: heard and got, *both)
        self.assertEqual((heard, got), ([2], [u"go home"]))

    def roamer(self, name="roamer"):
        """A satellite whose link can be cut."""
        proxy = Proxy(self.hub.tcp)
        self.addCleanup(proxy.close)
        sat = self.keep(FlowSat(proxy.address, name, Token.read(self.hub.token), interval=0.01))
        sat.lost, sat.on_lost = [], lambda why: sat.lost.append(why)
        return sat, proxy

    def cut(self, sat, proxy, meanwhile):
        """Cuts its link, does something before it is back, and waits for that."""
        proxy.cut()
        self.until(lambda: sat.lost, sat)
        meanwhile()
        self.until(lambda: sat.ready, sat)
        self.assertTrue(sat.flow.resumed)

    def test_a_source_of_ticks_goes_on_counting(self):
        source, proxy = self.roamer("source")
        target, ticks = self.sat(), []
        beat = source.sync_source("beat")
        target.loop = lambda: ticks.append(target.tick)
        target.sync_to("robot.beat", 1)
        self.until(lambda: len(ticks) >= 3, source, target)
        number = beat.sequence
        self.cut(source, proxy, lambda: None)
        # A number that does not grow would end it: only a liar sends that.
        self.until(lambda: beat.sequence > number and ticks[-1] > number, source, target)
        self.assertEqual((len(source.lost), sorted(set(ticks))), (1, ticks))

    def test_what_was_given_up_meanwhile_is_given_up_at_the_hub(self):
        sat, proxy = self.roamer("fickle")
        owner, refused = self.sat(), []
        sat.on_refused = refused.append
        radio, clock, copied = owner.stream("radio"), owner.sync_source("clock"), owner.stream("copied")
        sat.subscribe("robot.radio")
        sat.sync_to("robot.clock", 1)
        sat.subscribe("robot.copy")
        copy, junk = sat.repeat("copy", "robot.copied"), sat.stream("junk")
        both = (sat, owner)
        self.until(lambda: radio.listened and clock.listened and copied.listened and junk.opened, *both)

        def give_up():
            sat.unsubscribe("robot.radio")
            sat.sync_stop()
            copy.stop_repeating()
            junk.remove()
        self.cut(sat, proxy, give_up)
        self.until(lambda: not (radio.listened or clock.listened or copied.listened or copy.repeating), *both)
        with connect(self.hub.unix) as hub:
            self.patiently(lambda: sat.pulse_once() or "robot.junk" not in [one.name for one in hub.channels()])
        self.assertEqual(refused, [])

    def test_a_replica_that_the_hub_kept_is_no_refusal(self):
        sat, proxy = self.roamer("echoing")
        owner, refused, got = self.sat(), [], []
        sat.on_refused = refused.append
        owner.subscribe("robot.mirror", lambda message: got.append(message.value))
        one, two = owner.stream("one"), owner.stream("two")
        mirror = sat.repeat("mirror", "robot.one")
        both = (sat, owner)
        self.until(lambda: one.listened, *both)
        self.cut(sat, proxy, lambda: None)
        self.until(lambda: mirror.repeating, *both)
        one.publish(1)
        self.until(lambda: got == [1], *both)
        # Another source in its place, with a link and while there is none.
        mirror.repeat("robot.two")
        self.until(lambda: two.listened and not one.listened, *both)
        sat.lost = []
        self.cut(sat, proxy, lambda: mirror.repeat("robot.one"))
        self.until(lambda: one.listened and not two.listened, *both)
        self.assertEqual(refused, [])


class Restoration(Patience):
    """The hub itself goes and comes back with nothing."""

    def test_streams_services_subscriptions_and_waiting_calls_come_back(self):
        hub = self.keep_hub(Hub("--without", "host"))
        got, replies = [], []
        sketch = self.keep(Sketch(hub.unix, interval=0.01))
        stream = sketch.stream("again")
        sketch.subscribe("robot.again", lambda message: got.append(message.value))
        service = sketch.serve("twice", lambda request: 2 * request.value)
        self.until(lambda: stream.listened and service.opened, sketch)
        hub.kill()
        self.until(lambda: not sketch.ready, sketch)
        self.assertFalse(stream.publish(0))
        self.assertEqual(sketch.losses, 1)
        sketch.call("robot.twice", 4, replies.append, within=60)
        hub.start()
        self.until(lambda: stream.listened and replies, sketch)
        stream.publish(1)
        self.until(lambda: got, sketch)
        self.assertEqual((got, replies[0].value, sketch.flow.resumed), ([1], 8, False))

    def test_who_does_not_want_to_wait_gets_an_error(self):
        hub = self.keep_hub(Hub("--without", "host"))
        sat = self.keep(FlowSat(hub.unix, interval=0.01, reconnect=False).connect())
        hub.kill()
        with self.assertRaises(LinkError):
            self.until(lambda: False, sat)

    def test_a_sketch_may_start_before_its_hub(self):
        hub = self.keep_hub(Hub("--without", "host"))
        hub.kill()
        sat = self.keep(FlowSat(hub.unix, interval=0.01))
        set_up = []
        sat.setup = lambda: set_up.append(sat.ready)
        sat.pulse_once()
        self.assertEqual(set_up, [])
        hub.start()
        self.until(lambda: set_up, sat)
        self.assertEqual(set_up, [True])


if __name__ == "__main__":
    unittest.main()
