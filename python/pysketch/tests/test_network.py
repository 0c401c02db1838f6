"""Satellites and a real hub."""

import os
import unittest

from hub import Hub, HubTest, Patience, free_port
from pysketch import Closed, FlowSat, LinkError, LoginError, Refused, Sketch, Token, connect


class Streams(HubTest):
    """Publishing and subscribing."""

    def test_values_and_bytes_arrive_as_they_were_sent(self):
        sent = [1, -1.5, u"\u00e4", [True, None], {u"x": {u"y": [1, 2]}}]
        got, raw = [], []
        sat = Sketch(self.hub.unix, interval=0.01)
        sat.subscribe("robot.values", lambda message: got.append(message.value))
        sat.subscribe("robot.raw", lambda message: raw.append(message.payload))
        values, bytes_ = sat.stream("values"), sat.stream("raw", format="bytes")
        self.until(lambda: values.listened and bytes_.listened, sat)
        large = os.urandom(3000000)
        for value in sent:
            self.assertTrue(values.publish(value))
        self.assertTrue(bytes_.publish_bytes(large))
        self.until(lambda: len(got) == len(sent) and raw, sat)
        self.assertEqual((got, raw), (sent, [large]))
        sat.close()

    def test_tcp_needs_the_token_and_takes_it(self):
        self.assertRaises(LoginError, FlowSat(self.hub.tcp, credentials=Token(b"\0" * 32)).connect)
        sat = FlowSat(self.hub.tcp, credentials=Token.read(self.hub.token)).connect()
        self.assertEqual(sat.user, u"robot")
        sat.close()

    def test_the_owner_hears_of_the_first_and_the_last_listener(self):
        heard = []
        owner, listener = FlowSat(self.hub.unix, interval=0.01), FlowSat(self.hub.unix, interval=0.01)
        owner.on_start = lambda name: heard.append("start " + name)
        owner.on_stop = lambda name: heard.append("stop " + name)
        owner.stream("pose")
        listener.subscribe("robot.pose")
        self.until(lambda: heard == ["start pose"], owner, listener)
        listener.close()
        self.until(lambda: heard == ["start pose", "stop pose"], owner)
        owner.close()

    def test_nothing_is_sent_while_nobody_listens(self):
        sat = FlowSat(self.hub.unix, interval=0.01).connect()
        stream = sat.stream("lonely")
        self.until(lambda: stream.reference is not None, sat)
        self.assertFalse(stream.publish(1))
        self.assertEqual((sat.waiting, sat.losses), (0, 0))
        sat.close()

    def test_a_second_owner_of_a_name_is_refused(self):
        one, two = FlowSat(self.hub.unix, interval=0.01), FlowSat(self.hub.unix, interval=0.01)
        refused = []
        two.on_refused = refused.append
        first = one.stream("taken")
        self.until(lambda: first.reference is not None, one)
        two.stream("taken")
        self.until(lambda: refused, two)
        self.assertEqual(refused[0].code, "Exists")
        one.close()
        two.close()

    def test_another_hub_that_is_not_there_is_no_loss_of_this_one(self):
        lost, asked = [], []

        def ask_elsewhere(message):
            asked.append(message.value)
            connect("unix:/nowhere/hub.sock")
        sat = self.sat()
        sat.on_lost = lost.append
        stream = sat.stream("trouble")
        sat.subscribe("robot.trouble", ask_elsewhere)
        self.until(lambda: stream.listened, sat)
        stream.publish(1)
        with self.assertRaises(LinkError) as caught:
            self.until(lambda: False, sat)
        self.assertIn("/nowhere", str(caught.exception))
        self.assertEqual((asked, lost, sat.ready), ([1], [], True))

    def test_a_name_that_another_flow_has_is_waited_for(self):
        one, two, lost = self.sat(name="twin"), self.sat(name="twin"), []
        two.on_lost = lost.append
        self.until(lambda: one.ready, one)
        self.until(lambda: lost, two)
        one.close()
        self.until(lambda: two.ready, two)
        self.assertEqual(two.flow_name, u"robot.twin")
        # Said once, however often it was tried.
        self.assertEqual(lost, ["another satellite is called twin"])


class Questions(HubTest):
    """Temporary synchronous connections."""

    def test_channels_are_listed_with_what_they_say(self):
        sat = FlowSat(self.hub.unix, interval=0.01)
        stream = sat.stream("listed", unit="m")
        self.until(lambda: stream.reference is not None, sat)
        with connect(self.hub.unix) as hub:
            found = dict((channel.name, channel) for channel in hub.channels())
            self.assertEqual(hub.user, u"robot")
        self.assertEqual(found["robot.listed"].properties, {u"unit": u"m", u"format": u"variant"})
        self.assertEqual(found["robot.listed"].kind, "stream")
        sat.close()

    def test_a_hub_that_is_not_there_is_said_in_words(self):
        with self.assertRaises(LinkError) as caught:
            connect("tcp:127.0.0.1:%d" % free_port(), credentials=Token(b"\0" * 32))
        self.assertIn("is skrobot running?", str(caught.exception))
        with self.assertRaises(LinkError) as caught:
            connect("robot")
        self.assertIn("tcp:HOST:PORT", str(caught.exception))

    def test_a_connection_that_was_left_alone_asks_on(self):
        with connect(self.hub.unix) as owner:
            owner.create_database("shelf")
            owner.select("shelf").set("cup", 1)
            with connect(self.hub.unix) as hub:
                hub.select("shelf")
                before = hub._connection
                # As if the last answer had come long ago: the hub would have ended it.
                before.heard -= 60
                self.assertEqual(hub.get("cup"), 1)
                self.assertIsNot(hub._connection, before)
                hub._connection.heard -= 60
                owner.remove_database("shelf")
                self.assertRaises(Refused, hub.get, "cup")
                self.assertTrue(hub.channels() is not None)
        with self.assertRaises(Closed) as caught:
            hub.channels()
        self.assertIn("was closed", str(caught.exception))


class Reconnection(Patience):
    """A hub that goes and comes back."""

    def test_everything_is_restored(self):
        hub = Hub("--without", "host")
        got, lost = [], []
        sat = Sketch(hub.unix, interval=0.01)
        sat.lost(lost.append)
        sat.subscribe("robot.again", lambda message: got.append(message.value))
        stream = sat.stream("again")
        self.until(lambda: stream.listened, sat)
        hub.kill()
        self.until(lambda: lost, sat)
        hub.start()
        self.until(lambda: stream.listened, sat)
        stream.publish(7)
        self.until(lambda: got == [7], sat)
        sat.close()
        hub.stop()


if __name__ == "__main__":
    unittest.main()
