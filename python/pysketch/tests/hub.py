"""A real hub for the tests: the program that `SKROBOT` names, with a state folder of its own."""

import os
import shutil
import socket
import subprocess
import tempfile
import time
import unittest

PROGRAM = os.environ.get("SKROBOT", "skrobot")


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

    def until(self, reached, *satellites):
        """Pulses satellites until something is so; how long that takes is the machine's affair."""
        deadline = time.time() + 60
        while not reached():
            self.assertLess(time.time(), deadline, "it did not happen within a minute")
            for satellite in satellites:
                satellite.pulse_once()


class HubTest(Patience):
    """Tests with a hub for each class."""

    hub_arguments = ("--without", "host")

    @classmethod
    def setUpClass(cls):
        cls.hub = Hub(*cls.hub_arguments)

    @classmethod
    def tearDownClass(cls):
        cls.hub.stop()


def free_port():
    """A port of loopback where nobody listens."""
    probe = socket.socket()
    probe.bind(("127.0.0.1", 0))
    port = probe.getsockname()[1]
    probe.close()
    return port
