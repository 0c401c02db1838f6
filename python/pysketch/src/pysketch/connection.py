"""One connection to a hub: greeting, login, what goes out and what comes in."""

import os
from collections import deque

from . import table
from .clock import monotonic
from .frames import FrameReader, ProtocolError, as_bytes, cut, encode, publish_head
from .links import PARTS_MAX, LinkError
from .login import LoginError, Password, Peer, Token, same

RECEIVES_PER_TURN_MAX = 16
# Parts up to this length are copied together: one long part leaves faster than many short ones.
JOIN_BYTES_MAX = 4 * 1024


class Refused(Exception):
    """The hub refused a command; it changed nothing. `code` is the name of the reason, `text` the hub's words,
    `about` what the command was about, where that is known."""

    def __init__(self, code, text, about=""):
        Exception.__init__(self, "%s: %s" % (about, text) if about else text)
        self.code, self.text, self.about = code, text, about

    @classmethod
    def of(cls, fields, about=""):
        """From the fields of a `refused` event."""
        return cls(table.REFUSALS.get(fields[0], str(fields[0])), fields[1], about)


class Closed(LinkError):
    """The hub ended the connection; `reason` is its name, if the hub said one."""

    def __init__(self, reason, text):
        LinkError.__init__(self, text)
        self.reason = reason


class Connection(object):
    """A connection on a link. `handler` gets `on_run(channel key, payloads)` and
    `on_event(name, tag, flags, fields)` for all that is not about the connection itself; both answer whether to
    go on reading."""

    def __init__(self, link, credentials, handler):
        self.link, self.handler = link, handler
        self.state, self.user, self.number = "greeting", None, 0
        self.fragment_bytes, self.message_bytes = link.fragment_bytes, table.MESSAGE_BYTES_MAX
        self._credentials, self._nonce, self._hub_nonce = credentials, os.urandom(32), None
        self._reader, self._tag = FrameReader(), 0
        self._out, self._short, self._out_bytes = deque(), bytearray(), 0
        self.opened = self.heard = self._pinged = monotonic()
        self.send("hello", table.MAGIC, table.VERSION, table.VERSION_OLDEST, self.fragment_bytes,
                  self.message_bytes, self._nonce)

    # ---- out ----

    def next_tag(self):
        """A tag that no command of late had; never 0."""
        self._tag = self._tag % 0xffffffff + 1
        return self._tag

    def send(self, command, *values):
        """Queues a command; answers its tag."""
        tag = self.next_tag()
        self._push(encode(command, tag, values))
        return tag

    def send_untagged(self, command, *values):
        """Queues a command that only a refusal answers."""
        self._push(encode(command, 0, values))

    def send_message(self, command, tag, values, payload):
        """Queues a message in fragments; `values` are the fields before the payload."""
        for flags, piece in cut(payload, self.fragment_bytes):
            self._push(encode(command, tag, tuple(values) + (as_bytes(piece),), flags))

    def publish(self, channel, message, payload):
        """Queues a message on a channel of one's own. A long payload is not copied and must not change until it was
        sent."""
        for flags, piece in cut(payload, self.fragment_bytes):
            self._push(publish_head(channel, message, flags, len(piece)))
            if len(piece):
                self._push(piece)

    def send_frames(self, frames):
        """Queues frames as they are; more than 4 KiB are not copied and must not change until they were sent."""
        self._push(frames)

    def _push(self, part):
        length = len(part)
        self._out_bytes += length
        if length <= JOIN_BYTES_MAX:
            self._short += part
        else:
            self._end_short()
            self._out.append(part)

    def _end_short(self):
        if self._short:
            self._out.append(self._short)
            self._short = bytearray()

    @property
    def waiting(self):
        """The bytes that wait to be sent."""
        return self._out_bytes

    def flush(self):
        """Sends what the link takes now; answers whether all went."""
        self._end_short()
        out = self._out
        while out:
            parts = list(out) if len(out) <= PARTS_MAX else [out[at] for at in range(PARTS_MAX)]
            count = self.link.send(parts)
            if count is None:
                return False
            self._out_bytes -= count
            while count:
                part = out[0]
                if count < len(part):
                    out[0] = memoryview(part)[count:]
                    break
                count -= len(part)
                out.popleft()
        return True

    # ---- in ----

    def receive(self):
        """Takes what the link has, a bounded part of it. Raises `Closed` at its end."""
        reader, link = self._reader, self.link
        for _ in range(RECEIVES_PER_TURN_MAX):
            room = reader.room()
            count = link.recv_into(room)
            if count is None:
                return
            if count == 0:
                raise Closed("", "the hub closed the connection")
            self.heard = monotonic()
            reader.received(count)
            self.take()
            if count < len(room) or self.link.closed:
                return

    def take(self):
        """Handles the whole frames that were received."""
        self._reader.take(self._on_run, self._on_event)

    def _on_run(self, key, payloads):
        if self.state != "flow":
            raise ProtocolError("data in the state %s" % self.state)
        return self._hand(self.handler.on_run, key, payloads)

    def _on_event(self, name, tag, flags, fields):
        if self.state not in table.EVENTS[name][2] and not (self.state == "synchronous" and name in _EARLY):
            raise ProtocolError("%s in the state %s" % (name, self.state))
        own = _OWN.get(name)
        if own is not None:
            own(self, tag, fields)
            return True
        return self._hand(self.handler.on_event, name, tag, flags, fields)

    @staticmethod
    def _hand(function, *arguments):
        try:
            return function(*arguments)
        except (LinkError, LoginError) as error:
            # Of what the program does with other hubs: this link is as it was.
            error.of_the_program = True
            raise

    def _on_welcome(self, _tag, fields):
        magic, version, self.fragment_bytes, self.message_bytes, self._hub_nonce = fields
        if magic != table.MAGIC:
            raise ProtocolError("the other end is no hub")
        if not table.VERSION_OLDEST <= version <= table.VERSION:
            raise ProtocolError("the hub wants to speak version %d" % version)
        self.state, credentials = "login", self._credentials
        if isinstance(credentials, Token):
            self.send("login_token", credentials.client_proof(self._nonce, self._hub_nonce))
        elif isinstance(credentials, Password):
            self.send("login_scram", credentials.begin(self._nonce[:18]))
        elif isinstance(credentials, Peer):
            self.send("login_peer")
        else:
            raise LoginError("credentials are Token, Password or Peer, not %r" % (credentials,))

    def _on_challenge(self, _tag, fields):
        if not isinstance(self._credentials, Password):
            raise ProtocolError("a challenge that was not asked for")
        self.send("login_scram_proof", self._credentials.prove(fields[0]))

    def _on_logged_in(self, _tag, fields):
        self.number, self.user, proof = fields
        credentials, true = self._credentials, True
        if isinstance(credentials, Token):
            true = same(credentials.hub_proof(self._nonce, self._hub_nonce), proof)
        elif isinstance(credentials, Password):
            true = credentials.hub_is_true(proof)
        if not true:
            raise LoginError("the hub's proof is wrong: it is not the hub it says it is")
        self.state = "synchronous"
        self._hand(self.handler.on_event, "logged_in", 0, 0, fields)

    def _on_ping(self, tag, _fields):
        self._push(encode("pong", tag, ()))

    def _on_pong(self, _tag, _fields):
        pass

    def _on_closing(self, _tag, fields):
        reason = table.CLOSINGS.get(fields[0], str(fields[0]))
        if reason == "LoginFailed":
            raise LoginError("the hub refused the login: %s" % fields[1])
        raise Closed(reason, "the hub ended the connection: %s" % fields[1])

    # ---- life ----

    def check(self, now):
        """Pings a hub that is silent; raises `Closed` when it was silent too long."""
        silence = now - self.heard
        early = self.state in ("greeting", "login")
        if silence >= table.SILENCE_MAX_S or early and now - self.opened >= self.link.login_s:
            raise Closed("Silent", "the hub is silent")
        if not early and silence >= table.PING_AFTER_S and now - self._pinged >= table.PING_AFTER_S:
            self._pinged = now
            self.send("ping")

    def close(self):
        """Ends the connection, having sent what goes at once."""
        try:
            self.flush()
        except LinkError:
            pass
        self.link.close()


# Between `set_async` and `flow_begun` the client is synchronous and hears of channels.
_EARLY = ("channel_added", "channel_removed", "header_changed", "owner_changed")
_OWN = {
    "welcome": Connection._on_welcome,
    "scram_challenge": Connection._on_challenge,
    "logged_in": Connection._on_logged_in,
    "ping": Connection._on_ping,
    "pong": Connection._on_pong,
    "closing": Connection._on_closing,
}
