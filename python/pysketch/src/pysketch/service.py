"""Services: requests that come to one's own, and calls of others'."""

import traceback

from .clock import monotonic
from .connection import Refused
from .variant import BINARY, decode, pack


class Request(object):
    """A request to a service of one's own. `value` is what was asked, `asker` the connection that asks."""

    def __init__(self, satellite, number, asker, payload):
        self._satellite, self._number, self.asker, self.payload = satellite, number, asker, payload
        self.done = False

    @property
    def value(self):
        """The payload as a value."""
        return decode(self.payload)

    def answer(self, value, more=False):
        """Answers with a value; with `more` the request stays open and further answers follow."""
        self.answer_bytes(pack(value, BINARY), more)

    def answer_bytes(self, payload, more=False):
        """As `answer`, bytes as they are."""
        if not self.done and self._satellite._connection is not None:
            self.done = not more
            self._satellite._connection.send_message("answer", 0, (self._number, int(more)), payload)

    def decline(self, why):
        """Says that there will be no answer, and why."""
        if not self.done and self._satellite._connection is not None:
            self.done = True
            self._satellite._connection.send_untagged("decline", self._number, str(why))

    def handle(self, answer):
        """Lets a function answer: what it returns is the answer unless it answered, or is None."""
        try:
            value = answer(self)
        except Exception as error:
            traceback.print_exc()
            return self.decline("%s: %s" % (type(error).__name__, error))
        if value is not None:
            self.answer(value)


class Reply(object):
    """What became of a call: `ok`, and then `value` or `payload`; else `error`, a `Refused`. `more`: further
    replies follow."""

    def __init__(self, payload=None, error=None, more=False):
        self.payload, self.error, self.more = payload, error, more

    @property
    def ok(self):
        """Whether there is an answer."""
        return self.error is None

    @property
    def value(self):
        """The answer as a value; raises the error if there is none."""
        if self.error is not None:
            raise self.error
        return decode(self.payload)


class Call(object):
    """A call of somebody's service that is under way."""

    def __init__(self, satellite, name, payload, then, within):
        self._satellite, self.name, self._payload, self._then = satellite, name, payload, then
        self._within, self._deadline, self._tag = within, monotonic() + within + 2.0, None

    def send(self):
        """Sends it, if there is such a service."""
        satellite = self._satellite
        channel = satellite._by_name.get(self.name)
        if channel is None or channel.kind != "service":
            return self._then(Reply(error=Refused("NoSuchService", "there is no service %s" % self.name)))
        self._tag = satellite._connection.next_tag()
        satellite._calls[self._tag] = self
        satellite._connection.send_message("call", self._tag, (channel.reference, int(self._within * 1000)), self._payload)

    def cancel(self):
        """Gives it up: no reply comes."""
        if self._satellite._calls.pop(self._tag, None) is not None and self._satellite._connection is not None:
            self._satellite._connection.send_untagged("cancel", self._tag)

    def replied(self, payload, more):
        """For the satellite: a reply came."""
        if not more:
            self._end()
        self._then(Reply(payload=payload, more=more))

    def refused(self, refusal):
        """For the satellite: it was refused."""
        self._end()
        self._then(Reply(error=refusal))

    def lost(self, error):
        """For the satellite: the hub is lost."""
        self.refused(Refused("Lost", "the hub is lost: %s" % error))

    def check(self, now):
        """For the satellite: a hub that does not even say that nobody answered."""
        if now > self._deadline:
            self.refused(Refused("NoAnswer", "the hub did not answer in time"))

    def _end(self):
        self._satellite._calls.pop(self._tag, None)
