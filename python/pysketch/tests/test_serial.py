"""Serial lines: envelopes, the line's repetitions, and satellites over a pseudo terminal."""

import binascii
import os
import random
import threading
import unittest

from cable import Cable
from hub import Hub, HubTest, Patience
from pysketch import FlowSat, LinkError, Token, connect
from pysketch.envelope import OPEN, Envelope, SlipReader, decode, encode, slip
from pysketch.line import Line
from pysketch.address import Address
from pysketch.relay import Relay
from pysketch.tty import Port


class Envelopes(unittest.TestCase):
    """The bytes on the line."""

    def test_the_bytes_are_the_hubs(self):
        raw = encode(Envelope(OPEN, 2, 1, 2, b"pulse"))
        self.assertEqual(binascii.hexlify(raw), b"12010270756c7365477e376d")
        self.assertEqual(decode(raw), Envelope(OPEN, 2, 1, 2, b"pulse"))

    def test_every_flipped_bit_is_found(self):
        raw = bytearray(encode(Envelope(OPEN, 15, 255, 0, b"\7" * 40)))
        for bit in range(8 * len(raw)):
            raw[bit // 8] ^= 1 << bit % 8
            self.assertIsNone(decode(bytes(raw)))
            raw[bit // 8] ^= 1 << bit % 8

    def test_packets_are_found_whatever_the_pieces(self):
        packets = [b"\xc0\xdb\xdc\xdd", b"plain", b"\xdb"]
        line = b"".join(slip(packet) for packet in packets)
        for size in (1, 2, 3, len(line)):
            reader, found = SlipReader(), []
            for at in range(0, len(line), size):
                found += reader.take(line[at:at + size])
            self.assertEqual(found, packets)
        reader = SlipReader()
        reader.take(b"noise" * 10000)
        self.assertEqual(reader.take(b"\xc0" + slip(b"good")), [None, b"good"])


class Lines(unittest.TestCase):
    """Two ends in one process, with a line between that loses and damages, in time of its own."""

    def carry(self, seed, damage):
        """Sends both ways over a bad line; answers what came."""
        chance, now = random.Random(seed), 0.0
        ends = (Line(now, 115200), Line(now, 115200, listens=True))
        sent = (b"".join(bytes(bytearray([chance.randrange(256)])) for _ in range(20000)), b"\xc0\xdb" * 9000)
        rest, got, numbers = list(sent), [bytearray(), bytearray()], [None, None]
        view = memoryview(bytearray(700))
        while now < 600 and not (bytes(got[1]) == sent[0] and bytes(got[0]) == sent[1]):
            now += 0.02
            for at, end in enumerate(ends):
                end.tick(now)
                if numbers[at] is None:
                    numbers[at] = end.open() if at == 0 else end.opened.popleft() if end.opened else None
                stream = end.streams.get(numbers[at])
                if stream is not None:
                    rest[at] = rest[at][stream.write(rest[at]):]
                    got[at] += view[:stream.read(view)].tobytes()
                for packet in iter(lambda: end.output(now), None):
                    raw = bytearray(packet)
                    if chance.random() < damage:
                        raw[chance.randrange(len(raw))] ^= 0x10
                    if chance.random() >= damage:
                        ends[1 - at].receive(bytes(raw), now)
        return sent, [bytes(part) for part in got]

    def test_a_bad_line_delivers_everything_in_order(self):
        for seed, damage in ((1, 0.0), (2, 0.02), (3, 0.05), (4, 0.05)):
            sent, got = self.carry(seed, damage)
            self.assertEqual((got[1] == sent[0], got[0] == sent[1]), (True, True), "seed %d" % seed)

    def test_without_acknowledgement_the_line_goes_down_and_calls_again(self):
        caller, listener, now = Line(0.0, 115200), Line(0.0, 115200, listens=True), 0.0
        while not (caller.up and listener.up):
            now += 0.1
            for end, other in ((caller, listener), (listener, caller)):
                end.tick(now)
                for packet in iter(lambda: end.output(now), None):
                    other.receive(packet, now)
        self.assertIsNotNone(caller.open())
        while caller.up and now < 60:
            now += 0.1
            caller.tick(now)
            while caller.output(now):
                pass
        self.assertFalse(caller.up)
        self.assertEqual((caller.streams, caller.due(now)), ({}, 0))
        caller.tick(now)
        self.assertIsNotNone(caller.output(now))


class OverAPseudoTerminal(HubTest):
    """Satellites at one end, the relay to a real hub at the other."""

    def setUp(self):
        HubTest.setUp(self)
        near, far = os.openpty()
        self.addCleanup(os.close, far)
        self.address = "tty:%s?baud=115200" % os.ttyname(far)
        self.token = Token.read(self.hub.token)
        self.relay = Relay(Port(near, "near", 115200, listens=True), Address(self.hub.unix))
        thread = threading.Thread(target=self.relay.run)
        thread.start()

        def end():
            self.relay.stop()
            thread.join()
            self.relay.close()
        self.addCleanup(end)

    def test_a_satellite_talks_and_a_question_shares_its_line(self):
        sat, got, long_ = self.keep(FlowSat(self.address, interval=0.01, credentials=self.token)), [], os.urandom(30000)
        stream = sat.stream("serial", format="bytes")
        sat.subscribe("robot.serial", lambda message: got.append(message.payload))
        self.until(lambda: stream.listened, sat)
        for payload in (b"", b"\xc0\xdb", long_):
            self.assertTrue(stream.publish_bytes(payload))
        self.until(lambda: len(got) == 3, sat)
        self.assertEqual(got, [b"", b"\xc0\xdb", long_])
        with connect(self.address, self.token) as hub:
            self.assertIn(u"robot.serial", [channel.name for channel in hub.channels()])
        stream.publish_bytes(b"still here")
        self.until(lambda: len(got) == 4, sat)

    def test_a_silent_line_is_said_in_words(self):
        with self.assertRaises(LinkError) as caught:
            FlowSat("tty:/dev/null", credentials=self.token).connect()
        self.assertIn("/dev/null", str(caught.exception))
        self.assertRaises(LinkError, Address, "tty:/dev/ttyS0?baud=fast")


class AtTheHubsOwnDoor(Patience):
    """Satellites at one end of a cable, at the other a hub that listens there by itself."""

    def begin(self, **cable):
        """A cable and a hub at its far end."""
        self.cable = Cable(**cable)
        self.addCleanup(self.cable.close)
        near, far = self.cable.ends
        self.hub = self.keep_hub(Hub("--without", "host", "--listen", "tty:%s?baud=115200" % far))
        self.address, self.token = "tty:%s?baud=115200" % near, Token.read(self.hub.token)
        return self.keep(FlowSat(self.address, interval=0.01, credentials=self.token))

    def test_a_flow_a_service_and_a_question_share_the_line(self):
        sat, got, replies = self.begin(), [], []
        stream = sat.stream("serial", format="bytes")
        sat.subscribe("robot.serial", lambda message: got.append(message.payload))
        sat.serve("half", lambda request: request.value / 2.0)
        self.until(lambda: stream.listened, sat)
        sent = [b"", b"\xc0\xdb\xdc\xdd" * 300, os.urandom(20000)]
        for payload in sent:
            self.assertTrue(stream.publish_bytes(payload))
        sat.call("robot.half", 7, replies.append, within=60)
        self.until(lambda: len(got) == len(sent) and replies, sat)
        self.assertEqual((got, replies[0].value), (sent, 3.5))
        with self.pulsing(sat), connect(self.address, self.token) as hub:
            self.assertIn(u"robot.serial", [channel.name for channel in hub.channels()])
            self.assertEqual(hub.call("robot.half", 3), 1.5)

    def test_a_bad_cable_loses_nothing(self):
        sat, got = self.begin(damage=0.03), []
        stream = sat.stream("noisy", format="bytes")
        sat.subscribe("robot.noisy", lambda message: got.append(message.payload), policy="all", depth=64)
        self.until(lambda: stream.listened, sat)
        sent = [os.urandom(700) for _ in range(40)]
        for payload in sent:
            self.assertTrue(stream.publish_bytes(payload))
        self.until(lambda: len(got) == len(sent), sat)
        self.assertEqual(got, sent)
        self.assertGreater(self.cable.damaged, 0)

    def test_a_hub_that_comes_back_is_found_on_the_same_line(self):
        sat, lost, got = self.begin(), [], []
        sat.on_lost = lost.append
        sat.subscribe("robot.again", lambda message: got.append(message.value))
        stream = sat.stream("again")
        self.until(lambda: stream.listened, sat)
        self.hub.kill()
        self.until(lambda: lost, sat)
        self.hub.start()
        self.until(lambda: stream.listened, sat)
        stream.publish(7)
        self.until(lambda: got == [7], sat)


if __name__ == "__main__":
    unittest.main()
