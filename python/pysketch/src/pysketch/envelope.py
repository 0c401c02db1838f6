"""What travels on a serial line: envelopes between the end marks of SLIP (RFC 1055)."""

import struct
import zlib
from collections import namedtuple

STREAMS = 16
PAYLOAD_BYTES_MAX = 1024
DATA, OPEN, CLOSE, CREDIT, ACK, AGAIN, HELLO, WELCOME, CONFIRM, RESET = range(10)
NUMBERED = (DATA, OPEN, CLOSE, CREDIT)

_HEAD_BYTES, _CHECK = 3, struct.Struct("<I")
_ENVELOPE_BYTES_MAX = _HEAD_BYTES + PAYLOAD_BYTES_MAX + _CHECK.size
_END, _ESCAPE = b"\xc0", b"\xdb"

Envelope = namedtuple("Envelope", "kind stream number ack payload")


def encode(envelope):
    """The bytes of an envelope, before SLIP."""
    kind, stream, number, ack, payload = envelope
    raw = struct.pack("<BBB", kind << 4 | stream, number, ack) + payload
    return raw + _CHECK.pack(zlib.crc32(raw) & 0xffffffff)


def decode(raw):
    """The envelope of these bytes; None for what is damaged or none at all."""
    if not _HEAD_BYTES + _CHECK.size <= len(raw) <= _ENVELOPE_BYTES_MAX:
        return None
    checked, check = raw[:-_CHECK.size], raw[-_CHECK.size:]
    if zlib.crc32(checked) & 0xffffffff != _CHECK.unpack(check)[0]:
        return None
    first, number, ack = struct.unpack("<BBB", checked[:_HEAD_BYTES])
    if first >> 4 > RESET:
        return None
    return Envelope(first >> 4, first & 0x0f, number, ack, checked[_HEAD_BYTES:])


def slip(raw):
    """A packet for the line, with an end mark on either side."""
    return _END + raw.replace(_ESCAPE, b"\xdb\xdd").replace(_END, b"\xdb\xdc") + _END


class SlipReader(object):
    """Finds packets in the bytes of a line."""

    def __init__(self):
        self._held = b""

    def take(self, data):
        """The packets that these bytes complete: a list of bytes; None stands for a damaged one."""
        pieces = (self._held + data).split(_END)
        self._held = pieces.pop()
        if len(self._held) > 2 * _ENVELOPE_BYTES_MAX:
            # No packet is so long: what comes before the next end mark is noise. A bad escape marks it as such.
            self._held = b"\xdb"
        return [_unslipped(piece) for piece in pieces if piece]


def _unslipped(piece):
    if _ESCAPE not in piece:
        return piece
    parts = piece.split(_ESCAPE)
    out = [parts[0]]
    for part in parts[1:]:
        if part[:1] == b"\xdc":
            out.append(_END)
        elif part[:1] == b"\xdd":
            out.append(_ESCAPE)
        else:
            return None
        out.append(part[1:])
    return b"".join(out)
