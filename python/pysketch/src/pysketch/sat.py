"""A satellite: what a program writes and what it may ask for."""

import sys

from .address import Address
from .blob import Files, Store
from .clock import monotonic
from .database import OWN, Clerk
from .flow import Flow
from .links import LinkError
from .pulse import COARSE, SYNCED, Pulse, look
from .service import Calls, Service
from .telling import Teller
from .streams import Stream, Streams
from .subscriptions import POLICY_NUMBERS, Subscription, Subscriptions
from .sync import Following, SyncSource
from .table import DEPTH_MAX
from .variant import FORMS

CONNECT_WITHIN_S = 5.0
# A satellite without a hub looks for one so often, whatever its interval is.
_IDLE_WAIT_S = 0.05


class FlowSat(object):
    """A satellite. Derive from it and write `setup` (once) and `loop` (at each pulse), or use it as it is:

        class Thermometer(FlowSat):
            def setup(self):
                self.celsius = self.stream("celsius", unit="C")

            def loop(self):
                self.celsius.publish(21.5)

        Thermometer(interval=0.1).run()

    `hub` is an address (None: this user's hub), `credentials` a `Token`, a pair (user, password) or None for
    what the address suggests; `interval` is in seconds; `mode` is `coarse` (the default), `realtime`, `select-io`
    or `synced`: see `Pulse`. `form` is `variant` or `json`: how values of databases and properties travel. When
    the hub is lost it is looked for again and everything is restored, unless `reconnect` is false: then it is an error.
    """

    def __init__(self, hub=None, name="", credentials=None, interval=0.02, mode=COARSE, reconnect=True,
                 form="variant"):
        if form not in FORMS:
            raise ValueError("values travel as `variant` or `json`, not as %r" % (form,))
        address = Address(hub)
        self.pulse = Pulse(mode, interval)
        self.flow = Flow(address, address.credentials(credentials), name, FORMS[form], reconnect, self)
        self._subscriptions = self.flow.add(Subscriptions(self.flow))
        self.flow.add(Streams(self.flow))
        self._calls = self.flow.add(Calls(self.flow))
        self._clerk = self.flow.add(Clerk(self.flow))
        self._following = self.flow.add(Following(self.flow, self._subscriptions, self.pulse.sync))
        self.flow.add(Teller(self._clerk, self.pulse))
        self._sync_source, self._stopping, self.was_set_up = None, False, False
        self._own_pace = (self.pulse.mode, self.pulse.interval)

    # ---- what a sketch may write ----

    def setup(self):
        """Called once, when the hub has let this satellite in for the first time."""

    def loop(self):
        """Called at each pulse, with a hub or without: see `ready`."""

    def on_message(self, message):
        """A message of a channel that was subscribed to without a function of its own."""

    def on_channel(self, channel, exists):
        """A channel came or went, anybody's: a `ChannelInfo`."""

    def on_header(self, channel):
        """A channel says something else about itself."""

    def on_start(self, name):
        """Somebody began to listen to the channel `name` of one's own."""

    def on_stop(self, name):
        """Nobody listens to the channel `name` any more."""

    def on_lost(self, why):
        """The hub is lost, or is not there to begin with: `why`. It is looked for until it is there. Unless one says
        otherwise here, this is printed."""
        sys.stderr.write("pysketch: %s (looking for the hub)\n" % why)

    def on_refused(self, refusal):
        """The hub refused a command that nobody waits for: a `Refused`. Unless one says otherwise here, it is printed."""
        sys.stderr.write("pysketch: refused: %s\n" % refusal)

    def on_dropped(self, name, reason, total):
        """Messages of a subscription were lost: how many for this reason since it began."""

    def on_tick_report(self, report):
        """How a sync target keeps up: a `TickReport`, at most one a second."""

    # ---- what is known ----

    @property
    def ready(self):
        """Whether the hub has let this satellite in."""
        return self.flow.ready

    @property
    def user(self):
        """The account, known from the first login on."""
        return self.flow.user

    @property
    def flow_name(self):
        """The name that the hub knows it by, `account.name`."""
        return self.flow.name

    @property
    def channels(self):
        """All channels of the hub: a list of `ChannelInfo`."""
        return list(self.flow.channels.by_name.values())

    @property
    def waiting(self):
        """The bytes that wait to be sent."""
        return self.flow.connection.waiting if self.flow.connection is not None else 0

    @property
    def losses(self):
        """Messages that were published and could not be sent."""
        return sum(own.losses for own in self.flow.own.values() if isinstance(own, Stream))

    # ---- streams ----

    def stream(self, name, **properties):
        """Opens a streaming channel of one's own; the hub calls it `account.name`. Useful properties: `unit`,
        `rate` (Hz), `format` (`variant`, `json`, `bytes` or a type of numpy's, then perhaps `shape`), `mime`, `doc`,
        `latch` (True: late listeners get the newest message) and `delivery` (`reliable`: it waits for its slowest
        listener)."""
        properties.setdefault("format", "variant")
        return self.flow.open(Stream(self.flow, name, properties))

    def publish(self, name, value):
        """Publishes a value on the stream of that name, which is opened if it is not yet; answers whether it was sent."""
        return self._own_stream(name, "variant").publish(value)

    def publish_bytes(self, name, payload):
        """As `publish`, bytes as they are."""
        return self._own_stream(name, "bytes").publish_bytes(payload)

    def _own_stream(self, name, form):
        known = self.flow.own.get(name)
        return known if isinstance(known, Stream) else self.stream(name, format=form)

    def repeat(self, name, source, **properties):
        """Opens a stream of one's own that repeats the stream of the full name `source`: same bytes, another name."""
        stream = self.stream(name, **properties)
        stream.repeat(source)
        return stream

    def subscribe(self, name, on_message=None, depth=0, policy="latest", on_batch=None):
        """Hears the channel of this full name, now or when it exists: `on_message(message)`. `depth` messages wait at the
        hub at most (0: 64); beyond that `latest` loses the oldest and `all` the connection. `on_batch(channel, payloads)`
        gets all that came at once instead, as a list of bytes: the way for many small messages."""
        if policy not in POLICY_NUMBERS:
            raise ValueError("no policy is called %r; there are %s" % (policy, ", ".join(sorted(POLICY_NUMBERS))))
        if not 0 <= depth <= DEPTH_MAX:
            raise ValueError("a depth is 0 to %d, not %r" % (DEPTH_MAX, depth))
        return self._subscriptions.add(Subscription(
            self.flow, name, on_message or (lambda message: self.on_message(message)), on_batch, POLICY_NUMBERS[policy], depth))

    def unsubscribe(self, name):
        """Hears it no more."""
        self._subscriptions.remove(name)

    # ---- services, files, databases ----

    def serve(self, name, answer, **properties):
        """Opens a service: `answer(request)` is called for each request; what it returns is the answer, unless it
        answered itself. An exception declines. `format="json"` makes it talk JSON instead of variants."""
        return self.flow.open(Service(self.flow, name, properties, answer))

    def call(self, name, value, then, within=5.0):
        """Asks the service of this full name, which is waited for: `then(reply)` is called with the outcome within so many
        seconds. A service may send several replies; all but the last have `more`."""
        return self._calls.begin(name, value, None, then, within)

    def call_bytes(self, name, payload, then, within=5.0):
        """As `call`, bytes as they are."""
        return self._calls.begin(name, None, payload, then, within)

    def store(self, name, **properties):
        """Opens a blob channel of one's own: files that the hub keeps, also while this satellite is away."""
        return self.flow.open(Store(self.flow, name, properties))

    def files(self, name):
        """The files of the blob channel of this full name, to read."""
        return Files(self.flow, name)

    def database(self, name=OWN):
        """The database of this name, `flow:account.name` for instance; without a name, this satellite's own."""
        return self._clerk.database(name)

    # ---- keeping step ----

    def sync_source(self, name, **properties):
        """Makes each pulse a tick of the sync channel `name`."""
        properties.setdefault("interval_ns", int(self.pulse.interval * 1e9))
        self._sync_source = self.flow.open(SyncSource(self.flow, name, properties))
        return self._sync_source

    def sync_to(self, name, divisor=0):
        """Follows the ticks of the sync channel of this full name: every one (1), second (2), fourth (4), or as
        the hub finds bearable (0). The satellite is in the mode `synced` meanwhile."""
        if self.pulse.mode != SYNCED:
            self._own_pace = (self.pulse.mode, self.pulse.interval)
        self._following.follow(name, divisor)
        self.pulse.change(SYNCED, self.pulse.interval)

    def sync_stop(self):
        """Follows nobody any more, and goes on at its own pace."""
        self._following.leave()
        self.pulse.change(*self._own_pace)

    @property
    def tick(self):
        """The number of the newest tick of the channel that is followed, or None."""
        return self._following.sequence

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
        self.flow.close()

    def connect(self, within=CONNECT_WITHIN_S):
        """Connects, logs in and waits until the hub has let this satellite in, so many seconds at most. `run` does it
        by itself."""
        deadline = monotonic() + within
        if self.flow.connection is None:
            self.flow.begin()
        while not self.ready:
            if monotonic() > deadline:
                raise LinkError("the hub at %s does not answer" % self.flow.address)
            self._look(_IDLE_WAIT_S)
        return self

    def until(self, reached, within=10.0):
        """Pulses until `reached()` is true; answers whether that came within so many seconds."""
        deadline = monotonic() + within
        while not reached():
            if monotonic() > deadline:
                return False
            self.pulse_once()
        return True

    def pulse_once(self):
        """One round: wait, read, tick, write."""
        flow = self.flow
        if flow.connection is None:
            flow.find_hub()
        connection = flow.connection
        link = connection.link if connection is not None else None
        self.round(*self.pulse.wait(link, connection is not None and connection.waiting > 0))

    def round(self, tick, readable, writable):
        """What comes after the waiting: `pulse_once` without its wait, for event loops that are not ours."""
        flow = self.flow
        begun = monotonic()
        flow.serve(readable, writable)
        if flow.ready and not self.was_set_up:
            self.was_set_up = True
            self.setup()
        if tick and self.was_set_up:
            if self._sync_source is not None:
                self._sync_source.tick()
            self.loop()
            self._following.done()
            self.pulse.statistics.job_time.add((monotonic() - begun) * 1e9)
        flow.look_after(begun)

    def _look(self, seconds):
        flow = self.flow
        if flow.connection is None:
            flow.find_hub()
        connection = flow.connection
        if connection is not None:
            flow.serve(*look(connection.link, connection.waiting > 0, seconds))
        flow.look_after(monotonic())
