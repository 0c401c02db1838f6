"""A serial line without its port: bytes and seconds in, bytes and streams out (docs/flow-transports.md).

Numbered envelopes go again, all from the first that is missing, until they are acknowledged; at most seven are
under way. Sixteen byte streams share the line, each with 8 KiB that may be unread at the other side.
"""

import os
import struct
from collections import deque

from .envelope import (
    ACK, AGAIN, CLOSE, CONFIRM, CREDIT, DATA, HELLO, NUMBERED, OPEN, PAYLOAD_BYTES_MAX, RESET, STREAMS, WELCOME, Envelope,
    SlipReader, decode, encode, slip,
)

WINDOW = 7
CREDIT_BYTES = 8 * 1024
DOWN_AFTER_S, CALL_EVERY_S, ANSWER_S = 3.0, 0.25, 0.2
_OUTGOING_BYTES_MAX = 4 * 1024
_BITS_PER_BYTE = 10
_U32 = struct.Struct("<I")


class LineStream(object):
    """One of the byte streams: `incoming` waits to be read here, `outgoing` to be sent."""

    def __init__(self, opening):
        self.incoming, self.outgoing = bytearray(), bytearray()
        self.credit, self._read = CREDIT_BYTES, 0
        self.opening, self.closing, self.closed_here, self.closed_there = opening, False, False, False

    @property
    def room(self):
        """How many bytes `write` would take."""
        return max(0, _OUTGOING_BYTES_MAX - len(self.outgoing))

    def write(self, data):
        """Takes bytes to send; answers how many."""
        taken = data[:self.room]
        self.outgoing += taken
        return len(taken)

    def read(self, view):
        """Fills a view with what came; answers how many bytes."""
        count = min(len(view), len(self.incoming))
        view[:count] = bytes(self.incoming[:count])
        del self.incoming[:count]
        self._read += count
        return count

    def received(self, payload):
        """Bytes came; answers whether the peer may send so many."""
        if self.closed_here or self.closing:
            return True
        if len(self.incoming) + self._read + len(payload) > CREDIT_BYTES:
            return False
        self.incoming += payload
        return True

    def due(self, payload_max):
        """What it has to send next, as (kind, payload), or None."""
        if self.opening:
            self.opening = False
            return OPEN, b""
        if self._read >= CREDIT_BYTES // 2 and not self.closing and not self.closed_there:
            read, self._read = self._read, 0
            return CREDIT, _U32.pack(read)
        count = min(payload_max, len(self.outgoing), self.credit)
        if count:
            payload = bytes(self.outgoing[:count])
            del self.outgoing[:count]
            self.credit -= count
            return DATA, payload
        if self.closing and not self.closed_here and not self.outgoing:
            self.closed_here = True
            return CLOSE, b""
        return None

    @property
    def over(self):
        """Whether both sides have closed it: its number is free."""
        return self.closed_here and self.closed_there


class Line(object):
    """One side of a line: the caller's, or with `listens` the hub's. `streams` are those in use, by number; `opened`
    those that the caller has opened since one looked."""

    def __init__(self, now, baud, listens=False):
        self.streams, self.opened, self.listens = {}, deque(), listens
        bytes_per_second = max(1, baud // _BITS_PER_BYTE)
        # Half a second of line time may be under way, so that a repetition does not come too late to help.
        self._in_flight_max = min(max(128, bytes_per_second // 2), WINDOW * PAYLOAD_BYTES_MAX)
        self._payload_max = min(max(64, self._in_flight_max // WINDOW), PAYLOAD_BYTES_MAX)
        self._repeat_after = ANSWER_S + 2.0 * self._in_flight_max / bytes_per_second
        self._reader, self._turn, self._own = SlipReader(), 0, 0
        self.up = False
        self._forget(now)

    def _forget(self, now):
        before = self._own
        while self._own in (0, before):
            self._own = _U32.unpack(os.urandom(4))[0]
        self._peer, self._call_at, self._owed = None, now, None
        self._base, self._sent, self._gone, self._expected, self._ahead = 0, deque(), 0, 0, 0
        self._moved = self._tried = now
        self.up = False

    # ---- streams ----

    def open(self):
        """A new stream's number, or None while the line is down or all are in use."""
        free = [number for number in range(STREAMS) if number not in self.streams]
        if not self.up or self.listens or not free:
            return None
        self.streams[free[0]] = LineStream(True)
        return free[0]

    def end(self, now):
        """Ends this life of the line; all streams end with it."""
        was_up = self.up
        self._forget(now)
        if was_up and self.listens:
            # A caller that has nothing to send would not find out for long.
            self._owed = RESET
        self.streams = {}
        self.opened.clear()

    # ---- in ----

    def receive(self, data, now):
        """Takes what the port brought."""
        for packet in self._reader.take(data):
            envelope = packet and decode(packet)
            if envelope:
                self._take(envelope, now)

    def _take(self, envelope, now):
        kind = envelope.kind
        if kind == HELLO and self.listens:
            self._on_hello(envelope.payload, now)
        elif kind == WELCOME and not self.listens:
            self._on_welcome(envelope.payload, now)
        elif kind == CONFIRM and self.listens:
            if not self.up and self._peer is not None and envelope.payload == _U32.pack(self._peer) + _U32.pack(self._own):
                self._begin(self._peer, now)
        elif kind == RESET and not self.listens:
            if self.up:
                self.end(now)
        elif kind in (ACK, AGAIN) and self.up:
            self._acknowledged(envelope.ack, now)
            if kind == AGAIN and envelope.ack == self._base and self._gone:
                self._gone, self._tried = 0, now
        elif kind in NUMBERED and self.up:
            self._on_numbered(envelope, now)
        elif kind in NUMBERED and self.listens:
            self._owed = RESET if self._peer is None else WELCOME

    def _on_hello(self, payload, now):
        if len(payload) < 4:
            return
        caller = _U32.unpack(payload[:4])[0]
        if self._peer != caller:
            if self.up:
                self.end(now)
            self._peer = caller
        self._owed = WELCOME

    def _on_welcome(self, payload, now):
        if len(payload) < 8:
            return
        listener, own = struct.unpack("<II", payload[:8])
        if own != self._own or self.up and listener != self._peer:
            if self.up:
                self.end(now)
            return
        if not self.up:
            self._begin(listener, now)
        self._owed = CONFIRM

    def _begin(self, peer, now):
        self._peer, self.up = peer, True
        self._moved = self._tried = now

    def _acknowledged(self, ack, now):
        count = (ack - self._base) & 0xff
        if 0 < count <= len(self._sent):
            for _ in range(count):
                self._sent.popleft()
            self._base, self._gone = ack, max(0, self._gone - count)
            self._moved = self._tried = now

    def _on_numbered(self, envelope, now):
        self._acknowledged(envelope.ack, now)
        ahead = (envelope.number - self._expected) & 0xff
        if ahead == 0:
            self._expected, self._ahead = (self._expected + 1) & 0xff, 0
            self._owed = self._owed or ACK
            if not self._apply(envelope):
                # No honest peer sends it at any timing.
                self.end(now)
        elif ahead < WINDOW:
            before, self._ahead = self._ahead, ahead
            self._owed = AGAIN if before == 0 or ahead <= before else self._owed or ACK
        else:
            self._owed = self._owed or ACK

    def _apply(self, envelope):
        kind, number, payload = envelope.kind, envelope.stream, envelope.payload
        stream = self.streams.get(number)
        if kind == OPEN:
            if stream is not None or not self.listens:
                return False
            self.streams[number] = LineStream(False)
            self.opened.append(number)
            return True
        if stream is None or kind != CREDIT and stream.closed_there:
            return False
        if kind == DATA:
            return stream.received(payload)
        if kind == CLOSE:
            # Nobody will read what still waits here.
            stream.closed_there, stream.outgoing = True, bytearray()
            self._free_if_over(number)
            return True
        if len(payload) < 4:
            return False
        stream.credit = min(stream.credit + _U32.unpack(payload[:4])[0], CREDIT_BYTES)
        return True

    def _free_if_over(self, number):
        if self.streams[number].over:
            del self.streams[number]

    # ---- out ----

    def due(self, now):
        """In how many seconds `tick` has something to do; None: not before something comes."""
        if not self.up:
            return None if self.listens else max(0, self._call_at - now)
        if not self._sent:
            return None
        return max(0, min(self._tried + self._repeat_after, self._moved + DOWN_AFTER_S) - now)

    def tick(self, now):
        """Looks at the time: calls, repeats, and gives the line up."""
        if not self.up:
            if not self.listens and now >= self._call_at:
                self._call_at, self._owed = now + CALL_EVERY_S, HELLO
        elif self._sent and now >= self._moved + DOWN_AFTER_S:
            self.end(now)
        elif self._sent and now >= self._tried + self._repeat_after:
            self._gone, self._tried = 0, now

    def output(self, now):
        """The next packet for the port, or None if there is nothing to say."""
        if self.up and self._owed in (None, ACK):
            if self._gone == len(self._sent):
                self._number_next(now)
            if self._gone < len(self._sent):
                kind, stream, payload = self._sent[self._gone]
                number = (self._base + self._gone) & 0xff
                self._gone, self._owed = self._gone + 1, None
                return slip(encode(Envelope(kind, stream, number, self._expected, payload)))
        return self._say_owed()

    def _say_owed(self):
        kind, self._owed = self._owed, None
        if kind is None:
            return None
        payload = b""
        if kind in (HELLO, WELCOME, CONFIRM):
            payload = _U32.pack(self._own)
        if kind in (WELCOME, CONFIRM):
            payload += _U32.pack(self._peer or 0)
        return slip(encode(Envelope(kind, 0, 0, self._expected, payload)))

    def _number_next(self, now):
        """Gives the next thing that a stream has to send its number; streams take turns."""
        under_way = sum(len(payload) for _, _, payload in self._sent)
        if len(self._sent) >= WINDOW or self._sent and under_way >= self._in_flight_max:
            return
        for offset in range(STREAMS):
            number = (self._turn + offset) % STREAMS
            stream = self.streams.get(number)
            due = stream and stream.due(self._payload_max)
            if due:
                if not self._sent:
                    self._moved = self._tried = now
                self._sent.append((due[0], number, due[1]))
                self._turn = (number + 1) % STREAMS
                self._free_if_over(number)
                return
