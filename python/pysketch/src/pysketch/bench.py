"""What this Python takes from a hub: large frames in bytes a second, small messages a second.

A publisher in a process of its own sends on a channel as fast as the hub gives it credit; a subscriber with the policy
`all` counts here, so nothing may be lost. The publisher sends blocks of frames that it made beforehand, so that it takes as
little from the others as a publisher can. What each of the three processes needed of a core is told too.
"""

from __future__ import print_function

import json
import os
import socket
import struct
import subprocess
import sys

from .clock import monotonic
from .frames import WHOLE, publish_head
from .pulse import SOCKET
from .sat import FlowSat
from .streams import FRAGMENT_COST_BYTES

CASES = (("large", 64 * 1024), ("small", 16))
# What is made beforehand, with what it costs of the credit, and what the publisher keeps ready for its socket.
BLOCK_COST_BYTES, OUT_BYTES_MAX = 128 * 1024 + 1024, 512 * 1024
_PATIENCE_S = 10.0


class Publisher(FlowSat):
    """Sends payloads of one size as fast as its credit goes."""

    def __init__(self, hub, name, size):
        FlowSat.__init__(self, hub, mode=SOCKET, interval=0.001)
        self._name, self._payload, self._out = name, b"\x5a" * size, None
        self._block, self._cost = b"", 0

    def setup(self):
        self._out = self.stream(self._name, format="bytes", delivery="reliable")

    def on_start(self, name):
        cost = len(self._payload) + FRAGMENT_COST_BYTES
        count = BLOCK_COST_BYTES // cost
        frame = publish_head(self._out.reference, 0, WHOLE, len(self._payload)) + self._payload
        self._block, self._cost = frame * count, cost * count

    def loop(self):
        while self._out.wanted and self._out.credit_left >= self._cost and self.waiting < OUT_BYTES_MAX:
            self._out.send_frames(self._block, self._cost)


def publish(hub, name, size):
    """The publisher's process."""
    Publisher(hub, name, size).run()


class Count(object):
    """What came, and when the first of it."""

    def __init__(self):
        self.messages = self.bytes = 0
        self.begun = None

    def add(self, _channel, payloads):
        """A batch."""
        if self.begun is None:
            self.begun = monotonic()
        self.messages += len(payloads)
        self.bytes += sum(map(len, payloads))


def bench(options):
    """Measures both cases and prints them."""
    results = [measure(options.hub, case, size, options.seconds) for case, size in CASES]
    for result in results:
        if options.json:
            print(json.dumps(result, sort_keys=True))
        else:
            shares = ["%.0f %% %s" % (100 * share, who) for who, share in sorted(result["cpu"].items())]
            print("%-6s %6d bytes %10.0f messages/s %8.1f MB/s; of a core: %s" % (
                result["case"], result["bytes_each"], result["messages_per_s"], result["mb_per_s"], ", ".join(shares)))


def measure(hub, case, size, seconds):
    """One case: what came in `seconds`, from the first message on."""
    subscriber, count = FlowSat(hub, interval=0.05, reconnect=False).connect(), Count()
    name = "bench-%s-%d" % (case, os.getpid())
    publisher = _start(hub, name, size)
    processes = {"subscriber": os.getpid(), "publisher": publisher.pid, "hub": _peer(subscriber)}
    try:
        subscriber.subscribe("%s.%s" % (subscriber.user, name), on_batch=count.add, policy="all")
        if not subscriber.until(lambda: count.begun, _PATIENCE_S):
            raise SystemExit("pysketch: the publisher's messages do not come")
        before, first = _needed(processes), (count.messages, count.bytes)
        begun = monotonic()
        subscriber.until(lambda: monotonic() - begun >= seconds, seconds + _PATIENCE_S)
        spent, after = monotonic() - begun, _needed(processes)
        messages, size_in_all = count.messages - first[0], count.bytes - first[1]
    finally:
        publisher.terminate()
        publisher.wait()
        subscriber.close()
    shares = dict((who, (after[who] - before[who]) / spent) for who in before if who in after)
    return {
        "case": case, "bytes_each": size, "messages_per_s": messages / spent, "mb_per_s": size_in_all / spent / 1e6,
        "cpu": shares, "python": sys.version.split()[0],
    }


def _start(hub, name, size):
    code = "from pysketch.bench import publish; publish(%r, %r, %d)" % (hub, name, size)
    folder = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    environment = dict(os.environ, PYTHONPATH=folder + os.pathsep + os.environ.get("PYTHONPATH", ""))
    return subprocess.Popen([sys.executable, "-c", code], env=environment)


def _peer(satellite):
    """The hub's process, where the link tells it: a Unix socket on Linux."""
    link = socket.fromfd(satellite.flow.connection.link.fileno(), socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        return struct.unpack("iII", link.getsockopt(socket.SOL_SOCKET, getattr(socket, "SO_PEERCRED", 17), 12))[0]
    except (socket.error, struct.error):
        return 0
    finally:
        link.close()


def _needed(processes):
    """The seconds of a core that each of them has needed, where the system tells that."""
    needed = {}
    for who, number in processes.items():
        try:
            with open("/proc/%d/stat" % number) as file:
                fields = file.read().rpartition(")")[2].split()
            needed[who] = (int(fields[11]) + int(fields[12])) / float(os.sysconf("SC_CLK_TCK"))
        except (IOError, OSError):
            pass
    return needed
