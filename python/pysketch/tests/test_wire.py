"""The bytes: golden vectors that are shared with the hub, and what is no frame."""

import os
import struct
import unittest

from pysketch import login, table, variant
from pysketch.frames import (
    ABORT, FIRST, HEADER, LAST, WHOLE, FrameReader, Gathering, ProtocolError, as_bytes, cut, decode, decode_command, encode,
    encode_event,
)

VECTORS = os.path.join(os.path.dirname(__file__), "..", "..", "..", "docs", "flow-vectors.txt")


def vectors():
    """The golden vectors: (name, bytes)."""
    with open(VECTORS) as file:
        for line in file:
            if not line.startswith("#"):
                name, _, digits = line.strip().partition(" ")
                yield name, bytes(bytearray.fromhex(u"%s" % digits))


class GoldenVectors(unittest.TestCase):
    """What the hub writes is what this package reads and writes."""

    def test_every_frame_is_read_and_written_alike(self):
        seen = set()
        for name, raw in vectors():
            side = name.partition(".")[0]
            if side not in ("command", "event"):
                continue
            kind, flags, length = HEADER.unpack_from(raw, 0)
            self.assertEqual(length, len(raw) - 6, name)
            read, write = (decode_command, encode) if side == "command" else (decode, encode_event)
            found, tag, _, fields = read(kind, flags, memoryview(raw)[6:])
            self.assertEqual(write(found, tag, fields, flags), raw, name)
            seen.add(found if side == "command" else "event " + found)
        wanted = set(table.COMMANDS) | set("event " + name for name in table.EVENTS)
        self.assertEqual(seen, wanted)

    def test_every_command_is_spoken(self):
        folder, spoken = os.path.dirname(os.path.abspath(table.__file__)), ""
        for name in os.listdir(folder):
            if name.endswith(".py") and name != "table.py":
                with open(os.path.join(folder, name)) as file:
                    spoken += file.read()
        unspoken = set(name for name in table.COMMANDS if '"%s"' % name not in spoken)
        # Datagrams are for publishers that can do without Python.
        self.assertEqual(unspoken, set(["udp_open"]))

    def test_every_kind_of_variant_is_read(self):
        expected = {
            "null": None, "bool": True, "i8": -1, "i16": -2, "i32": -3, "i64": -4, "u8": 1, "u16": 2, "u32": 3,
            "u64": 4, "f32": 1.5, "f64": -0.25, "string": u"pulse", "list": [1, 2], "map": {u"a": None, u"b": False},
            "bytes": variant.BYTES_OUT(b"\x00\xff"),
        }
        found = dict((name[8:], variant.decode(raw)) for name, raw in vectors() if name.startswith("variant."))
        self.assertEqual(found, expected)

    def test_numbers_of_every_width_are_written_alike(self):
        raws = dict(vectors())
        for kind, value in (("i8", -1), ("i16", -2), ("i32", -3), ("u8", 1), ("u16", 2), ("u32", 3), ("u64", 4), ("f32", 1.5)):
            self.assertEqual(variant.encode(variant.Typed(kind, value)), raws["variant." + kind])

    def test_the_proofs_of_the_token_are_the_hubs(self):
        raws = dict(vectors())
        token = login.Token(raws["login.token"])
        nonces = raws["login.client_nonce"], raws["login.hub_nonce"]
        self.assertEqual(token.client_proof(*nonces), raws["login.client_proof"])
        self.assertEqual(token.hub_proof(*nonces), raws["login.hub_proof"])


class Variants(unittest.TestCase):
    """Python's values and the wire's."""

    def test_what_is_written_reads_back_in_both_forms(self):
        value = {u"a": [1, -2, 2 ** 63, 1.5, u"\u00e4", None, True], u"b": {u"c": variant.BYTES_OUT(b"\x00\xff")}}
        for form in (variant.BINARY, variant.JSON):
            self.assertEqual(variant.unpack(form, variant.pack(value, form)), value)

    def test_what_cannot_be_sent_says_so(self):
        for value in (object(), {1: 2}, 2 ** 64, variant.Typed("u8", 256)):
            self.assertRaises(variant.VariantError, variant.encode, value)
        deep = []
        for _ in range(70):
            deep = [deep]
        self.assertRaises(variant.VariantError, variant.encode, deep)

    def test_bytes_that_are_no_variant_are_refused(self):
        good = variant.encode({u"a": [1, u"x"], u"b": None})
        for at in range(len(good)):
            self.assertRaises(variant.VariantError, variant.decode, good[:at])
        for bad in (b"\x01\x02", b"\x10", good + b"\0", b"\x0e\xff\xff\xff\xff", b"\x0c\x01\0\0\0\xff"):
            self.assertRaises(variant.VariantError, variant.decode, bad)

    def test_keys_out_of_order_are_refused(self):
        entry = lambda key: struct.pack("<I", 1) + key + b"\0"
        self.assertRaises(variant.VariantError, variant.decode, b"\x0f\x02\0\0\0" + entry(b"b") + entry(b"a"))


class Frames(unittest.TestCase):
    """Bytes in whatever pieces they come."""

    def test_frames_are_found_whatever_the_pieces(self):
        raws = [raw for name, raw in vectors() if name.startswith("event.") and ".abort" not in name]
        stream = b"".join(raws)
        for size in (1, 2, 3, 7, 64, 1000, len(stream)):
            reader, count = FrameReader(64), [0]

            def run(_, payloads):
                count[0] += len(payloads)
                return True

            def event(*_):
                count[0] += 1
                return True
            for at in range(0, len(stream), size):
                reader.feed(stream[at:at + size])
                reader.take(run, event)
            self.assertEqual((count[0], reader.pending()), (len(raws), 0), "pieces of %d" % size)

    def test_garbage_is_an_error_and_nothing_else(self):
        data = bytearray(os.urandom(4096))
        for at in range(0, 4000, 13):
            reader = FrameReader(64)
            reader.feed(bytes(data[at:at + 64]))
            try:
                reader.take(lambda *_: True, lambda *_: True)
            except ProtocolError:
                pass

    def test_a_message_is_its_pieces(self):
        payload = os.urandom(1000)
        for most in (1, 7, 999, 1000, 1001):
            gathering = Gathering()
            whole = [gathering.take("x", 1, flags, as_bytes(piece)) for flags, piece in cut(payload, most)]
            self.assertEqual(whole[-1], payload)
            self.assertEqual(set(whole[:-1]), set([None]) if len(whole) > 1 else set())

    def test_fragments_out_of_sequence_are_an_error(self):
        for pieces in ([(0, 1)], [(FIRST, 1), (FIRST, 1)], [(FIRST, 1), (LAST, 2)], [(FIRST, 1), (WHOLE, 1)]):
            gathering = Gathering()
            with self.assertRaises(ProtocolError):
                for flags, message in pieces:
                    gathering.take("x", message, flags, b"-")
        gathering = Gathering()
        gathering.take("x", 1, FIRST, b"-")
        self.assertIsNone(gathering.take("x", 1, ABORT, b""))
        self.assertEqual(gathering.take("x", 2, WHOLE, b"new"), b"new")


class Scram(unittest.TestCase):
    """The exchange of RFC 7677, section 3."""

    def test_the_example_of_the_standard(self):
        # Its rounds are fewer than a hub may ask for.
        self.addCleanup(setattr, login, "ROUNDS_MIN", login.ROUNDS_MIN)
        login.ROUNDS_MIN = 4096
        password = login.Password(u"user", u"pencil")
        password.begin(b"")
        password._nonce, password._first = "rOprNGfwEbeRWgbNEkqO", "n=user,r=rOprNGfwEbeRWgbNEkqO"
        challenge = "r=rOprNGfwEbeRWgbNEkqO%hvYDpWUa2RaTCAfuxFIlj)hNlF$k0,s=W22ZaJ0SNY7soEsUEjb6gQ==,i=4096"
        final = password.prove(challenge)
        self.assertTrue(final.endswith(",p=dHzbZapWIk4jUhN+Ute9ytag9zjfMHgsqmmiz7AndVQ="), final)
        import base64
        self.assertTrue(password.hub_is_true(base64.b64decode("6rriTRBi23WpRR/wtup+mMhUZUn/dB5nLTJRsjl95G4=")))
        self.assertFalse(password.hub_is_true(b"\0" * 32))

    def test_a_hub_that_asks_for_too_few_or_too_many_rounds_is_left(self):
        password = login.Password(u"user", u"pencil")
        password.begin(b"\1" * 18)
        for rounds in (0, 4096, 14999, 1000001, 10 ** 12):
            challenge = "r=%sx,s=W22ZaJ0SNY7soEsUEjb6gQ==,i=%d" % (password._nonce, rounds)
            with self.assertRaises(login.LoginError) as caught:
                password.prove(challenge)
            self.assertIn("%d rounds" % rounds, str(caught.exception))

    def test_a_challenge_for_another_nonce_is_refused(self):
        password = login.Password(u"user", u"pencil")
        password.begin(b"\1" * 18)
        for challenge in ("r=other,s=W22ZaJ0SNY7soEsUEjb6gQ==,i=4096", "", "r=x", password._nonce):
            self.assertRaises(login.LoginError, password.prove, challenge)


if __name__ == "__main__":
    unittest.main()
