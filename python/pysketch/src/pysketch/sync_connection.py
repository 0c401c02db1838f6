"""A temporary synchronous connection: each call asks the hub and waits for the answer."""

import os

from .address import Address
from .blob import PIECE_BYTES, FileInfo, changed, checked
from .channels import ChannelInfo
from .clock import monotonic
from .connection import Closed, Connection, Refused
from .frames import Gathering
from .login import ROUNDS, SALT_BYTES, verifier
from .pulse import look
from .service import GRACE_S, form_of
from .table import SILENCE_MAX_S
from .variant import FORMS, pack, unpack

ANSWER_WITHIN_S = 5.0
_LOOK_S = 0.25
# After this a question goes on a new connection: a hub gives up who is silent for twice as long.
ALONE_MAX_S = SILENCE_MAX_S / 2.0


def connect(hub=None, credentials=None, within=ANSWER_WITHIN_S, form="variant"):
    """Opens a connection for questions: `with connect() as hub: print(hub.channels())`. It touches no flow."""
    return SyncConnection(hub, credentials, within, form)


class SyncConnection(object):
    """See `connect`. Every method blocks, at most `within` seconds, and raises `Refused`, `Closed` or
    `LinkError`. With `form="json"` values travel as JSON instead of variants. A hub ends connections that are silent: after
    three seconds without a question the next one goes on a connection of its own, with the same database."""

    def __init__(self, hub=None, credentials=None, within=ANSWER_WITHIN_S, form="variant"):
        if form not in FORMS:
            raise ValueError("values travel as `variant` or `json`, not as %r" % (form,))
        self._address, self.within, self._form = Address(hub), within, FORMS[form]
        self._credentials = self._address.credentials(credentials)
        self._database, self._closed = None, False
        self._open()

    def _open(self):
        self._answers, self._pieces, self._polled, self._unheard = [], Gathering(), set(), False
        self._connection = Connection(self._address.open(), self._credentials, self)
        try:
            self._until(lambda: self._connection.state == "synchronous")
        except Exception:
            self._connection.link.close()
            raise

    def _fresh(self):
        """The connection to ask on: a new one if this was left alone for so long that the hub may have ended it."""
        if self._closed:
            raise Closed("", "this connection was closed")
        if self._unheard or monotonic() - self._connection.heard > ALONE_MAX_S:
            self._connection.link.close()
            self._open()
            self._select_again()
        return self._connection

    def _select_again(self):
        name, self._database = self._database, None
        if name is not None:
            try:
                self.select(name)
            except Refused:
                # It has gone: what is asked of it now is refused.
                pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Ends it."""
        self._closed = True
        self._connection.close()

    @property
    def user(self):
        """The account."""
        return self._connection.user

    # ---- questions ----

    def channels(self):
        """All channels: a list of `ChannelInfo`."""
        return [ChannelInfo(fields) for _, fields in self._list("list_channels", self._form)]

    def channel(self, name):
        """The channel of this full name; raises `Refused` if there is none."""
        for channel in self.channels():
            if channel.name == name:
                return channel
        raise Refused("Gone", "there is no channel %s" % name, name)

    def inspect(self, subject="hub"):
        """What the hub knows of itself: `hub`, `flows`, `channel NAME`, `graph`, `why CHANNEL FLOW`."""
        return unpack(*self._one("inspect", subject, self._form)[0])

    def call(self, name, value, within=None):
        """Asks the service of this full name and waits for its answer: a value."""
        for answer in self.call_all(name, value, within):
            pass
        return answer

    def call_all(self, name, value, within=None):
        """Asks a service that answers several times: its answers, one after the other, as they come."""
        channel = self._service(name)
        form = form_of(channel.properties)
        for payload in self._call(channel, pack(value, form), within):
            yield unpack(form, payload)

    def call_bytes(self, name, payload, within=None):
        """As `call`, bytes as they are."""
        for answer in self._call(self._service(name), payload, within):
            pass
        return answer

    def _service(self, name):
        for channel in self.channels():
            if channel.name == name and channel.kind == "service":
                return channel
        raise Refused("NoSuchService", "there is no service %s" % name, name)

    def _call(self, channel, payload, within):
        within = self.within if within is None else within
        connection, more = self._fresh(), True
        tag = connection.next_tag()
        connection.send_message("call", tag, (channel.reference, int(within * 1000)), payload)
        try:
            while more:
                more, answer = self._answer(tag, within + GRACE_S)[1]
                yield answer
        except GeneratorExit:
            # The rest of the answers would come before those to other questions.
            self._unheard = True
            raise

    def poll(self, name):
        """The newest message of a stream, as bytes; None while there is none. The hub keeps it from the first question on,
        as long as the next ones come within three seconds."""
        reference = self.channel(name).reference
        if reference not in self._polled:
            self._one("poll_register", reference)
            self._polled.add(reference)
        try:
            return self._one("poll", reference)[-1]
        except Refused as refusal:
            if refusal.code == "NothingYet":
                return None
            raise

    def poll_stop(self, name):
        """The hub need not keep messages of this stream any more."""
        reference = self.channel(name).reference
        self._polled.discard(reference)
        self._one("poll_deregister", reference)

    # ---- files ----

    def list_files(self, channel, path=""):
        """The entries of a directory of the blob channel of this full name: a list of `FileInfo`."""
        return [FileInfo(*fields) for _, fields in self._list("blob_list", self.channel(channel).reference, path)]

    def stat_file(self, channel, path):
        """One entry: a `FileInfo`."""
        return self._stat(self.channel(channel).reference, path)

    def _stat(self, reference, path):
        directory, size, checksum = self._one("blob_stat", reference, path)
        return FileInfo(path, directory, size, checksum)

    def read_file(self, channel, path):
        """A whole file: bytes, checked against the hub's checksum."""
        reference, pieces, at = self.channel(channel).reference, [], 0
        info = self._stat(reference, path)
        while at < info.bytes:
            pieces.append(self._one("blob_read", reference, path, at, PIECE_BYTES)[-1])
            at += len(pieces[-1])
            if not pieces[-1]:
                raise changed(path)
        data, error = checked(path, b"".join(pieces), info)
        if error is not None:
            raise error
        return data

    # ---- accounts ----

    def users(self):
        """The accounts, as pairs (name, number of connections). For administrators."""
        return [tuple(fields) for _, fields in self._list("user_list")]

    def set_user(self, user, password):
        """Adds an account, or changes its password, which itself never leaves this program."""
        salt = os.urandom(SALT_BYTES)
        stored_key, server_key = verifier(password, salt, ROUNDS)
        self._one("user_set", user, ROUNDS, salt, stored_key, server_key)

    def remove_user(self, user):
        """Removes an account with its rights; its connections end."""
        self._one("user_remove", user)

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
        self._database = None
        self._one("db_select", name)
        self._database = name
        return self

    def get(self, key):
        """A variable of the current database."""
        return unpack(*self._one("var_get", key, self._form)[0])

    def set(self, key, value):
        """Sets a variable; of a durable database, when this returns it is on the disk."""
        self._one("var_set", key, (self._form, pack(value, self._form)))

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
        return dict((key, unpack(*value)) for _, (key, value) in self._list("db_all", prefix, self._form))

    def save(self):
        """Writes the current database to the disk; when this returns it is there."""
        self._one("db_save")

    def load(self):
        """Puts what was saved in place of what the current database holds."""
        self._one("db_load")

    # ---- the connection ----

    def _one(self, command, *values):
        return self._answer(self._fresh().send(command, *values), self.within)[1]

    def _list(self, command, *values):
        tag, entries = self._fresh().send(command, *values), []
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
        connection.flush()
        while not reached():
            now = monotonic()
            if now > deadline:
                self.close()
                raise Closed("NoAnswer", "the hub did not answer in time")
            connection.check(now)
            readable, _ = look(connection.link, connection.waiting > 0, min(_LOOK_S, deadline - now))
            if readable:
                connection.receive()
            connection.flush()

    def on_run(self, *_):
        """For the connection: data does not come here."""
        return True

    def on_event(self, name, tag, flags, fields):
        """For the connection."""
        if name in ("latest", "reply", "blob_data"):
            piece = self._pieces.take(tag, tag, flags, fields[-1])
            if piece is None:
                return True
            fields = fields[:-1] + [piece]
        if name != "logged_in" and (tag or name == "refused"):
            self._answers.append((name, tag, fields))
        return True
