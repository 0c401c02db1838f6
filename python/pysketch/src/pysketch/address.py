"""Where a hub is, how to log in there, and the way to it."""

import os
import socket

from .links import LinkError, SocketLink
from .login import LoginError, Password, Peer, Token, state_folder
from .tty import Port, call, open_port

BAUD_DEFAULT = 115200


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

    def listen(self):
        """The hub's end of this serial line: a `Port` that takes callers."""
        if self.kind != "tty":
            raise LinkError("%s is no serial line; one is tty:DEVICE?baud=NUMBER" % self)
        try:
            return Port(open_port(self.place), self.place, self.baud, listens=True)
        except LinkError:
            raise
        except Exception as error:
            raise self._unreachable(error)

    def open(self, timeout=2.0):
        """A link to the hub. Blocks until it is connected, `timeout` seconds at most."""
        try:
            if self.kind == "tty":
                return call(self.place, self.baud)
            if self.kind == "tcp":
                return SocketLink(self._open_tcp(timeout))
            return SocketLink(self._open_unix(timeout))
        except LinkError:
            raise
        except Exception as error:  # of sockets, files and termios, which share no base in Python 2
            raise self._unreachable(error)

    def _open_tcp(self, timeout):
        connected = socket.create_connection(self.place, timeout)
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connected

    def _open_unix(self, timeout):
        connected = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            connected.settimeout(timeout)
            connected.connect(self.place)
        except Exception:
            connected.close()
            raise
        return connected

    def _unreachable(self, error):
        if self.kind == "tty":
            return LinkError("the serial line %s cannot be used: %s" % (self, error))
        return LinkError("no hub answers at %s (%s): is skrobot running?" % (self, error))
