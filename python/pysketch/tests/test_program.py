"""The command line, and the one-file bundle: as a user has them."""

import os
import shutil
import subprocess
import sys
import tempfile
import unittest

from hub import HubTest
from pysketch import connect

SOURCES = os.path.abspath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "src"))


class Program(HubTest):
    """`python -m pysketch`."""

    def setUp(self):
        HubTest.setUp(self)
        self.folder = tempfile.mkdtemp(prefix="pysketch-")
        self.addCleanup(shutil.rmtree, self.folder)

    def environment(self, path):
        environment = dict(os.environ, SKROBOT_HUB=self.hub.unix, PYTHONUNBUFFERED="1", PYTHONDONTWRITEBYTECODE="1")
        environment.pop("PYTHONPATH", None)
        # An installed package is tried as it is.
        if path and not os.environ.get("PYSKETCH_INSTALLED"):
            environment["PYTHONPATH"] = path
        return environment

    def start(self, *arguments, **settings):
        """Starts Python in the folder of the test."""
        process = subprocess.Popen(
            [sys.executable] + list(arguments), cwd=self.folder, env=self.environment(settings.get("path", SOURCES)),
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)
        self.addCleanup(process.stdout.close)
        return process

    def says(self, *arguments, **settings):
        """What it says until it ends, and how it ends."""
        process = self.start(*arguments, **settings)
        said = process.stdout.read()
        return said, process.wait()

    def pysketch(self, *arguments):
        return self.says("-m", "pysketch", *arguments)

    def test_a_new_sketch_runs_and_is_seen(self):
        said, status = self.pysketch("new", "ramp.py")
        self.assertEqual(status, 0, said)
        self.assertIn("python -m pysketch run ramp.py", said)
        self.assertIn("exists already", self.pysketch("new", "ramp.py")[0])
        process = self.start("-m", "pysketch", "run", "ramp.py")
        try:
            line = process.stdout.readline()
            self.assertIn("robot.ramp 0.", line)
            said, status = self.pysketch("check")
            self.assertEqual(status, 0, said)
            self.assertIn("robot.ramp", said)
        finally:
            process.terminate()
            process.wait()

    def test_a_sketch_without_a_hub_says_so_and_goes_on_looking(self):
        with open(os.path.join(self.folder, "early.py"), "w") as file:
            file.write("from pysketch import Sketch\nsketch = Sketch('unix:%s/hub.sock', interval=0.01)\n"
                       "sketch.loop(lambda: sketch.publish('early', 1))\nsketch.run()\n" % self.folder)
        process = self.start("early.py")
        try:
            line = process.stdout.readline()
            self.assertIn("is skrobot running?", line)
            # The hub's own door, under the name at which the sketch looks for it.
            os.symlink(os.path.join(self.hub.folder, "hub.sock"), os.path.join(self.folder, "hub.sock"))
            with connect(self.hub.unix) as hub:
                self.patiently(lambda: "robot.early" in [channel.name for channel in hub.channels()])
        finally:
            process.terminate()
            process.wait()
        self.assertEqual(process.stdout.read(), "")

    def test_mistakes_are_one_line(self):
        for arguments, words in ((("run", "nothing.py"), "there is no file nothing.py"),
                                 (("new", "no/where/ramp.py"), "No such file"),
                                 (("new", "2nd.py"), "makes no name"),
                                 (("new", "pysketch.py"), "call it otherwise"),
                                 (("bundle", "no/where.py"), "No such file"),
                                 (("relay", "unix:/x"), "is no serial line"),
                                 (("relay", "tty:/dev/null"), "cannot be used")):
            said, status = self.pysketch(*arguments)
            self.assertEqual((status, len(said.splitlines())), (1, 1), said)
            self.assertIn(words, said)

    def test_a_hub_that_is_not_there_is_one_line(self):
        said, status = self.pysketch("check", "--hub", "unix:/nowhere/hub.sock")
        self.assertEqual((status, len(said.splitlines())), (1, 1), said)
        self.assertIn("is skrobot running?", said)

    def test_the_bench_prints_both_cases(self):
        said, status = self.pysketch("bench", "--seconds", "0.1", "--json")
        self.assertEqual(status, 0, said)
        self.assertEqual(said.count("messages_per_s"), 2)

    def test_every_file_is_in_the_syntax_of_this_python(self):
        import pysketch
        folder, names = os.path.dirname(os.path.abspath(pysketch.__file__)), []
        for name in os.listdir(folder):
            if name.endswith(".py"):
                with open(os.path.join(folder, name)) as file:
                    compile(file.read(), name, "exec")
                names.append(name)
        self.assertIn("aio.py", names)

    def test_one_copied_file_is_the_whole_package(self):
        self.assertEqual(self.pysketch("bundle")[1], 0)
        self.assertEqual(os.listdir(self.folder), ["pysketch.py"])
        with open(os.path.join(self.folder, "robot.py"), "w") as file:
            file.write("from pysketch import Sketch\nfrom pysketch.tty import Port\nsketch = Sketch(interval=0.01)\n"
                       "sketch.serve('ping', lambda request: request.value)\nsketch.run()\n")
        process = self.start("robot.py", path=None)
        try:
            with connect(self.hub.unix) as hub:
                self.patiently(lambda: "robot.ping" in [channel.name for channel in hub.channels()])
                self.assertEqual(hub.call("robot.ping", [1]), [1])
        finally:
            process.terminate()
            process.wait()
        said, status = self.says("pysketch.py", "check", path=None)
        self.assertEqual(status, 0, said)
        said, status = self.says("pysketch.py", "bench", "--seconds", "0.1", path=None)
        self.assertEqual(status, 0, said)


if __name__ == "__main__":
    unittest.main()
