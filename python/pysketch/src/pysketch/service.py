"""Services: requests that come to one's own, and calls of others'."""

import traceback

from .channels import OwnChannel
from .clock import monotonic
from .connection import Refused
from .flow import Part
from .frames import Gathering
from .variant import BINARY, JSON, pack, unpack

# What the hub may take beyond the deadline that it was given, in seconds.
GRACE_S = 2.0


def form_of(properties):
    """The form of what is asked and answered: JSON if the service's `format` says so, else variants."""
    return JSON if properties.get("format") == "json" else BINARY


class Service(OwnChannel):
    """A service of one's own: `answer(request)` is called for each request."""

    command = "create_service"

    def __init__(self, flow, name, properties, answer):
        OwnChannel.__init__(self, flow, name, properties)
        self.answer = answer


class Request(object):
    """A request to a service of one's own. `value` is what was asked, `asker` the connection that asks; `over` is
    whether nobody waits for the answer any more, `done` whether it was answered."""

    def __init__(self, service, number, asker, payload):
        self._service, self._number, self.asker, self.payload = service, number, asker, payload
        self._connection, self.done, self.over = service.flow.connection, False, False

    @property
    def value(self):
        """The payload as a value."""
        return unpack(form_of(self._service.properties), self.payload)

    def answer(self, value, more=False):
        """Answers with a value; with `more` the request stays open and further answers follow."""
        self.answer_bytes(pack(value, form_of(self._service.properties)), more)

    def answer_bytes(self, payload, more=False):
        """As `answer`, bytes as they are."""
        if self._is_open():
            self.done = not more
            self._connection.send_message("answer", 0, (self._number, int(more)), payload)

    def decline(self, why):
        """Says that there will be no answer, and why."""
        if self._is_open():
            self.done = True
            self._connection.send_untagged("decline", self._number, u"%s" % (why,))

    def _is_open(self):
        # A request of a lost connection is over for everybody.
        return not self.done and not self.over and self._connection is self._service.flow.connection

    def handle(self):
        """Lets the service answer: what its function returns is the answer unless it answered, or is None."""
        try:
            value = self._service.answer(self)
            if value is not None:
                self.answer(value)
        except Exception as error:
            traceback.print_exc()
            self.decline("%s: %s" % (type(error).__name__, error))


class Reply(object):
    """What became of a call: `ok`, and then `value` or `payload`; else `error`, a `Refused`. `more`: further
    replies follow."""

    def __init__(self, payload=None, error=None, more=False, form=BINARY):
        self.payload, self.error, self.more, self._form = payload, error, more, form

    @property
    def ok(self):
        """Whether there is an answer."""
        return self.error is None

    @property
    def value(self):
        """The answer as a value; raises the error if there is none."""
        if self.error is not None:
            raise self.error
        return unpack(self._form, self.payload)


class Call(object):
    """A call of somebody's service that is under way; `then(reply)` is called with each reply."""

    def __init__(self, calls, flow, name, value, payload, then, within):
        self.name, self._calls, self._flow, self._value, self._payload = name, calls, flow, value, payload
        self._then, self._within, self._deadline = then, within, monotonic() + within
        self._tag, self._form = None, BINARY

    @property
    def sent(self):
        """Whether it is on its way."""
        return self._tag is not None

    def begin(self):
        """Sends it, if there is such a service; answers whether there is."""
        channel = self._flow.channels.named(self.name, "service") if self._flow.ready else None
        if channel is None:
            return False
        self._form = form_of(channel.properties)
        payload = self._payload if self._payload is not None else pack(self._value, self._form)
        left = max(0.001, self._deadline - monotonic())
        self._deadline += GRACE_S
        self._tag = self._flow.ask_message(
            self._answered, "call", (channel.reference, int(left * 1000)), payload, about=self.name)
        return True

    def cancel(self):
        """Gives it up: no reply comes."""
        if self._calls.end(self) and self._tag is not None and self._flow.connection is not None:
            self._flow.forget(self._tag)
            self._flow.connection.send_untagged("cancel", self._tag)

    def _answered(self, answer):
        if isinstance(answer, Refused):
            return self.fail(answer)
        more, payload = answer[1]
        if more:
            self._deadline = monotonic() + self._within + GRACE_S
        else:
            self._calls.end(self)
        self._then(Reply(payload=payload, more=bool(more), form=self._form))

    def fail(self, refusal):
        """There is no answer."""
        if self._calls.end(self):
            self._then(Reply(error=refusal))

    def check(self, now):
        """Looks at the deadline."""
        if now > self._deadline:
            if self._tag is None:
                return self.fail(Refused("NoSuchService", "there is no service %s" % self.name, self.name))
            # The hub itself says when nobody answers; one that does not even do that is given up.
            self._flow.forget(self._tag)
            self.fail(Refused("NoAnswer", "the hub did not answer in time", self.name))


class Calls(Part):
    """Calls that are under way, and those whose service is waited for; requests that are open."""

    def __init__(self, flow):
        self._flow, self._open, self._requests, self._gathering = flow, [], {}, Gathering()
        self.events = {"request": self._on_request, "request_over": self._on_request_over}

    def begin(self, name, value, payload, then, within):
        """Calls a service, now or when it exists."""
        call = Call(self, self._flow, name, value, payload, then, within)
        self._open.append(call)
        call.begin()
        return call

    def end(self, call):
        """It is over; answers whether it was under way."""
        found = call in self._open
        if found:
            self._open.remove(call)
        return found

    def restore(self):
        for call in list(self._open):
            if not call.sent:
                call.begin()

    def channel_added(self, channel):
        for call in list(self._open):
            if call.name == channel.name and not call.sent:
                call.begin()

    def lose(self, error):
        self._gathering = Gathering()
        for request in self._requests.values():
            request.over = True
        self._requests = {}

    def check(self, now):
        for call in list(self._open):
            call.check(now)
        self._requests = dict((number, request) for number, request in self._requests.items() if not request.done)

    def _on_request(self, _tag, flags, fields):
        reference, number, asker, piece = fields
        payload = self._gathering.take(number, number, flags, piece)
        service = self._flow.own_of(reference)
        if payload is not None and isinstance(service, Service):
            request = self._requests[number] = Request(service, number, asker, payload)
            request.handle()

    def _on_request_over(self, _tag, _flags, fields):
        self._gathering.forget(fields[0])
        request = self._requests.pop(fields[0], None)
        if request is not None:
            request.over = True
