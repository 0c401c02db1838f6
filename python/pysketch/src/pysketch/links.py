"""Where a hub is, and what a connection is made of: TCP and Unix sockets, and streams of a serial line.

A link has `fileno()`, `recv_into(view)`, `send(parts)` and `close()`; both calls answer None when they would
have to wait. `fragment_bytes` is the longest fragment that suits it, `login_s` what a login may take on it, and
`due()` in how many seconds it wants to be read though its file has nothing (None: never),
`watches(wants_write)` whether to wait until its file can be written.
"""

import errno
import os
import socket

from . import table
from .frames import as_bytes
from .login import LoginError, Password, Peer, Token, state_folder

_WAIT = (errno.EAGAIN, errno.EWOULDBLOCK, errno.EINTR)
# Linux takes 1,024 parts in one call; more than this is never ready at once.
PARTS_MAX = 64
_JOIN_BYTES_MAX = 64 * 1024
BAUD_DEFAULT = 115200


class LinkError(IOError):
    """The hub cannot be reached, or the link broke."""


class Address(object):
    """Where a hub is: `unix:/path/hub.sock`, `tcp:127.0.0.1:4141`, `tty:/dev/ttyUSB0?baud=115200`. None: this
    user's hub."""

    def __init__(self, text=None):
        if text is None:
            text = os.environ.get("SKROBOT_HUB") or "unix:" + os.path.join(state_folder(), "hub.sock")
        kind, _, rest = str(text).partition(":")
        self.text, self.kind, self.baud = str(text), kind, BAUD_DEFAULT
        if kind == "unix" and rest:
            self.place = rest
        elif kind == "tcp" and rest.rpartition(":")[2].isdigit():
            host, _, port = rest.rpartition(":")
            self.place = (host.strip("[]"), int(port))
        elif kind == "tty" and rest:
            self.place, _, speed = rest.partition("?baud=")
            if speed and not speed.isdigit():
                raise LinkError("%r says no speed: tty:DEVICE?baud=NUMBER" % (text,))
            self.baud = int(speed or BAUD_DEFAULT)
        else:
            raise LinkError("%r is no address of a hub: it is unix:PATH, tcp:HOST:PORT or tty:DEVICE" % (text,))

    def __str__(self):
        return self.text

    def credentials(self, given=None):
        """How to log in there: what was given, else the user of the socket, else the owner's token."""
        if given is not None:
            return Password(*given) if isinstance(given, tuple) else given
        if self.kind == "unix":
            return Peer()
        path = os.path.join(state_folder(), "owner.token")
        try:
            return Token.read(path)
        except LoginError as error:
            raise LoginError("%s; give credentials=Token.read(path) or credentials=(user, password)" % error)

    def open(self, timeout=2.0):
        """A link to the hub. Blocks until it is connected, `timeout` seconds at most."""
        try:
            if self.kind == "unix":
                link = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            elif self.kind == "tcp":
                return self._open_tcp(timeout)
            else:
                from .tty import call
                return call(self.place, self.baud)
            try:
                link.settimeout(timeout)
                link.connect(self.place)
            except Exception:
                link.close()
                raise
        except LinkError:
            raise
        except Exception as error:  # of sockets, files and termios, which share no base in Python 2
            raise self._unreachable(error)
        return SocketLink(link)

    def _open_tcp(self, timeout):
        link = socket.create_connection(self.place, timeout)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return SocketLink(link)

    def _unreachable(self, error):
        if self.kind == "tty":
            return LinkError("the serial line %s cannot be used: %s" % (self, error))
        return LinkError("no hub answers at %s (%s): is skrobot running?" % (self, error))


class SocketLink(object):
    """A connected socket."""

    fragment_bytes = table.FRAGMENT_BYTES_MAX
    login_s = table.LOGIN_TIME_MAX_S

    def __init__(self, link):
        link.setblocking(False)
        self._link, self.closed = link, False
        self._gathers = hasattr(link, "sendmsg")

    def fileno(self):
        """For `select`."""
        return self._link.fileno()

    def due(self):
        """None: what a socket has, its file tells."""
        return None

    def watches(self, wants_write):
        """Whether it matters that it becomes writable."""
        return wants_write

    def recv_into(self, view):
        """Receives; answers how many bytes, 0 at the end of the stream, None if there are none yet."""
        try:
            return self._link.recv_into(view)
        except (socket.error, IOError) as error:
            if error.errno in _WAIT:
                return None
            raise LinkError("the link broke: %s" % error)

    def send(self, parts):
        """Sends the beginning of the parts; answers how many bytes went, None if none could."""
        try:
            if self._gathers:
                return self._link.sendmsg(parts[:PARTS_MAX])
            return self._link.send(_joined(parts))
        except (socket.error, IOError) as error:
            if error.errno in _WAIT:
                return None
            raise LinkError("the link broke: %s" % error)

    def close(self):
        """Ends it."""
        self.closed = True
        self._link.close()


def _joined(parts):
    """One piece for a socket that takes no list."""
    if len(parts[0]) >= _JOIN_BYTES_MAX:
        return parts[0]
    taken, length = [], 0
    for part in parts:
        if taken and length + len(part) > _JOIN_BYTES_MAX:
            break
        taken.append(as_bytes(part))
        length += len(part)
    return b"".join(taken)
