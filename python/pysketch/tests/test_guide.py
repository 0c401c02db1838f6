"""The page for students: what it says to write and to type is written and typed here, against a real hub."""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

from hub import PROGRAM, HubTest

PAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "..", "docs", "guide", "python.md")
SOURCES = os.path.abspath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "src"))
# The tool stands beside the hub.
TOOL = os.path.join(os.path.dirname(PROGRAM), "sk")


def blocks():
    """The Python of the page, in its order."""
    with open(PAGE) as file:
        return re.findall(r"^```python\n(.*?)^```$", file.read(), re.MULTILINE | re.DOTALL)


class FiveMinutes(HubTest):
    """From two files to a graph."""

    def setUp(self):
        HubTest.setUp(self)
        self.folder = tempfile.mkdtemp(prefix="pysketch-")
        self.addCleanup(shutil.rmtree, self.folder)
        self.environment = dict(
            os.environ, SKROBOT_STATE_DIR=self.hub.folder, PYTHONPATH=SOURCES, PYTHONUNBUFFERED="1",
            PYTHONDONTWRITEBYTECODE="1")
        if os.environ.get("PYSKETCH_INSTALLED"):
            # An installed package is tried as it is.
            del self.environment["PYTHONPATH"]

    def start(self, name, text):
        """Writes a file and runs it."""
        path = os.path.join(self.folder, name)
        with open(path, "w") as file:
            file.write(text)
        process = subprocess.Popen([sys.executable, path], env=self.environment, cwd=self.folder,
                                   stdout=subprocess.PIPE, universal_newlines=True)

        def end():
            process.terminate()
            process.wait()
            process.stdout.close()
        self.addCleanup(end)
        return process

    def types(self, *words):
        """What a command says."""
        return subprocess.check_output(words, env=self.environment).decode("utf-8")

    def test_two_sketches_talk_and_are_seen(self):
        publisher, subscriber = blocks()[:2]
        self.start("thermometer.py", publisher)
        display = self.start("display.py", subscriber)
        self.assertEqual(display.stdout.readline(), "robot.celsius is 21.5\n")
        self.assertIn("stream   robot.celsius", self.types(sys.executable, "-m", "pysketch", "check"))
        graph = json.loads(self.types(TOOL, "graph", "--json"))
        seen = [(one["owner"], one["subscribers"]) for one in graph["channels"] if one["name"] == "robot.celsius"]
        self.assertEqual(seen, [("robot.thermometer", ["robot.display"])])
        self.assertIn("robot.display", self.types(TOOL, "graph"))
        self.assertEqual(self.types(TOOL, "echo", "celsius", "-n", "1"), "21.5\n")
        self.assertIn("pulse", self.types(TOOL, "info", "thermometer"))

    def test_everything_on_the_page_is_in_the_syntax_of_this_python(self):
        for text in blocks():
            compile("from __future__ import print_function\n" + text, "python.md", "exec")


if __name__ == "__main__":
    unittest.main()
