"""Channels: what is known of everybody's, and what is common to one's own."""

from . import table
from .connection import Refused
from .frames import key_of
from .variant import unpack


class ChannelInfo(object):
    """What is known of a channel: `name` in full, `kind` (`stream`, `service`, `blob`, `sync`), `owner` (the number
    of a connection, 0 is the hub), `properties`."""

    __slots__ = ("reference", "key", "kind", "hash", "owner", "name", "_said", "_properties")

    def __init__(self, fields):
        identifier, kind, self.hash, self.owner, self.name, said = fields
        self.reference, self.kind = tuple(identifier), table.KINDS[kind]
        self.key = key_of(self.reference)
        self.say(said)

    def say(self, said):
        """For the satellite: the owner says this about it, as (form, bytes)."""
        self._said, self._properties = said, None

    @property
    def properties(self):
        """What the owner says about it: a dict."""
        if self._properties is None:
            self._properties = unpack(*self._said)
        return self._properties

    def __repr__(self):
        return "<%s %s %r>" % (self.kind, self.name, self.properties)


class Directory(object):
    """All channels of the hub, by number and by name."""

    def __init__(self):
        self.by_key, self.by_name = {}, {}

    def add(self, channel):
        """A channel came."""
        self.by_key[channel.key] = self.by_name[channel.name] = channel

    def remove(self, reference):
        """A channel went; answers it, if it was known."""
        channel = self.by_key.pop(key_of(reference), None)
        if channel is not None and self.by_name.get(channel.name) is channel:
            del self.by_name[channel.name]
        return channel

    def of(self, reference):
        """The channel of this identifier and epoch, or None."""
        return self.by_key.get(key_of(reference))

    def named(self, name, kind=None):
        """The channel of this full name (and kind), or None."""
        channel = self.by_name.get(name)
        return channel if channel is not None and kind in (None, channel.kind) else None


class OwnChannel(object):
    """A channel of a satellite's own; it is opened anew after each loss of the hub. `reference` is None while the
    hub does not know it, `listened` is whether anybody listens, `refusal` why the hub would not have it."""

    command = None

    def __init__(self, flow, name, properties):
        self.flow, self.name, self.properties = flow, name, properties
        self.reference, self.listened, self.refusal = None, False, None
        self._said = dict(properties)

    @property
    def full_name(self):
        """The name that everybody uses, `account.name`; None before the first login."""
        return None if self.flow.user is None else "%s.%s" % (self.flow.user, self.name)

    @property
    def opened(self):
        """Whether the hub knows it."""
        return self.reference is not None

    def change(self, **properties):
        """Changes what it says about itself; everybody hears."""
        self.properties.update(properties)
        if self.reference is not None:
            self._say()

    def _say(self):
        self._said = dict(self.properties)
        self.flow.command("change_header", self.reference, self.flow.value(self.properties), about=self.name)

    def remove(self):
        """Closes it for good."""
        self.flow.disown(self)
        if self.reference is not None:
            self.flow.command("remove_channel", self.reference, about=self.name)

    # ---- for the flow ----

    def create(self):
        """Asks the hub for it."""
        self._said = dict(self.properties)
        self.flow.ask(self._created, self.command, self.name, self.flow.value(self.properties), about=self.name)

    def _created(self, answer):
        if not isinstance(answer, Refused) or answer.code == "Lost":
            return
        told, self.refusal = self.refusal, answer
        if told is None or told.code != answer.code:
            self.flow.listener.on_refused(answer)

    def exists(self, channel):
        """The hub knows it now; what was changed meanwhile is said."""
        self.reference, self.refusal = channel.reference, None
        if self._said != self.properties:
            self._say()

    def lost(self):
        """The hub does not know it any more."""
        self.reference, self.refusal, self.listened = None, None, False

    def heard(self, listened):
        """The first listener came, or the last went."""
        self.listened = listened
        tell = self.flow.listener.on_start if listened else self.flow.listener.on_stop
        tell(self.name)
