"""Streaming channels of one's own: publishing, credit, latch, and repeating another channel."""

from . import table
from .channels import OwnChannel
from .connection import Refused
from .flow import Part
from .variant import BINARY, JSON, pack

# What a fragment costs of a reliable channel's credit beyond its payload.
FRAGMENT_COST_BYTES = 64


class Stream(OwnChannel):
    """A streaming channel of one's own. `publish` sends while somebody listens (or, with `latch=True`, always).

    With `delivery="reliable"` the hub gives credit, and `publish` answers False while there is none left.
    `source` is the full name of the channel that this one repeats, or None; `repeating` whether it does just now.
    """

    command = "create_stream"

    def __init__(self, flow, name, properties):
        OwnChannel.__init__(self, flow, name, properties)
        self.losses, self.source, self.repeating = 0, None, False
        self._message, self._used, self._credit = 0, 0, 0

    @property
    def reliable(self):
        """Whether it waits for its slowest listener."""
        return self.properties.get("delivery") == "reliable"

    @property
    def wanted(self):
        """Whether what is published now would be sent."""
        if self.reference is None or not (self.listened or self.properties.get("latch")) or self.repeating:
            return False
        return not self.reliable or self._used < self._credit

    def publish(self, value):
        """Publishes a value as a variant (JSON if `format` is `json`); answers whether it was sent."""
        if not self.wanted:
            return self._unsent()
        form = JSON if self.properties.get("format") == "json" else BINARY
        return self.publish_bytes(pack(value, form))

    def publish_bytes(self, payload):
        """Publishes bytes as they are; answers whether they were sent. More than 4 KiB are not copied: they must
        not change until `waiting` of the satellite is 0."""
        if not self.wanted:
            return self._unsent()
        connection, length = self.flow.connection, len(payload)
        if length > connection.message_bytes:
            raise ValueError("a message of %d bytes; at most %d are possible" % (length, connection.message_bytes))
        if connection.waiting + length > table.CONNECTION_BYTES_MAX:
            return self._unsent()
        self._message = (self._message + 1) & 0xffffffff
        fragments = max(1, -(-length // connection.fragment_bytes))
        self._used += length + FRAGMENT_COST_BYTES * fragments
        connection.publish(self.reference, self._message, payload)
        return True

    @property
    def credit_left(self):
        """How many bytes may still be published on a reliable stream, each fragment counted with `FRAGMENT_COST_BYTES` more."""
        return self._credit - self._used

    def send_frames(self, frames, cost):
        """Sends `publish` frames that were made beforehand and cost so much of the credit: for `bench`."""
        self._used += cost
        self.flow.connection.send_frames(frames)

    def _unsent(self):
        # What nobody wants is not lost.
        if self.flow.connection is None or self.listened and not self.repeating:
            self.losses += 1
        return False

    def repeat(self, source):
        """Repeats the channel of this full name from now on, whenever it exists."""
        self.source = source
        if self.repeating:
            self._stop_attached()
        else:
            self.begin_repeating()

    def stop_repeating(self):
        """Repeats no more."""
        self.source = None
        if self.repeating:
            self._stop_attached()

    def _stop_attached(self):
        self.flow.command("detach", self.reference, about=self.name)

    # ---- for the flow ----

    def exists(self, channel):
        OwnChannel.exists(self, channel)
        self._used = self._credit = 0
        self.begin_repeating()

    def lost(self):
        OwnChannel.lost(self)
        self.repeating = False

    def begin_repeating(self):
        """Attaches, if both channels exist."""
        source = self.flow.channels.named(self.source, "stream") if self.source and self.flow.ready else None
        if source is not None and self.reference is not None and not self.repeating:
            self.flow.ask(self._repeats, "attach", self.reference, source.reference, about=self.name)

    def _repeats(self, answer):
        # `Attached`: the hub has kept a tie over a loss of the link, and tells that too. `Gone`: the source may come back.
        if isinstance(answer, Refused) and answer.code not in ("Attached", "Gone", "Lost"):
            self.flow.listener.on_refused(answer)

    def attached(self, source):
        """The hub repeats that source. It may be another than is wanted: one of before a loss of the link."""
        self.repeating, wanted = True, self.flow.channels.named(self.source) if self.source else None
        if wanted is None or wanted.reference != source:
            self._stop_attached()

    def detached(self, asked):
        """The hub repeats nothing any more, because it was asked or because the source has gone: then it is repeated again
        when it comes back."""
        self.repeating = False
        if asked:
            self.begin_repeating()

    def credited(self, total):
        """The hub says how many bytes may be published since the channel was opened, in all."""
        self._credit = total


class Streams(Part):
    """What the hub tells about streams of one's own."""

    def __init__(self, flow):
        self._flow = flow
        self.events = {"credit": self._on_credit, "attached": self._on_attached, "detached": self._on_detached}

    def _all(self):
        return [own for own in self._flow.own.values() if isinstance(own, Stream)]

    def restore(self):
        for stream in self._all():
            stream.begin_repeating()

    def channel_added(self, channel):
        for stream in self._all():
            if stream.source == channel.name:
                stream.begin_repeating()

    def _on_credit(self, _tag, _flags, fields):
        stream = self._flow.own_of(fields[0])
        if stream is not None:
            stream.credited(fields[1])

    def _on_attached(self, _tag, _flags, fields):
        stream = self._flow.own_of(fields[0])
        if stream is not None:
            stream.attached(tuple(fields[1]))

    def _on_detached(self, tag, _flags, fields):
        stream = self._flow.own_of(fields[0])
        if stream is not None:
            stream.detached(tag != 0)
