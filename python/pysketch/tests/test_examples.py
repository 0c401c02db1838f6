"""Every example runs, on the interpreter of these tests, and says what it should."""

import os
import shutil
import subprocess
import sys
import tempfile
import threading
import unittest

from hub import PATIENCE_S, HubTest, offers_blobs
from pysketch import connect

FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "examples")
SOURCES = os.path.abspath(os.path.join(FOLDER, "..", "src"))
# The smallest JPEG file that has a size: 3 x 2, grey.
JPEG = bytes(bytearray.fromhex(u"ffd8ffc0000b0800020003010111 00ffd9".replace(u" ", u"")))


def start(hub, name, *arguments, **settings):
    """Starts an example in a process of its own."""
    environment = dict(os.environ, SKROBOT_HUB=hub.unix, PYTHONPATH=SOURCES, PYTHONUNBUFFERED="1")
    python = settings.get("python", sys.executable)
    return subprocess.Popen([python, os.path.join(FOLDER, name)] + list(arguments), env=environment,
                            stdout=subprocess.PIPE, universal_newlines=True)


class Examples(HubTest):
    """Each of them."""

    tried = set()

    def run_example(self, name, *arguments, **settings):
        """Starts it, and ends it with the test."""
        Examples.tried.add(name)
        process = start(self.hub, name, *arguments, **settings)

        def end():
            if process.poll() is None:
                process.terminate()
            process.wait()
            process.stdout.close()
        patience = threading.Timer(PATIENCE_S, process.kill)
        patience.start()
        self.addCleanup(end)
        self.addCleanup(patience.cancel)
        return process

    def wait_for(self, process, words):
        """Reads what it prints up to a line with these words."""
        for line in iter(process.stdout.readline, ""):
            if words in line:
                return line
        self.fail("it ended without saying %r" % words)

    def wait_for_channel(self, name):
        with connect(self.hub.unix) as hub:
            self.patiently(lambda: name in [channel.name for channel in hub.channels()])

    def folder(self):
        folder = tempfile.mkdtemp(prefix="pysketch-")
        self.addCleanup(shutil.rmtree, folder)
        return folder

    def test_publisher_and_subscriber(self):
        self.run_example("publisher.py")
        line = self.wait_for(self.run_example("subscriber.py"), "robot.celsius is 2")
        self.assertTrue(21.5 <= float(line.split()[-1]) < 22.5, line)

    def test_service_and_asker(self):
        self.run_example("service.py")
        self.wait_for_channel("robot.sum")
        self.wait_for(self.run_example("asker.py", "1", "2", "3.5"), "6.5")

    def test_camera(self):
        folder = self.folder()
        with open(os.path.join(folder, "one.jpg"), "wb") as file:
            file.write(JPEG)
        self.run_example("camera.py", folder)
        self.wait_for(self.run_example("camera.py", "--watch"), "17 bytes, 3 x 2")

    def test_sync_pair(self):
        source = self.run_example("sync_source.py")
        self.wait_for(self.run_example("sync_target.py"), "tick 50")
        self.wait_for(source, "missed")

    def test_inside_and_outside(self):
        # The robot's own Python is an old one where there is one.
        self.run_example("inside.py", python=os.environ.get("PYTHON2", sys.executable))
        outside = self.run_example("outside.py")
        self.wait_for(outside, "goals:")
        self.wait_for(outside, "the arm is up")
        self.assertEqual(outside.wait(), 0)

    def test_file_store(self):
        Examples.tried.add("file_store.py")
        if not offers_blobs(self.hub):
            self.skipTest("this hub has no blob channels")
        folder = self.folder()
        with open(os.path.join(folder, "map.txt"), "wb") as file:
            file.write(b"here be dragons\n" * 40000)
        self.wait_for(self.run_example("file_store.py", folder), "all is stored")
        reader = self.run_example("file_store.py", "--read", "map.txt")
        self.assertEqual(reader.stdout.read(), "here be dragons\n" * 40000)

    def test_zz_every_example_was_run(self):
        self.assertEqual(sorted(Examples.tried), sorted(name for name in os.listdir(FOLDER) if name.endswith(".py")))


if __name__ == "__main__":
    unittest.main()
