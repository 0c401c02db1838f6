"""A link that can break without the hub's noticing: a relay of one TCP connection after the other."""

import select
import socket
import threading


class Proxy(object):
    """Passes on what it gets at `address` to the hub's TCP address."""

    def __init__(self, hub_tcp):
        host, _, port = hub_tcp[len("tcp:"):].rpartition(":")
        self._hub = (host, int(port))
        self._door = socket.socket()
        self._door.bind(("127.0.0.1", 0))
        self._door.listen(4)
        self.address = "tcp:127.0.0.1:%d" % self._door.getsockname()[1]
        self._pairs, self._held, self._over, self._lock = [], [], False, threading.Lock()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def cut(self):
        """Ends the satellites' side of all connections; the hub's side stays open and silent."""
        with self._lock:
            for near, far in self._pairs:
                near.close()
                self._held.append(far)
            self._pairs = []

    def close(self):
        """Ends everything."""
        self._over = True
        self._thread.join()
        self.cut()
        for far in self._held + [self._door]:
            far.close()

    def _run(self):
        while not self._over:
            with self._lock:
                ends = dict((end, pair[1 - at]) for pair in self._pairs for at, end in enumerate(pair))
                ready = select.select([self._door] + list(ends), [], [], 0.01)[0]
                for end in ready:
                    if end is self._door:
                        self._pairs.append((self._door.accept()[0], socket.create_connection(self._hub)))
                    else:
                        self._pass_on(end, ends[end])

    def _pass_on(self, end, other):
        try:
            data = end.recv(65536)
            if data:
                return other.sendall(data)
        except socket.error:
            pass
        self._pairs = [pair for pair in self._pairs if end not in pair]
        end.close()
        other.close()
