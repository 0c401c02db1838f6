"""A satellite: a program's link to its hub, and all that goes through it."""

from . import table
from .clock import SOCKET, Pulse, monotonic
from .connection import Closed, Connection, Refused
from .database import Database
from .frames import WHOLE, Gathering, ProtocolError
from .links import Address, LinkError
from .login import LoginError
from .service import Call, Request
from .variant import BINARY, JSON, decode, encode, pack, unpack

RECONNECT_FIRST_S, RECONNECT_MAX_S = 0.1, 5.0
STREAM, SERVICE, BLOB, SYNC = range(4)


class ChannelInfo(object):
    """What is known of a channel: name, kind (`stream`, `service`, `blob`, `sync`), owner, properties."""

    __slots__ = ("reference", "kind", "hash", "owner", "name", "_properties")

    def __init__(self, fields):
        identifier, kind, self.hash, self.owner, self.name, properties = fields
        self.reference, self.kind, self._properties = tuple(identifier), table.KINDS[kind], properties

    @property
    def properties(self):
        """What the owner says about it: a dict."""
        return unpack(*self._properties)

    def __repr__(self):
        return "<%s %s %r>" % (self.kind, self.name, self.properties)


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
        channel's `format` is. Shape is one row unless the channel's `shape` says another."""
        import numpy
        properties = self.channel.properties
        found = numpy.frombuffer(self.payload, dtype=numpy.dtype(str(kind or properties["format"])))
        return found.reshape(properties["shape"]) if "shape" in properties else found


class Stream(object):
    """A streaming channel of one's own. `publish` sends while somebody listens."""

    __slots__ = ("satellite", "name", "properties", "reference", "listened", "_next")

    def __init__(self, satellite, name, properties):
        self.satellite, self.name, self.properties = satellite, name, properties
        self.reference, self.listened, self._next = None, False, 0

    def publish(self, value):
        """Publishes a value as a variant (JSON if `format` is `json`); answers whether it was sent."""
        if not self.listened:
            return self._unsent()
        form = JSON if self.properties.get("format") == "json" else BINARY
        return self.publish_bytes(pack(value, form))

    def publish_bytes(self, payload):
        """Publishes bytes as they are, without a copy: they must not change until they were sent."""
        satellite, connection = self.satellite, self.satellite._connection
        if not self.listened or connection is None:
            return self._unsent()
        if len(payload) > connection.message_bytes:
            raise ValueError("a message of %d bytes, at most %d are possible" % (len(payload), connection.message_bytes))
        if connection.waiting + len(payload) > table.CONNECTION_BYTES_MAX:
            return self._unsent()
        self._next = (self._next + 1) & 0xffffffff
        connection.publish(self.reference, self._next, payload)
        return True

    def _unsent(self):
        if self.reference is None or self.listened:
            self.satellite.losses += 1
        return False


class FlowSat(object):
    """A satellite. Derive from it and write `setup` (once) and `loop` (at each pulse), or use it as it is:

        class Thermometer(FlowSat):
            def setup(self):
                self.celsius = self.stream("celsius", unit="C")

            def loop(self):
                self.celsius.publish(21.5)

        Thermometer(interval=0.1).run()

    `hub` is an address (None: this user's hub), `credentials` a `Token`, a pair (user, password) or None for
    what the address suggests; `interval` is in seconds; `mode` is `coarse`, `realtime`, `select-io` (woken by the
    hub, the default) or `synced`. When the hub is lost it is looked for again and everything is restored; what
    was published meanwhile is counted in `losses`.
    """

    def __init__(self, hub=None, name="", credentials=None, interval=0.02, mode=SOCKET, reconnect=True):
        self.address, self.name, self.pulse = Address(hub), name, Pulse(mode, interval)
        self._credentials, self._reconnects = self.address.credentials(credentials), reconnect
        self._connection, self._session = None, b"\0" * 16
        self.user, self.channels, self.losses, self.ready = None, {}, 0, False
        self._by_name, self._own, self._wanted, self._asked = {}, {}, {}, {}
        self._gathering, self._replies, self._requests = Gathering(), Gathering(), Gathering()
        self._services, self._calls, self._later, self._databases = {}, {}, [], {}
        self._sync_source = self._sync_target = None
        self._stopping, self._was_set_up = False, False
        self._again_at, self._again_after, self._checked = 0.0, RECONNECT_FIRST_S, monotonic()
        self._told = self._checked

    # ---- what a sketch may write ----

    def setup(self):
        """Called once, when the hub has let this satellite in for the first time."""

    def loop(self):
        """Called at each pulse, connected or not: see `ready`."""

    def on_message(self, message):
        """A message of a channel that was subscribed to without a function of its own."""

    def on_channel(self, channel, exists):
        """A channel came or went, anybody's."""

    def on_start(self, name):
        """Somebody began to listen to the stream `name`."""

    def on_stop(self, name):
        """Nobody listens to the stream `name` any more."""

    def on_lost(self, why):
        """The hub is lost."""

    def on_refused(self, refusal):
        """The hub refused a command that nobody waits for: a `Refused`."""

    def on_dropped(self, name, reason, total):
        """Messages of a subscription were lost: how many for this reason since it began."""

    # ---- the network ----

    def stream(self, name, **properties):
        """Opens a streaming channel of one's own; the hub calls it `account.name`. Useful properties: `unit`,
        `rate`, `format` (`variant`, `json`, `bytes` or a type of numpy's), `mime`, `doc`, `latch`."""
        own = self._own.get(name)
        if own is None:
            properties.setdefault("format", "variant")
            own = self._own[name] = Stream(self, name, properties)
            if self.ready:
                self._create("create_stream", own)
        return own

    def publish(self, name, value):
        """Publishes a value on the stream of that name, which is opened if it is not yet."""
        return self.stream(name).publish(value)

    def publish_bytes(self, name, payload):
        """As `publish`, bytes as they are."""
        return self.stream(name, format="bytes").publish_bytes(payload)

    def subscribe(self, name, on_message=None, depth=0, policy="latest"):
        """Hears the channel of this full name, now or when it exists: `on_message(message)`."""
        number = [number for number, known in table.POLICIES.items() if known == policy]
        if not number:
            raise ValueError("no policy is called %r; there are %s" % (policy, ", ".join(table.POLICIES.values())))
        self._wanted[name] = (on_message or self.on_message, number[0], min(depth, table.DEPTH_MAX), 1)
        if name in self._by_name:
            self._subscribe(name)

    def unsubscribe(self, name):
        """Hears it no more."""
        if self._wanted.pop(name, None) and name in self._by_name:
            self._ask("unsubscribe", self._by_name[name].reference)

    def serve(self, name, answer, **properties):
        """Opens a service: `answer(request)` is called for each request; what it returns is the answer, unless it
        answered itself. An exception declines."""
        own = Stream(self, name, properties)
        self._services[name] = (own, answer)
        if self.ready:
            self._create("create_service", own)
        return own

    def call(self, name, value, then, within=5.0):
        """Asks the service of this full name; `then(reply)` is called once with the outcome."""
        call = Call(self, name, pack(value, BINARY), then, within)
        if self.ready:
            call.send()
        else:
            self._later.append(call)
        return call

    def database(self, name):
        """The database of this name: `set`, `delete`, `watch` on it are sent at once."""
        return self._databases.setdefault(name, Database(self, name))

    def sync_source(self, name, **properties):
        """Makes each pulse a tick of the sync channel `name`."""
        properties.setdefault("interval_ns", int(self.pulse.interval * 1e9))
        self._sync_source = Stream(self, name, properties)
        if self.ready:
            self._create("create_sync", self._sync_source)
        return self._sync_source

    def sync_to(self, name, divisor=0):
        """Follows the ticks of the sync channel of this full name: every one (1), second (2), fourth (4), or as
        the hub finds bearable (0)."""
        self._sync_target = name
        self._wanted[name] = (None, 0, 1, divisor)
        self.pulse.change("synced", self.pulse.interval)
        if name in self._by_name:
            self._subscribe(name)

    # ---- running ----

    def run(self):
        """Runs until `stop` or Ctrl-C."""
        try:
            while not self._stopping:
                self.pulse_once()
        except KeyboardInterrupt:
            pass
        finally:
            self.close()

    def stop(self):
        """Ends `run` after this round."""
        self._stopping = True

    def close(self):
        """Says good-bye: what is queued goes out as far as it goes at once."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def connect(self):
        """Connects, logs in and waits until the hub has let this satellite in. `run` does it by itself."""
        deadline = monotonic() + table.LOGIN_TIME_MAX_S
        self._open()
        while not self.ready:
            if monotonic() > deadline:
                raise LinkError("the hub at %s does not answer" % self.address)
            self._serve(True, True)
            if not self.ready:
                Pulse(SOCKET, 0.05).wait(self._connection.link, self._connection.waiting > 0)
        return self

    def pulse_once(self):
        """One round: wait, read, tick, write."""
        if self._connection is None:
            self._find_hub()
        connection = self._connection
        link = connection.link if connection is not None else None
        tick, readable, writable = self.pulse.wait(link, connection is not None and connection.waiting > 0)
        begun = monotonic()
        if readable or writable:
            self._guarded(self._serve, readable, writable)
        if self.ready and not self._was_set_up:
            self._was_set_up = True
            self.setup()
        if tick and self._was_set_up:
            if self._sync_source is not None and self._sync_source.listened:
                self._sync_source._next += 1
                self._connection.send_untagged("sync_tick", self._sync_source.reference, self._sync_source._next)
            self.loop()
            self._tick_done()
            self.pulse.statistics.job_time.add((monotonic() - begun) * 1e9)
        self._guarded(self._after, begun)

    def _after(self, now):
        if self._connection is None:
            return
        if now - self._checked >= 0.25:
            self._checked = now
            self._connection.check(now)
            for call in list(self._calls.values()):
                call.check(now)
        self._connection.flush()

    def _tick_done(self):
        if self._sync_target is not None and self._tick is not None and self._connection is not None:
            reference, sequence = self._tick
            self._tick = None
            self._connection.send_untagged("tick_done", reference, sequence)

    _tick = None

    def _guarded(self, step, *arguments):
        try:
            step(*arguments)
        except (LinkError, ProtocolError) as error:
            self._lose(error)

    def _serve(self, readable, writable):
        connection = self._connection
        if connection is None:
            return
        if writable:
            connection.flush()
        if readable:
            connection.receive()
        if connection is self._connection:
            connection.flush()

    def _find_hub(self):
        now = monotonic()
        if now < self._again_at:
            return
        try:
            self._open()
        except LinkError as error:
            if not self._reconnects:
                raise
            self._lose(error)

    def _open(self):
        self._connection = Connection(self.address.open(), self._credentials, self)
        self._guarded(self._connection.flush)

    def _lose(self, error):
        was_ready, self.ready = self.ready, False
        if self._connection is not None:
            self._connection.link.close()
            self._connection = None
        for own in self._all_own():
            own.reference, own.listened = None, False
        self.channels, self._by_name, self._asked = {}, {}, {}
        self._gathering, self._replies, self._requests = Gathering(), Gathering(), Gathering()
        for call in list(self._calls.values()):
            call.lost(error)
        if isinstance(error, LoginError) or not self._reconnects:
            raise error
        self._again_at = monotonic() + self._again_after
        self._again_after = min(2 * self._again_after, RECONNECT_MAX_S)
        if was_ready:
            self.on_lost(str(error))

    def _all_own(self):
        found = list(self._own.values()) + [own for own, _ in self._services.values()]
        return found + ([self._sync_source] if self._sync_source is not None else [])

    # ---- commands ----

    def _ask(self, command, *values):
        """Sends a command; `then` in the pair is called with the answer's (name, fields), or a `Refused`."""
        if self._connection is None:
            raise LinkError("the hub is lost")
        return self._connection.send(command, *values)

    def _ask_then(self, then, command, *values):
        tag = self._ask(command, *values)
        self._asked[tag] = then
        return tag

    def _create(self, command, own):
        self._ask(command, own.name, (BINARY, encode(own.properties)))

    def _subscribe(self, name):
        _, policy, depth, divisor = self._wanted[name]
        self._ask("subscribe", self._by_name[name].reference, policy, depth, divisor)

    def _restore(self):
        self._again_after = RECONNECT_FIRST_S
        for own in self._own.values():
            self._create("create_stream", own)
        for own, _ in self._services.values():
            self._create("create_service", own)
        if self._sync_source is not None:
            self._create("create_sync", self._sync_source)
        for database in self._databases.values():
            database.restore()
        for call in self._later:
            call.send()
        self._later = []

    # ---- events ----

    def on_data(self, identifier, epoch, message, flags, payload):
        """A fragment of a channel; for the connection."""
        reference = (identifier, epoch)
        if flags != WHOLE:
            payload = self._gathering.take(reference, message, flags, payload)
            if payload is None:
                return True
        channel = self.channels.get(reference)
        if channel is not None:
            wanted = self._wanted.get(channel.name)
            if wanted is not None and wanted[0] is not None:
                wanted[0](Message(channel, payload))
        return self._connection is not None

    def on_event(self, name, tag, flags, fields):
        """Any other event; for the connection."""
        known = _EVENTS.get(name)
        if known is not None:
            known(self, tag, flags, fields)
        elif tag in self._asked:
            self._asked[tag]((name, fields))
            if name not in _CONTINUED:
                self._asked.pop(tag, None)
        return self._connection is not None

    def _on_logged_in(self, _tag, _flags, fields):
        self.user = fields[1]
        self._connection.state = "synchronous"
        self._connection.send("set_async", self.name, self._session, BINARY)

    def _on_flow_begun(self, _tag, _flags, fields):
        _, self.flow_name, self._session, _ = fields
        self._connection.state, self.ready = "flow", True
        self._restore()

    def _on_channel_added(self, _tag, _flags, fields):
        channel = ChannelInfo(fields)
        self.channels[channel.reference] = self._by_name[channel.name] = channel
        if channel.owner == self._connection.number:
            self._mine(channel)
        if channel.name in self._wanted:
            self._subscribe(channel.name)
        if self.ready:
            self.on_channel(channel, True)

    def _mine(self, channel):
        name = channel.name.partition(".")[2]
        for own in self._all_own():
            if own.name == name:
                own.reference = channel.reference

    def _on_channel_removed(self, _tag, _flags, fields):
        reference = tuple(fields[0])
        self._gathering.forget(reference)
        channel = self.channels.pop(reference, None)
        if channel is None:
            return
        if self._by_name.get(channel.name) is channel:
            del self._by_name[channel.name]
        for own in self._all_own():
            if own.reference == reference:
                own.reference, own.listened = None, False
        if self.ready:
            self.on_channel(channel, False)

    def _on_header_changed(self, tag, _flags, fields):
        channel = self.channels.get(tuple(fields[0]))
        if channel is not None:
            channel._properties = fields[1]

    def _on_listened(self, reference, listened):
        for own in self._all_own():
            if own.reference == tuple(reference):
                own.listened = listened
                (self.on_start if listened else self.on_stop)(own.name)

    def _on_start(self, _tag, _flags, fields):
        self._on_listened(fields[0], True)

    def _on_stop(self, _tag, _flags, fields):
        self._on_listened(fields[0], False)

    def _on_dropped(self, _tag, _flags, fields):
        channel = self.channels.get(tuple(fields[0]))
        if channel is not None:
            self.on_dropped(channel.name, table.DROPS.get(fields[1], "?"), fields[2])

    def _on_unsubscribed(self, tag, _flags, fields):
        self._gathering.forget(tuple(fields[0]))

    def _on_tick(self, _tag, _flags, fields):
        self._tick = (fields[0], fields[1])
        self.pulse.sync()

    def _on_request(self, _tag, flags, fields):
        reference, number, asker, piece = fields
        payload = self._requests.take(number, number, flags, piece)
        if payload is None:
            return
        for own, answer in self._services.values():
            if own.reference == tuple(reference):
                return Request(self, number, asker, payload).handle(answer)

    def _on_request_over(self, _tag, _flags, fields):
        self._requests.forget(fields[0])

    def _on_reply(self, tag, flags, fields):
        more, piece = fields
        payload = self._replies.take(tag, tag, flags, piece)
        call = self._calls.get(tag)
        if payload is not None and call is not None:
            call.replied(payload, bool(more))

    def _on_refused(self, tag, _flags, fields):
        refusal = Refused.of(fields)
        call = self._calls.get(tag)
        if call is not None:
            return call.refused(refusal)
        then = self._asked.pop(tag, None)
        if then is not None:
            return then(refusal)
        if refusal.code == "Exists" and not self.ready:
            # A half-open predecessor of this name still lives at the hub: it goes within some seconds.
            raise Closed("Exists", refusal.text)
        self.on_refused(refusal)


# Answers that are followed by more under the same tag.
_CONTINUED = ("channel_listed", "key_listed", "variable", "database_listed", "blob_listed", "user_listed",
              "changed", "deleted", "watching")
_EVENTS = {
    "logged_in": FlowSat._on_logged_in,
    "flow_begun": FlowSat._on_flow_begun,
    "channel_added": FlowSat._on_channel_added,
    "channel_removed": FlowSat._on_channel_removed,
    "header_changed": FlowSat._on_header_changed,
    "start_publishing": FlowSat._on_start,
    "stop_publishing": FlowSat._on_stop,
    "dropped": FlowSat._on_dropped,
    "unsubscribed": FlowSat._on_unsubscribed,
    "tick": FlowSat._on_tick,
    "request": FlowSat._on_request,
    "request_over": FlowSat._on_request_over,
    "reply": FlowSat._on_reply,
    "refused": FlowSat._on_refused,
}
