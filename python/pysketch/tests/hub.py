"""A real hub for the tests: the program that `SKROBOT` names, with a state folder of its own."""

import contextlib
import os
import shutil
import socket
import subprocess
import tempfile
import threading
import time
import unittest

from pysketch import FlowSat

PROGRAM = os.environ.get("SKROBOT", "skrobot")
PATIENCE_S = int(os.environ.get("PATIENCE_S", "60"))


class Hub(object):
    """A hub that runs until `stop`."""

    def __init__(self, *arguments):
        self.folder = tempfile.mkdtemp(prefix="pysketch-")
        self.arguments = arguments
        self.start()

    def start(self):
        """Starts it, or starts it again, and waits until it listens."""
        environment = dict(os.environ, SKROBOT_STATE_DIR=self.folder)
        command = [PROGRAM, "--state-dir", self.folder, "--tcp", "127.0.0.1:0"] + list(self.arguments)
        command += ["--log", "error"]
        self.process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, universal_newlines=True)
        self.tcp = None
        for line in iter(self.process.stdout.readline, ""):
            if "tcp:" in line:
                self.tcp = line[line.index("tcp:"):].split()[0]
            if "stop" in line:
                return
        raise RuntimeError("the hub did not start")

    @property
    def unix(self):
        """Where it listens for this user's programs."""
        return "unix:" + os.path.join(self.folder, "hub.sock")

    @property
    def token(self):
        """The file of the owner's token."""
        return os.path.join(self.folder, "owner.token")

    def kill(self):
        """Ends it without a word."""
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()

    def stop(self):
        """Ends it and forgets it."""
        if self.process.poll() is None:
            self.process.terminate()
            self.process.wait()
        self.process.stdout.close()
        shutil.rmtree(self.folder, ignore_errors=True)


class Patience(unittest.TestCase):
    """Waits for what happens, not for time."""

    def patiently(self, reached):
        """Asks until something is so; how long that takes is the machine's affair."""
        deadline = time.time() + PATIENCE_S
        while not reached():
            self.assertLess(time.time(), deadline, "it did not happen within %d s" % PATIENCE_S)

    def until(self, reached, *satellites):
        """Pulses satellites until something is so."""
        def pulsed():
            if reached():
                return True
            for satellite in satellites:
                satellite.pulse_once()
            return False
        self.patiently(pulsed)

    def keep(self, satellite):
        """Closes a satellite when the test is over."""
        self.addCleanup(satellite.close)
        return satellite

    def keep_hub(self, hub):
        """Stops a hub when the test is over."""
        self.addCleanup(hub.stop)
        return hub

    @contextlib.contextmanager
    def pulsing(self, satellite):
        """Pulses a satellite in a thread of its own meanwhile."""
        over = threading.Event()

        def pulse():
            while not over.is_set():
                satellite.pulse_once()
        thread = threading.Thread(target=pulse)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()


class HubTest(Patience):
    """Tests with a hub for each class."""

    hub_arguments = ("--without", "host")

    @classmethod
    def setUpClass(cls):
        cls.hub = Hub(*cls.hub_arguments)

    @classmethod
    def tearDownClass(cls):
        cls.hub.stop()

    def sat(self, **settings):
        """A satellite of this hub, which is closed when the test is over."""
        settings.setdefault("interval", 0.01)
        return self.keep(FlowSat(self.hub.unix, **settings))


def free_port():
    """A port of loopback where nobody listens."""
    probe = socket.socket()
    probe.bind(("127.0.0.1", 0))
    port = probe.getsockname()[1]
    probe.close()
    return port


def offers_blobs(hub):
    """Whether a hub keeps files."""
    sat, refusals = FlowSat(hub.unix, interval=0.01), []
    sat.on_refused = refusals.append
    store = sat.store("probe")
    try:
        return sat.until(lambda: store.opened or refusals, PATIENCE_S) and store.opened
    finally:
        sat.close()
