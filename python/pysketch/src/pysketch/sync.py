"""Sync channels: making one's pulse everybody's, or following somebody's."""

from .channels import OwnChannel
from .flow import Part
from .subscriptions import Subscription


class TickReport(object):
    """How a target keeps up with a sync channel: `target` is its connection, `lag` in seconds the longest since the
    last report, `done` and `missed` count ticks, `divisor` says which ticks it gets."""

    __slots__ = ("channel", "target", "lag", "done", "missed", "divisor")

    def __init__(self, channel, fields):
        _, self.target, nanos, self.done, self.missed, self.divisor = fields
        self.channel, self.lag = channel, nanos * 1e-9

    def __repr__(self):
        return "<%s to %d: lag %.6f s, %d done, %d missed, divisor %d>" % (
            self.channel.name, self.target, self.lag, self.done, self.missed, self.divisor)


class SyncSource(OwnChannel):
    """A sync channel of one's own: each pulse of the satellite is a tick."""

    command = "create_sync"

    def __init__(self, flow, name, properties):
        OwnChannel.__init__(self, flow, name, properties)
        self.sequence = 0

    def create(self):
        # A channel that the hub kept goes on counting; a new one begins anew.
        self.sequence = 0
        OwnChannel.create(self)

    def tick(self):
        """A pulse of the satellite."""
        if self.listened and self.flow.connection is not None:
            self.sequence += 1
            self.flow.connection.send_untagged("sync_tick", self.reference, self.sequence)


class Following(Part):
    """The sync channel that a satellite follows, if any, and reports about those that follow its own."""

    def __init__(self, flow, subscriptions, on_tick):
        self._flow, self._subscriptions, self._on_tick_of = flow, subscriptions, on_tick
        self.name, self.sequence, self._tick = None, None, None
        self.events = {"tick": self._on_tick, "tick_report": self._on_report}

    def follow(self, name, divisor):
        """Follows the sync channel of this full name."""
        if divisor not in (0, 1, 2, 4):
            raise ValueError("a divisor is 1, 2, 4, or 0 for what the hub finds bearable; not %r" % (divisor,))
        self.name = name
        subscription = Subscription(self._flow, name, None, None, 0, 1)
        subscription.divisor = divisor
        self._subscriptions.add(subscription)

    def leave(self):
        """Follows nobody any more."""
        if self.name is not None:
            self._subscriptions.remove(self.name)
            self.name = self._tick = None

    def lose(self, error):
        self._tick = None

    def done(self):
        """The pulse after a tick is over."""
        if self._tick is not None and self._flow.connection is not None:
            reference, sequence = self._tick
            self._tick = None
            self._flow.connection.send_untagged("tick_done", reference, sequence)

    def _on_tick(self, _tag, _flags, fields):
        if self._subscriptions.of(fields[0]) is not None:
            self._tick, self.sequence = (fields[0], fields[1]), fields[1]
            self._on_tick_of()

    def _on_report(self, _tag, _flags, fields):
        channel = self._flow.channels.of(fields[0])
        if channel is not None:
            self._flow.listener.on_tick_report(TickReport(channel, fields))
