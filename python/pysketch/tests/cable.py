"""A serial cable between two programs: a pseudo terminal at either end, and a thread that carries bytes."""

import errno
import os
import random
import select
import threading
import tty

_READ_BYTES = 4096
# What waits for an end that does not read is bounded, as in a real port.
_HELD_BYTES_MAX = 64 * 1024


class Cable(object):
    """`ends` are the two devices. With `damage` that share of what passes arrives with a flipped bit."""

    def __init__(self, damage=0.0, seed=1):
        self._damage, self._chance = damage, random.Random(seed)
        pairs = [os.openpty(), os.openpty()]
        self._masters, self._slaves = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
        for slave in self._slaves:
            # Until somebody opens it nothing may be echoed; held open, it is never hung up.
            tty.setraw(slave)
        self.ends = [os.ttyname(slave) for slave in self._slaves]
        self.damaged, self._over = 0, False
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self):
        """Ends it."""
        self._over = True
        self._thread.join()
        for file in self._masters + self._slaves:
            os.close(file)

    def _run(self):
        held = [b"", b""]
        while not self._over:
            readers = [self._masters[at] for at in (0, 1) if len(held[1 - at]) < _HELD_BYTES_MAX]
            writers = [self._masters[at] for at in (0, 1) if held[at]]
            readable, writable, _ = select.select(readers, writers, [], 0.02)
            for at, master in enumerate(self._masters):
                if master in readable:
                    held[1 - at] += self._carried(os.read(master, _READ_BYTES))
                if master in writable:
                    held[at] = held[at][self._write(master, held[at][:512]):]

    def _carried(self, data):
        if self._chance.random() >= self._damage:
            return data
        raw = bytearray(data)
        raw[self._chance.randrange(len(raw))] ^= 0x04
        self.damaged += 1
        return bytes(raw)

    @staticmethod
    def _write(master, data):
        try:
            return os.write(master, data)
        except OSError as error:
            if error.errno != errno.EAGAIN:
                raise
            return 0
