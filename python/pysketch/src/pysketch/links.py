"""What a connection is made of: a socket here, a stream of a serial line in `tty`.

A link has `fileno()`, `recv_into(view)`, `send(parts)` and `close()`; both calls answer None when they would
have to wait. `fragment_bytes` is the longest fragment that suits it, `login_s` what a login may take on it, and
`due()` in how many seconds it wants to be read though its file has nothing (None: never),
`watches(wants_write)` whether to wait until its file can be written.
"""

import errno
import socket

from . import table
from .frames import as_bytes

_WAIT = (errno.EAGAIN, errno.EWOULDBLOCK, errno.EINTR)
# Linux takes 1,024 parts in one call; more than this is never ready at once.
PARTS_MAX = 64
_JOIN_BYTES_MAX = 64 * 1024


class LinkError(IOError):
    """The hub cannot be reached, or the link broke."""


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
