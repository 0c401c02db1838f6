"""What this Python takes from a hub: large frames in bytes a second, small messages a second.

A publisher in a process of its own sends on a channel as fast as the hub gives it credit; a subscriber with the
policy `all` counts here, so nothing may be lost.
"""

from __future__ import print_function

import json
import os
import subprocess
import sys

from .clock import monotonic
from .pulse import SOCKET
from .sat import FlowSat

CASES = (("large", 64 * 1024), ("small", 16))
# What the publisher keeps ready for its socket.
OUT_BYTES_MAX = 1024 * 1024


class Publisher(FlowSat):
    """Sends payloads of one size as fast as its credit goes."""

    def __init__(self, hub, credentials, name, size):
        FlowSat.__init__(self, hub, credentials=credentials, mode=SOCKET, interval=0.001)
        self._name, self._payload, self._out = name, b"\x5a" * size, None

    def setup(self):
        self._out = self.stream(self._name, format="bytes", delivery="reliable")

    def loop(self):
        while self._out.wanted and self.waiting < OUT_BYTES_MAX:
            self._out.publish_bytes(self._payload)


class Subscriber(FlowSat):
    """Counts what comes, a batch at a time."""

    def __init__(self, *arguments, **settings):
        FlowSat.__init__(self, *arguments, **settings)
        self.messages = self.bytes = 0
        self.begun, self.busy = None, 0.0

    def count(self, _channel, payloads):
        """Some messages."""
        if self.begun is None:
            self.begun, self.busy = monotonic(), sum(os.times()[:2])
        self.messages += len(payloads)
        self.bytes += sum(map(len, payloads))


def publish(hub, name, size):
    """The publisher's process."""
    Publisher(hub, None, name, size).run()


def bench(options):
    """Measures both cases and prints them."""
    results = [measure(options.hub, case, size, options.seconds) for case, size in CASES]
    for result in results:
        if options.json:
            print(json.dumps(result, sort_keys=True))
        else:
            print("%(case)-6s %(bytes_each)6d bytes  %(messages_per_s)10.0f messages/s  %(mb_per_s)8.1f MB/s"
                  "  %(cpu)4.0f %% of a core here" % dict(result, cpu=100 * result["cpu"]))


def measure(hub, case, size, seconds):
    """One case: what came in `seconds`, from the first message on."""
    subscriber = Subscriber(hub, interval=0.05, reconnect=False)
    subscriber.connect()
    name = "bench-%s-%d" % (case, os.getpid())
    code = "from pysketch.bench import publish; publish(%r, %r, %d)" % (hub, name, size)
    folder = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    environment = dict(os.environ, PYTHONPATH=folder + os.pathsep + os.environ.get("PYTHONPATH", ""))
    publisher = subprocess.Popen([sys.executable, "-c", code], env=environment)
    try:
        subscriber.subscribe("%s.%s" % (subscriber.user, name), on_batch=subscriber.count, depth=1024, policy="all")
        patience = monotonic() + seconds + 10.0
        while subscriber.begun is None or monotonic() - subscriber.begun < seconds:
            subscriber.pulse_once()
            if subscriber.begun is None and monotonic() > patience:
                raise SystemExit("pysketch: the publisher's messages do not come")
        spent, busy = monotonic() - subscriber.begun, sum(os.times()[:2]) - subscriber.busy
    finally:
        publisher.terminate()
        publisher.wait()
        subscriber.close()
    return {
        "case": case, "bytes_each": size, "messages_per_s": subscriber.messages / spent,
        "mb_per_s": subscriber.bytes / spent / 1e6, "cpu": busy / spent, "python": sys.version.split()[0],
    }
