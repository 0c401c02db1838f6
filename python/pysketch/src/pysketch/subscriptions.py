"""Hearing channels: messages of streams."""

from . import table
from .flow import Part
from .frames import Gathering, key_of
from .variant import JSON, decode, unpack

POLICY_NUMBERS = dict((name, number) for number, name in table.POLICIES.items())


class Message(object):
    """A message of a channel: `payload` are its bytes, `value` what they say."""

    __slots__ = ("channel", "payload")

    def __init__(self, channel, payload):
        self.channel, self.payload = channel, payload

    @property
    def name(self):
        """The full name of the channel."""
        return self.channel.name

    @property
    def value(self):
        """The payload as a value: a variant, or JSON if the channel's `format` says so."""
        form = self.channel.properties.get("format")
        return unpack(JSON, self.payload) if form == "json" else decode(self.payload)

    def array(self, kind=None):
        """The payload as a numpy array, without a copy; `kind` is numpy's name of the numbers, else the
        channel's `format` is. Its shape is one row unless the channel's `shape` says another."""
        import numpy
        properties = self.channel.properties
        found = numpy.frombuffer(self.payload, dtype=numpy.dtype(str(kind or properties["format"])))
        return found.reshape(properties["shape"]) if "shape" in properties else found


class Subscription(object):
    """A channel that is heard. `dropped` counts the messages that were lost, by reason; `live` is whether the hub
    sends them just now."""

    def __init__(self, flow, name, on_message, on_batch, policy, depth):
        self.flow, self.name, self.on_message, self.on_batch = flow, name, on_message, on_batch
        self.policy, self.depth, self.divisor = policy, depth, 1
        self.dropped, self.live, self.cancelled = {}, False, False

    def begin(self):
        """Subscribes, if the channel exists."""
        channel = self.flow.channels.named(self.name)
        if channel is not None and channel.kind in ("stream", "sync"):
            self.flow.ask(self._answered, "subscribe", channel.reference, self.policy, self.depth, self.divisor,
                          about=self.name)

    def _answered(self, answer):
        if isinstance(answer, Exception):
            self.live = False
            if answer.code not in ("Gone", "Lost"):
                self.flow.listener.on_refused(answer)
        else:
            self.live = True

    def hear(self, channel, payloads):
        """Messages came."""
        if self.on_batch is not None:
            return self.on_batch(channel, payloads)
        on_message = self.on_message
        for payload in payloads:
            if self.cancelled:
                return
            on_message(Message(channel, payload))


class Subscriptions(Part):
    """All of them."""

    def __init__(self, flow):
        self._flow, self.by_name, self._by_key, self._gathering = flow, {}, {}, Gathering()
        # Given up while there was no hub: one that takes this satellite for the one before has them still.
        self._renounced = set()
        flow.on_run = self._on_run
        self.events = {"data": self._on_fragment, "dropped": self._on_dropped, "unsubscribed": self._on_unsubscribed}

    def add(self, subscription):
        """Begins to hear a channel, or changes how."""
        self._renounced.discard(subscription.name)
        self.by_name[subscription.name] = subscription
        if self._flow.ready:
            self._begin(subscription)
        return subscription

    def remove(self, name):
        """Ends hearing it."""
        subscription = self.by_name.pop(name, None)
        if subscription is None:
            return
        subscription.cancelled = True
        if self._flow.ready:
            self._end(name)
        else:
            self._renounced.add(name)

    def _end(self, name):
        channel = self._flow.channels.named(name)
        if channel is not None:
            self._by_key.pop(channel.key, None)
            self._flow.command("unsubscribe", channel.reference, about=name)

    def of(self, reference):
        """The subscription to the channel of this identifier and epoch."""
        found = self._by_key.get(key_of(reference))
        return found and found[1]

    def _begin(self, subscription):
        channel = self._flow.channels.named(subscription.name)
        if channel is not None:
            self._by_key[channel.key] = (channel, subscription)
            subscription.begin()

    def restore(self):
        renounced, self._renounced = self._renounced, set()
        for name in renounced if self._flow.resumed else ():
            self._end(name)
        for subscription in self.by_name.values():
            self._begin(subscription)

    def lose(self, error):
        self._by_key, self._gathering = {}, Gathering()
        for subscription in self.by_name.values():
            subscription.live = False

    def channel_added(self, channel):
        subscription = self.by_name.get(channel.name)
        if subscription is not None:
            self._begin(subscription)

    def channel_removed(self, channel):
        self._gathering.forget(channel.reference)
        known = self._by_key.pop(channel.key, None)
        if known is not None:
            known[1].live = False

    def _on_run(self, key, payloads):
        known = self._by_key.get(key)
        if known is not None:
            known[1].hear(known[0], payloads)
        return self._flow.connection is not None

    def _on_fragment(self, _tag, flags, fields):
        reference, message, piece = fields
        payload = self._gathering.take(reference, message, flags, piece)
        if payload is not None:
            self._on_run(key_of(reference), [payload])

    def _on_dropped(self, _tag, _flags, fields):
        subscription = self.of(fields[0])
        if subscription is not None:
            reason = table.DROPS.get(fields[1], str(fields[1]))
            subscription.dropped[reason] = fields[2]
            self._flow.listener.on_dropped(subscription.name, reason, fields[2])

    def _on_unsubscribed(self, tag, _flags, fields):
        self._gathering.forget(fields[0])
        subscription = self.of(fields[0])
        if subscription is not None and tag == 0:
            subscription.live = False
