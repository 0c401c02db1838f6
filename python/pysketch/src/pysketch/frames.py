"""Frames: bytes on the wire and what they say.

A frame is kind (u8), flags (u8), length (u32) and a body that begins with a tag (u32); all numbers are
little-endian. Layouts come from `table`, so they are the hub's own.
"""

import struct

from . import table
from .variant import PYTHON2

HEADER = struct.Struct("<BBI")
TAG = struct.Struct("<I")
HEADER_BYTES, TAG_BYTES = 6, 4
FIRST, LAST, ABORT = 1, 2, 4
WHOLE = FIRST | LAST

# No event is longer: a value of 1 MiB with its key, or properties as JSON, and a fragment.
BODY_BYTES_MAX = 2 * 1024 * 1024

_U16 = struct.Struct("<H")
_VALUE = struct.Struct("<BI")
_CHANNEL = struct.Struct("<hH")
_FIXED = {
    "u8": struct.Struct("<B"), "u16": _U16, "u32": TAG, "u64": struct.Struct("<Q"), "i16": struct.Struct("<h"),
    "form": struct.Struct("<B"), "policy": struct.Struct("<B"), "kind of channel": struct.Struct("<B"),
    "8 bytes": struct.Struct("8s"), "16 bytes": struct.Struct("16s"), "32 bytes": struct.Struct("32s"),
}
_TEXT_MAX = {"string": 255, "path": 1024}

DATA = table.EVENTS["data"][0]
# Kind, flags, length, tag, channel (here one number, its key), message.
_DATA_FRAME = struct.Struct("<BBIIII")
DATA_HEAD_BYTES = _DATA_FRAME.size
_DATA_FIELDS_BYTES = DATA_HEAD_BYTES - HEADER_BYTES


def key_of(reference):
    """A channel's identifier and epoch as the one number that runs of data come with."""
    return reference[0] & 0xffff | reference[1] << 16


class ProtocolError(Exception):
    """What no honest hub sends. The connection is of no more use."""


def encode(command, tag, values, flags=0):
    """A frame of the command of that name, with the fields in the order of the table.

    A `channel` is a pair (identifier, epoch), a `value` a pair (form, bytes), a `payload` any bytes; text may
    be longer than its limit only to be cut, as the hub does. Returns bytes.
    """
    return _encode(table.COMMANDS, command, tag, values, flags)


def encode_event(event, tag, values, flags=0):
    """As `encode`, of an event: what a hub sends. For tests and for other hubs."""
    return _encode(table.EVENTS, event, tag, values, flags)


def _encode(lines, name, tag, values, flags):
    kind, _, _, fields = lines[name]
    body = bytearray(TAG.pack(tag))
    for (field, wire), value in zip(fields, values):
        _write(body, wire, value)
    return HEADER.pack(kind, flags, len(body)) + bytes(body)


def _write(body, wire, value):
    layout = _FIXED.get(wire)
    if layout is not None:
        body += layout.pack(value)
    elif wire in _TEXT_MAX:
        raw = value if isinstance(value, bytes) else value.encode("utf-8")
        most = _TEXT_MAX[wire]
        if len(raw) > most:
            raw = raw[:most].decode("utf-8", "ignore").encode("utf-8")
        body += _U16.pack(len(raw))
        body += raw
    elif wire == "channel":
        body += _CHANNEL.pack(*value)
    elif wire == "value":
        form, raw = value
        body += _VALUE.pack(form, len(raw))
        body += raw
    else:
        body += value


def publish_head(channel, message, flags, length):
    """What stands before the payload of a `publish` with a payload of that length."""
    return _PUBLISH.pack(_PUBLISH_KIND, flags, _PUBLISH_FIELDS + length, 0, channel[0], channel[1], message)


_PUBLISH_KIND = table.COMMANDS["publish"][0]
_PUBLISH = struct.Struct("<BBIIhHI")
_PUBLISH_FIELDS = _PUBLISH.size - HEADER_BYTES

_KINDS = dict((line[0], (name, line[1], line[3])) for name, line in table.EVENTS.items())
_COMMAND_KINDS = dict((line[0], (name, line[1], line[3])) for name, line in table.COMMANDS.items())


def decode(kind, flags, body, kinds=_KINDS):
    """What an event says: (name, tag, flags, fields). `body` is a memoryview of tag and fields."""
    try:
        name, fragment, fields = kinds[kind]
    except KeyError:
        raise ProtocolError("no event has the kind 0x%02x" % kind)
    if flags and not fragment:
        raise ProtocolError("%s with flags" % name)
    try:
        tag = TAG.unpack_from(body, 0)[0]
        at, values = TAG_BYTES, []
        for _, wire in fields:
            value, at = _read(body, at, wire)
            values.append(value)
    except struct.error:
        raise ProtocolError("%s ends inside a field" % name)
    if at != len(body):
        raise ProtocolError("%s has %d bytes after its last field" % (name, len(body) - at))
    return name, tag, flags, values


def decode_command(kind, flags, body):
    """As `decode`, of a command."""
    return decode(kind, flags, body, _COMMAND_KINDS)


def _read(body, at, wire):
    layout = _FIXED.get(wire)
    if layout is not None:
        return layout.unpack_from(body, at)[0], at + layout.size
    if wire in _TEXT_MAX:
        count = _U16.unpack_from(body, at)[0]
        raw = _take(body, at + 2, count)
        try:
            return raw.decode("utf-8"), at + 2 + count
        except UnicodeDecodeError:
            raise ProtocolError("a %s that is not UTF-8" % wire)
    if wire == "channel":
        return _CHANNEL.unpack_from(body, at), at + 4
    if wire == "value":
        form, count = _VALUE.unpack_from(body, at)
        if form > 1:
            raise ProtocolError("a value of form %d, which does not exist" % form)
        return (form, _take(body, at + 5, count)), at + 5 + count
    return body[at:].tobytes(), len(body)


def _take(body, at, count):
    if len(body) - at < count:
        raise struct.error("short")
    return body[at:at + count].tobytes()


class FrameReader(object):
    """Finds frames in received bytes.

    Bytes are received straight into the reader's buffer (`room`, then `received`); a payload is copied once,
    when it is handed on. The buffer grows with what was received, never with what was announced.
    """

    def __init__(self, size=256 * 1024):
        self._buffer = bytearray(size)
        self._view = memoryview(self._buffer)
        self._start = self._end = 0

    def room(self):
        """A writable view to receive into; never empty."""
        left = len(self._buffer) - self._end
        if not left or self._start and left < len(self._buffer) // 4:
            self._make_room()
        return self._view[self._end:]

    def _make_room(self):
        held = self._end - self._start
        if self._start == 0 or held > len(self._buffer) // 2:
            grown = bytearray(2 * len(self._buffer))
            grown[:held] = self._view[self._start:self._end]
            self._buffer, self._view = grown, memoryview(grown)
        else:
            self._view[:held] = self._view[self._start:self._end].tobytes()
        self._start, self._end = 0, held

    def received(self, count):
        """Says that `count` bytes of the last room are filled."""
        self._end += count

    def feed(self, data):
        """Adds bytes that were received elsewhere."""
        data = memoryview(data)
        while len(data):
            room = self.room()
            count = min(len(room), len(data))
            room[:count] = data[:count]
            self.received(count)
            data = data[count:]

    def pending(self):
        """How many bytes wait for the rest of their frame."""
        return self._end - self._start

    def take(self, on_run, on_event):
        """Hands out all whole frames. Whole messages that stand one after the other on one channel come
        together, as `on_run(channel key, list of payloads)`, everything else as
        `on_event(name, tag, flags, fields)`. Both answer whether to go on. What was handed out is not handed out
        again, whatever a handler raises."""
        while True:
            channel, payloads = self._run()
            if payloads:
                if not on_run(channel, payloads):
                    return
                continue
            event = self._event()
            if event is None or not on_event(*event):
                return

    def _run(self):
        buffer, view, start, end = self._buffer, self._view, self._start, self._end
        unpack, channel, payloads = _DATA_FRAME.unpack_from, None, []
        while end - start >= DATA_HEAD_BYTES:
            kind, flags, length, _, of, _ = unpack(buffer, start)
            after = start + HEADER_BYTES + length
            if kind != DATA or flags != WHOLE or after > end or length < _DATA_FIELDS_BYTES or of != channel and payloads:
                break
            payloads.append(view[start + DATA_HEAD_BYTES:after].tobytes())
            channel, start = of, after
        self._advance(start)
        return channel, payloads

    def _event(self):
        start = self._start
        if self._end - start < HEADER_BYTES:
            return None
        kind, flags, length = HEADER.unpack_from(self._buffer, start)
        if length > BODY_BYTES_MAX:
            raise ProtocolError("a frame of %d bytes" % length)
        body, after = start + HEADER_BYTES, start + HEADER_BYTES + length
        if after > self._end:
            return None
        event = decode(kind, flags, self._view[body:after])
        self._advance(after)
        return event

    def _advance(self, start):
        self._start = start
        if start == self._end:
            self._start = self._end = 0


class Gathering(object):
    """Messages in pieces, one under way for each key: a channel, or the tag of a call."""

    def __init__(self):
        self._unfinished = {}

    def take(self, key, message, flags, piece):
        """The whole message as bytes when `piece` ends it, else None."""
        if flags == WHOLE:
            if key in self._unfinished:
                raise ProtocolError("a message begins inside another")
            return piece
        if flags & ABORT:
            self._unfinished.pop(key, None)
            return None
        if flags & FIRST:
            if key in self._unfinished:
                raise ProtocolError("a message begins inside another")
            self._unfinished[key] = (message, [piece])
            return None
        begun = self._unfinished.get(key)
        if begun is None or begun[0] != message:
            raise ProtocolError("a fragment that continues no message")
        begun[1].append(piece)
        if flags & LAST:
            del self._unfinished[key]
            return b"".join(begun[1])
        return None

    def forget(self, key):
        """Forgets what is unfinished under a key."""
        self._unfinished.pop(key, None)


def as_bytes(piece):
    """Bytes of whatever holds bytes: in Python 2 the text of a memoryview is not its content."""
    return piece.tobytes() if isinstance(piece, memoryview) else bytes(piece)


def cut(payload, most):
    """The fragments of a message as (flags, piece), without copying."""
    view = payload if isinstance(payload, memoryview) else memoryview(payload)
    if len(view) <= most:
        return [(WHOLE, payload)]
    pieces = []
    for at in range(0, len(view), most):
        last = at + most >= len(view)
        pieces.append(((FIRST if at == 0 else 0) | (LAST if last else 0), view[at:at + most]))
    return pieces


if PYTHON2:
    # struct of Python 2.7 does not take a memoryview.
    def _buffered(layout):
        class Buffered(object):
            size = layout.size
            pack = layout.pack

            @staticmethod
            def unpack_from(data, at=0):
                if isinstance(data, memoryview):
                    return layout.unpack_from(data[at:at + layout.size].tobytes(), 0)
                return layout.unpack_from(data, at)
        return Buffered

    _U16, _VALUE, _CHANNEL, TAG = _buffered(_U16), _buffered(_VALUE), _buffered(_CHANNEL), _buffered(TAG)
    _FIXED = dict((name, _buffered(layout)) for name, layout in _FIXED.items())
