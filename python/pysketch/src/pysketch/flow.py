"""A satellite's life with its hub: it connects, becomes a flow, loses the hub, and comes back as it was."""

from . import table
from .channels import ChannelInfo, Directory
from .clock import monotonic
from .connection import Closed, Connection, Refused
from .frames import Gathering, ProtocolError
from .links import LinkError
from .login import LoginError
from .variant import pack

RECONNECT_FIRST_S, RECONNECT_MAX_S = 0.1, 5.0
CHECK_EVERY_S = 0.25
# A name that another flow has is asked for again so often.
CLAIM_AGAIN_S = 1.0
NO_SESSION = b"\0" * 16
# Answers that are followed by more under the same tag.
_CONTINUED = frozenset((
    "channel_listed", "key_listed", "variable", "database_listed", "blob_listed", "user_listed", "changed", "deleted",
    "watching",
))
_GATHERED = frozenset(("reply", "blob_data"))


class Part(object):
    """Something that a flow does for its satellite: `events` are the functions for the events it hears."""

    events = {}

    def restore(self):
        """The hub has let the flow in, for the first time or again."""

    def lose(self, error):
        """The hub is lost."""

    def check(self, now):
        """Comes four times a second, with a hub or without."""

    def channel_added(self, channel):
        """A channel came, after `restore`."""

    def channel_removed(self, channel):
        """A channel went."""


class Flow(object):
    """The link of one satellite. `listener` is the satellite, whose functions are called with what happens."""

    def __init__(self, address, credentials, name, form, reconnects, listener):
        self.address, self.wanted_name, self.form, self.listener = address, name, form, listener
        self.connection, self.user, self.name, self.ready, self.resumed = None, None, None, False, False
        self.channels, self.own, self.parts, self.on_run = Directory(), {}, [], None
        self._credentials, self._reconnects, self._session = credentials, reconnects, NO_SESSION
        self._own_by_key, self._asked, self._gathering = {}, {}, Gathering()
        self._again_at, self._again_after, self._told_loss = 0.0, RECONNECT_FIRST_S, False
        self._checked = self._claimed = monotonic()
        self._events = {
            "logged_in": self._on_logged_in, "flow_begun": self._on_flow_begun,
            "channel_added": self._on_channel_added, "channel_removed": self._on_channel_removed,
            "header_changed": self._on_header_changed, "owner_changed": self._on_owner_changed,
            "refused": self._on_refused,
            "start_publishing": self._on_start, "stop_publishing": self._on_stop,
        }

    def add(self, part):
        """Takes a part in, and answers it."""
        self.parts.append(part)
        self._events.update(part.events)
        return part

    # ---- commands ----

    def value(self, value):
        """A value as commands take it."""
        return self.form, pack(value, self.form)

    def command(self, command, *values, **about):
        """Sends a command; a refusal is told to the satellite's `on_refused`. Raises `LinkError` without a hub."""
        return self.ask(None, command, *values, **about)

    def ask(self, then, command, *values, **about):
        """Sends a command; `then` is called with its answer, (name, fields) or a `Refused`. Answers the tag."""
        if self.connection is None:
            raise LinkError("the hub at %s is lost at the moment" % self.address)
        tag = self.connection.send(command, *values)
        if then is not None or about:
            self._asked[tag] = (then, about.get("about", ""))
        return tag

    def ask_message(self, then, command, values, payload, about=""):
        """As `ask`, of a command that comes in fragments; `values` are the fields before the payload."""
        if self.connection is None:
            raise LinkError("the hub at %s is lost at the moment" % self.address)
        tag = self.connection.next_tag()
        self._asked[tag] = (then, about)
        self.connection.send_message(command, tag, values, payload)
        return tag

    def forget(self, tag):
        """Nobody wants the answer any more."""
        self._asked.pop(tag, None)
        self._gathering.forget(tag)

    # ---- channels of one's own ----

    def open(self, channel):
        """Opens a channel of one's own, now or as soon as there is a hub, and anew after each loss. One that exists
        already under that name is answered instead, if it is of the same kind."""
        known = self.own.get(channel.name)
        if known is not None:
            if type(known) is not type(channel):
                raise ValueError("%s is a %s already" % (channel.name, type(known).__name__.lower()))
            return known
        self.own[channel.name] = channel
        if self.ready:
            channel.create()
        return channel

    def disown(self, channel):
        """It is not opened any more."""
        self.own.pop(channel.name, None)

    # ---- life ----

    def find_hub(self):
        """Tries to connect, if it is time for that."""
        if monotonic() < self._again_at:
            return
        try:
            self.begin()
        except LinkError as error:
            if not self._reconnects:
                raise
            self.lose(error)

    def begin(self):
        """Connects. Raises `LinkError` if nobody is there."""
        self.connection = Connection(self.address.open(), self._credentials, self)
        self.serve(False, True)

    def serve(self, readable, writable):
        """Reads and writes what is possible; a loss is handled."""
        connection = self.connection
        if connection is None:
            return
        try:
            if readable:
                connection.receive()
            if connection is self.connection and (readable or writable):
                connection.flush()
        except (LinkError, ProtocolError, LoginError) as error:
            if getattr(error, "of_the_program", False):
                raise
            if connection is self.connection:
                self.lose(error)

    def look_after(self, now):
        """Writes what the round left, and what is due by time."""
        is_due = now - self._checked >= CHECK_EVERY_S
        if is_due:
            self._checked = now
            self._check(now)
        try:
            if is_due and self.connection is not None:
                self.connection.check(now)
            if self.connection is not None and self.connection.waiting:
                self.connection.flush()
        except LinkError as error:
            self.lose(error)

    def _check(self, now):
        if self.ready and now - self._claimed >= CLAIM_AGAIN_S:
            self._claimed = now
            self._claim()
        for part in self.parts:
            part.check(now)

    def _claim(self):
        # A half-open predecessor that still has the name goes within some seconds.
        for own in list(self.own.values()):
            if own.reference is None and own.refusal is not None and own.refusal.code == "Exists":
                own.create()

    def lose(self, error):
        """The hub is lost: it is looked for again, unless that makes no sense; then the error is raised."""
        was_ready, self.ready = self.ready, False
        if self.connection is not None:
            self.connection.link.close()
            self.connection = None
        for own in self.own.values():
            own.lost()
        self.channels, self._own_by_key, self._gathering = Directory(), {}, Gathering()
        asked, self._asked = self._asked, {}
        loss = Refused("Lost", "the hub was lost before it answered: %s" % error)
        for then, _ in asked.values():
            if then is not None:
                then(loss)
        for part in self.parts:
            part.lose(error)
        if isinstance(error, LoginError) or not self._reconnects:
            raise error
        self._again_at = monotonic() + self._again_after
        self._again_after = min(2 * self._again_after, RECONNECT_MAX_S)
        if was_ready or not self._told_loss:
            self._told_loss = True
            self.listener.on_lost(str(error))

    def close(self):
        """Says good-bye: what is queued goes out as far as it goes at once."""
        self.ready, self._session = False, NO_SESSION
        if self.connection is not None:
            self.connection.close()
            self.connection = None

    # ---- events ----

    def on_event(self, name, tag, flags, fields):
        """Any event but whole messages; for the connection."""
        known = self._events.get(name)
        if known is not None:
            known(tag, flags, fields)
        asked = self._asked.get(tag)
        if asked is not None and tag:
            self._answered(asked[0], name, tag, flags, fields)
        return self.connection is not None

    def _answered(self, then, name, tag, flags, fields):
        if name in _GATHERED:
            payload = self._gathering.take(tag, tag, flags, fields[-1])
            if payload is None:
                return
            fields[-1] = payload
        if name not in _CONTINUED and not (name == "reply" and fields[0]):
            self._asked.pop(tag, None)
        if then is not None:
            then((name, fields))

    def _on_logged_in(self, _tag, _flags, fields):
        self.user = fields[1]
        self.connection.send("set_async", self.wanted_name, self._session, self.form)

    def _on_flow_begun(self, _tag, _flags, fields):
        _, self.name, self._session, resumed = fields
        self.connection.state, self.ready, self.resumed = "flow", True, bool(resumed)
        self._again_after, self._told_loss = RECONNECT_FIRST_S, False
        for own in list(self.own.values()):
            if own.reference is None:
                own.create()
        for part in self.parts:
            part.restore()

    def _on_channel_added(self, _tag, _flags, fields):
        channel = ChannelInfo(fields)
        self.channels.add(channel)
        if channel.owner == self.connection.number:
            own = self.own.get(channel.name.partition(".")[2])
            if own is None:
                # It was removed before the hub had opened it.
                self.command("remove_channel", channel.reference, about=channel.name)
            else:
                self._own_by_key[channel.key] = own
                own.exists(channel)
        if self.ready:
            for part in self.parts:
                part.channel_added(channel)
            self.listener.on_channel(channel, True)

    def _on_channel_removed(self, _tag, _flags, fields):
        channel = self.channels.remove(fields[0])
        if channel is None:
            return
        own = self._own_by_key.pop(channel.key, None)
        if own is not None:
            own.lost()
        for part in self.parts:
            part.channel_removed(channel)
        if self.ready:
            self.listener.on_channel(channel, False)

    def _on_header_changed(self, _tag, _flags, fields):
        channel = self.channels.of(fields[0])
        if channel is not None:
            channel.say(fields[1])
            self.listener.on_header(channel)

    def _on_owner_changed(self, _tag, _flags, fields):
        channel = self.channels.of(fields[0])
        if channel is not None:
            channel.owner = fields[1]

    def own_of(self, reference):
        """The channel of one's own with this identifier and epoch, or None."""
        channel = self.channels.of(reference)
        return self._own_by_key.get(channel.key) if channel is not None else None

    def _on_start(self, _tag, _flags, fields):
        own = self.own_of(fields[0])
        if own is not None:
            own.heard(True)

    def _on_stop(self, _tag, _flags, fields):
        own = self.own_of(fields[0])
        if own is not None:
            own.heard(False)

    def _on_refused(self, tag, _flags, fields):
        then, about = self._asked.pop(tag, (None, ""))
        self._gathering.forget(tag)
        refusal = Refused.of(fields, about)
        if then is not None:
            then(refusal)
        elif not self.ready:
            # A half-open predecessor of this name still lives at the hub: it goes within some seconds.
            taken = "another satellite is called %s" % self.wanted_name
            self.lose(Closed(refusal.code, taken if refusal.code == "Exists" else refusal.text))
        else:
            self.listener.on_refused(refusal)
