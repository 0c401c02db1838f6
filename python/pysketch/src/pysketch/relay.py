"""A relay: the hub's end of a serial line, for a hub that listens on sockets only. It passes on each stream as a connection of
its own, and understands nothing of what it passes on."""

import select

from .links import LinkError

_WAIT_S = 0.05
_TAKE_BYTES = 4096


class Relay(object):
    """Serves the callers on a `Port` that listens, until `stop`. `address` is where the hub is."""

    def __init__(self, port, address):
        self._port, self._address, self._ends, self._stopping = port, address, {}, False

    def run(self):
        """Passes on until `stop`."""
        while not self._stopping:
            self.turn()

    def stop(self):
        """Ends `run`."""
        self._stopping = True

    def turn(self):
        """One turn: waits a little, and passes on what there is."""
        links = [end.link for end in self._ends.values()]
        full = [end.link for end in self._ends.values() if end.to_hub]
        select.select([self._port.file] + [link for link in links if link not in full], full, [], _WAIT_S)
        self._port.pump()
        if self._port.failed:
            raise LinkError("the serial port %s failed" % self._port.path)
        line = self._port.line
        while line.opened:
            self._welcome(line.opened.popleft())
        for number, end in list(self._ends.items()):
            if not end.serve(line.streams.get(number)):
                end.link.close()
                del self._ends[number]
        self._port.pump()

    def _welcome(self, number):
        stream = self._port.line.streams.get(number)
        if number in self._ends:
            self._ends.pop(number).link.close()
        try:
            self._ends[number] = _End(stream, self._address.open())
        except LinkError:
            stream.closing = True

    def close(self):
        """Ends all streams, and the port."""
        for end in self._ends.values():
            end.link.close()
            end.stream.closing = True
        self._ends = {}
        self._port.users = 1
        self._port.leave()


class _End(object):
    """One stream and the hub's connection that belongs to it."""

    def __init__(self, stream, link):
        self.stream, self.link, self.to_hub = stream, link, b""
        self._room = bytearray(_TAKE_BYTES)

    def serve(self, stream):
        """Passes on both ways; answers whether it goes on."""
        if stream is not self.stream:
            return False
        try:
            self._up()
            return self._down()
        except LinkError:
            stream.closing = True
            return False

    def _up(self):
        while True:
            if not self.to_hub:
                count = self.stream.read(memoryview(self._room))
                self.to_hub = bytes(self._room[:count])
            if not self.to_hub:
                break
            sent = self.link.send([self.to_hub])
            if sent is None:
                return
            self.to_hub = self.to_hub[sent:]
        if self.stream.closed_there:
            raise LinkError("the caller is done")

    def _down(self):
        room = min(self.stream.room, _TAKE_BYTES)
        if room:
            count = self.link.recv_into(memoryview(self._room)[:room])
            if count == 0:
                self.stream.closing = True
                return False
            if count:
                self.stream.write(bytes(self._room[:count]))
        return True
