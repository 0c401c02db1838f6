"""Serial lines as links: the port of a line, and its streams as connections to a hub."""

import errno
import os
import select

from .clock import monotonic
from .envelope import PAYLOAD_BYTES_MAX
from .frames import as_bytes
from .line import Line
from .links import LinkError
from .table import SILENCE_MAX_S

_READ_BYTES = 16 * 1024
# The last words of a line may take so long.
_FAREWELL_S = 0.5
_ports = {}


def call(path, baud):
    """A link to the hub at the other end of a line. Links of one process share the line."""
    port = _ports.get(path)
    if port is None or port.failed:
        port = _ports[path] = Port(open_port(path), path, baud)
    return LineLink(port)


def open_port(path):
    """The descriptor of a serial port."""
    return os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)


class Port(object):
    """A serial port, raw and non-blocking, and the line on it. `file` is its descriptor, which becomes the port's own;
    `users` counts the links."""

    def __init__(self, file, path, baud, listens=False):
        self.file, self.path, self.users, self.failed, self._rest = file, path, 0, False, b""
        try:
            _make_raw(file, baud)
        except Exception:
            os.close(file)
            raise
        self.line = Line(monotonic(), baud, listens)

    @property
    def has_unsent(self):
        """Whether the port did not take all that was there for it."""
        return bool(self._rest)

    def pump(self):
        """Reads what came, looks at the time, and writes what there is to say."""
        now = monotonic()
        try:
            for _ in range(16):
                data = os.read(self.file, _READ_BYTES)
                if not data:
                    break
                self.line.receive(data, now)
        except OSError as error:
            self._judge(error, now)
        self.line.tick(now)
        try:
            while not self.failed:
                self._rest = self._rest or self.line.output(now) or b""
                if not self._rest:
                    return
                self._rest = self._rest[os.write(self.file, self._rest):]
        except OSError as error:
            self._judge(error, now)

    def _judge(self, error, now):
        if error.errno not in (errno.EAGAIN, errno.EINTR):
            self.failed = True
            self.line.end(now)

    def leave(self):
        """One link less; with the last one the port is closed, after what was said has gone."""
        self.users -= 1
        if self.users:
            return
        if _ports.get(self.path) is self:
            del _ports[self.path]
        deadline = monotonic() + _FAREWELL_S
        while self.line.streams and not self.failed and monotonic() < deadline:
            self.pump()
            select.select([self.file], [], [], 0.02)
        os.close(self.file)


def _make_raw(file, baud):
    import fcntl
    import termios
    fcntl.fcntl(file, fcntl.F_SETFL, fcntl.fcntl(file, fcntl.F_GETFL) | os.O_NONBLOCK)
    speed = getattr(termios, "B%d" % baud, None)
    if speed is None:
        raise LinkError("a serial line cannot have %d baud" % baud)
    settings = termios.tcgetattr(file)
    settings[0] = settings[1] = settings[3] = 0
    settings[2] = termios.CS8 | termios.CREAD | termios.CLOCAL
    settings[4] = settings[5] = speed
    settings[6][termios.VMIN], settings[6][termios.VTIME] = 1, 0
    termios.tcsetattr(file, termios.TCSANOW, settings)


class LineLink(object):
    """One stream of a line, opened as soon as the line is up."""

    fragment_bytes = PAYLOAD_BYTES_MAX
    login_s = SILENCE_MAX_S

    def __init__(self, port):
        self._port, self._number, self._stream, self.closed = port, None, None, False
        port.users += 1

    def _open(self):
        """The stream, or None while there is none yet; raises when it has gone with its line."""
        line = self._port.line
        if self._stream is None:
            self._number = line.open()
            self._stream = line.streams.get(self._number)
        elif line.streams.get(self._number) is not self._stream:
            raise LinkError("the serial line %s is down" % self._port.path)
        if self._port.failed:
            raise LinkError("the serial port %s failed" % self._port.path)
        return self._stream

    def fileno(self):
        """For `select`."""
        return self._port.file

    def due(self):
        """In how many seconds it wants to be read: at once if another link of the line has read for it."""
        stream = self._stream
        if stream is not None and (stream.incoming or stream.closed_there) or self._port.failed:
            return 0
        if stream is not None and self._port.line.streams.get(self._number) is not stream:
            return 0
        return self._port.line.due(monotonic())

    def watches(self, wants_write):
        """Whether it matters that the port becomes writable."""
        return self._port.has_unsent or wants_write and self._stream is not None and self._stream.room > 0

    def recv_into(self, view):
        """Receives; answers how many bytes, 0 at the end of the stream, None if there are none yet."""
        self._port.pump()
        stream = self._open()
        if stream is None:
            return None
        count = stream.read(view)
        if count:
            # The other side may be waiting to hear that there is room again.
            self._port.pump()
            return count
        return 0 if stream.closed_there else None

    def send(self, parts):
        """Sends the beginning of the parts; answers how many bytes went, None if none could."""
        stream, sent = self._open(), 0
        for part in parts:
            if stream is None or not stream.room:
                break
            data = as_bytes(memoryview(part)[:stream.room])
            sent += stream.write(data)
            if len(data) < len(part):
                break
        self._port.pump()
        return sent or None

    def close(self):
        """Ends it."""
        if self.closed:
            return
        self.closed = True
        if self._stream is not None:
            self._stream.closing = True
        self._port.leave()
