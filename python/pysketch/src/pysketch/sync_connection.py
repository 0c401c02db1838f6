"""A temporary synchronous connection: each call asks the hub and waits for the answer."""

from .clock import SOCKET, Pulse, monotonic
from .connection import Closed, Connection, Refused
from .frames import Gathering
from .links import Address
from .sat import ChannelInfo
from .variant import BINARY, pack, unpack

ANSWER_WITHIN_S = 5.0


def connect(hub=None, credentials=None):
    """Opens a connection for questions: `with connect() as hub: print(hub.channels())`. It touches no flow."""
    return SyncConnection(hub, credentials)


class SyncConnection(object):
    """See `connect`. Every method blocks, at most `within` seconds, and raises `Refused`, `Closed` or
    `LinkError`."""

    def __init__(self, hub=None, credentials=None, within=ANSWER_WITHIN_S):
        address = Address(hub)
        self.within, self._answers, self._pieces, self._polled = within, [], Gathering(), set()
        self._connection = Connection(address.open(), address.credentials(credentials), self)
        self._until(lambda: self._connection.state == "synchronous")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Ends it."""
        self._connection.close()

    @property
    def user(self):
        """The account."""
        return self._connection.user

    # ---- questions ----

    def channels(self):
        """All channels: a list of `ChannelInfo`."""
        return [ChannelInfo(fields) for _, fields in self._list("list_channels", BINARY)]

    def inspect(self, subject="hub"):
        """What the hub knows of itself."""
        return unpack(*self._one("inspect", subject, BINARY)[0])

    def call(self, name, value, within=None):
        """Asks the service of this full name and waits for its answer: a value."""
        return unpack(BINARY, self.call_bytes(name, pack(value, BINARY), within))

    def call_bytes(self, name, payload, within=None):
        """As `call`, bytes as they are."""
        within = self.within if within is None else within
        found = [channel for channel in self.channels() if channel.name == name and channel.kind == "service"]
        if not found:
            raise Refused("NoSuchService", "there is no service %s" % name)
        tag = self._connection.next_tag()
        self._connection.send_message("call", tag, (found[0].reference, int(within * 1000)), payload)
        return self._answer(tag, within + 2.0)[1][0]

    def poll(self, name):
        """The newest message of a stream, as bytes; None while there is none."""
        channel = [channel for channel in self.channels() if channel.name == name]
        if not channel:
            raise Refused("Gone", "there is no channel %s" % name)
        reference = channel[0].reference
        if reference not in self._polled:
            self._one("poll_register", reference)
            self._polled.add(reference)
        try:
            return self._one("poll", reference)[0]
        except Refused as refusal:
            if refusal.code == "NothingYet":
                return None
            raise

    # ---- databases ----

    def databases(self, prefix=""):
        """The databases whose names begin so: a list of (name, durable, variables, bytes)."""
        return [(name, bool(durable), variables, size)
                for _, (name, durable, variables, size) in self._list("db_list", prefix)]

    def create_database(self, name, durable=False):
        """Creates a named database."""
        self._one("db_create", name, int(durable))

    def remove_database(self, name):
        """Removes it, on the disk too."""
        self._one("db_remove", name)

    def has_database(self, name):
        """Whether it exists."""
        return bool(self._one("db_exists", name)[0])

    def select(self, name):
        """Makes it the current one of this connection."""
        self._one("db_select", name)
        return self

    def get(self, key):
        """A variable of the current database."""
        return unpack(*self._one("var_get", key, BINARY)[0])

    def set(self, key, value):
        """Sets a variable; of a durable database, when this returns it is on the disk."""
        self._one("var_set", key, (BINARY, pack(value, BINARY)))

    def has(self, key):
        """Whether there is such a variable."""
        return bool(self._one("var_has", key)[0])

    def delete(self, key):
        """Deletes a variable."""
        self._one("var_delete", key)

    def keys(self, prefix=""):
        """The keys that begin so."""
        return [key for _, (key,) in self._list("db_keys", prefix)]

    def all(self, prefix=""):
        """The variables whose keys begin so: a dict."""
        return dict((key, unpack(*value)) for _, (key, value) in self._list("db_all", prefix, BINARY))

    def save(self):
        """Writes the current database to the disk; when this returns it is there."""
        self._one("db_save")

    def load(self):
        """Puts what was saved in place of what the current database holds."""
        self._one("db_load")

    # ---- the connection ----

    def _one(self, command, *values):
        return self._answer(self._connection.send(command, *values), self.within)[1]

    def _list(self, command, *values):
        tag, entries = self._connection.send(command, *values), []
        while True:
            answer = self._answer(tag, self.within)
            if answer[0] == "list_end":
                return entries
            entries.append(answer)

    def _answer(self, tag, within):
        self._until(lambda: self._answers, within)
        name, answered, fields = self._answers.pop(0)
        if name == "refused":
            raise Refused.of(fields)
        if answered != tag:
            raise Closed("", "the hub answered another question")
        return name, fields

    def _until(self, reached, within=None):
        connection, deadline = self._connection, monotonic() + (within or self.within)
        pulse = Pulse(SOCKET, 0.25)
        connection.flush()
        while not reached():
            now = monotonic()
            if now > deadline:
                self.close()
                raise Closed("NoAnswer", "the hub did not answer in time")
            connection.check(now)
            pulse.interval = min(0.25, deadline - now)
            _, readable, writable = pulse.wait(connection.link, connection.waiting > 0)
            if readable:
                connection.receive()
            connection.flush()

    def on_data(self, *_):
        """For the connection: data does not come here."""
        return True

    def on_event(self, name, tag, flags, fields):
        """For the connection."""
        if name in ("latest", "reply", "blob_data"):
            piece = self._pieces.take(tag, tag, flags, fields[-1])
            if piece is None:
                return True
            fields = [piece]
        if name != "logged_in" and (tag or name == "refused"):
            self._answers.append((name, tag, fields))
        return True
