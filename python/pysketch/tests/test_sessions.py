"""Broken links: a satellite that comes back takes its own place."""

import unittest

from hub import HubTest, Hub, Patience
from proxy import Proxy
from pysketch import FlowSat, LinkError, Sketch, Token


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
