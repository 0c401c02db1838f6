"""Blob channels: files at the hub."""

import os
import shutil
import tempfile
import unittest

from hub import Hub, HubTest, Patience, offers_blobs
from pysketch import FlowSat, Refused, connect


class Blobs(HubTest):
    """An owner that writes, others that read."""

    def setUp(self):
        HubTest.setUp(self)
        if not offers_blobs(self.hub):
            self.skipTest("this hub has no blob channels")
        self.owner, self.outcomes = self.sat(), []
        self.store = self.owner.store("store")
        self.until(lambda: self.store.opened, self.owner)

    def done(self, count):
        self.until(lambda: len(self.outcomes) == count, self.owner)
        return self.outcomes

    def test_a_file_goes_up_and_comes_down(self):
        folder = tempfile.mkdtemp(prefix="pysketch-")
        self.addCleanup(shutil.rmtree, folder)
        data, path = os.urandom(700000), os.path.join(folder, "local")
        with open(path, "wb") as file:
            file.write(data)
        self.store.mkdir("maps", self.outcomes.append)
        self.store.upload_file("maps/a.bin", path, self.outcomes.append)
        self.store.upload("empty", bytearray(), self.outcomes.append)
        self.assertEqual(self.done(3), [None, None, None])
        reader, got = self.sat(), []
        self.until(lambda: "robot.store" in [channel.name for channel in reader.channels], reader)
        reader.files("robot.store").read("maps/a.bin", lambda *found: got.append(found))
        self.until(lambda: got, reader)
        self.assertTrue(got[0] == (data, None))
        with connect(self.hub.unix) as hub:
            self.assertEqual(hub.read_file("robot.store", "maps/a.bin"), data)
            self.assertEqual(hub.read_file("robot.store", "empty"), b"")
            self.assertIn(("a.bin", False, 700000),
                          [(entry.name, entry.directory, entry.bytes) for entry in hub.list_files("robot.store", "maps")])
            self.assertEqual(hub.stat_file("robot.store", "maps/a.bin").bytes, 700000)

    def test_files_are_moved_and_removed_and_refusals_are_told(self):
        self.store.upload("one", b"1" * 2000, self.outcomes.append)
        self.done(1)
        codes = {}

        def note(what):
            def then(error):
                codes[what] = error and error.code
            return then
        self.store.move("one", "two", note("move"))
        self.store.remove_file("two", note("remove"))
        self.store.remove_file("three", note("missing"))
        self.store.mkdir("../out", note("outside"))
        self.until(lambda: len(codes) == 4, self.owner)
        self.assertEqual(codes, {"move": None, "remove": None, "missing": "NoSuchPath", "outside": "BadPath"})
        with connect(self.hub.unix) as hub:
            with self.assertRaises(Refused) as caught:
                hub.read_file("robot.store", "two")
            self.assertEqual(caught.exception.code, "NoSuchPath")

    def test_a_file_that_vanishes_under_way_is_told(self):
        folder = tempfile.mkdtemp(prefix="pysketch-")
        self.addCleanup(shutil.rmtree, folder)
        paths = [os.path.join(folder, name) for name in ("gone", "cut", "grown")]
        for path in paths:
            with open(path, "wb") as file:
                file.write(b"x" * 600000)
        uploads = [self.store.upload_file(os.path.basename(path), path, self.outcomes.append) for path in paths]
        os.remove(paths[0])
        open(paths[1], "wb").close()
        with open(paths[2], "ab") as file:
            file.write(b"and more")
        self.done(3)
        self.assertTrue(all(upload.done for upload in uploads))
        codes = sorted(error.code for error in self.outcomes if error is not None)
        self.assertEqual(codes, ["Aborted", "Aborted"])
        with connect(self.hub.unix) as hub:
            # What was measured is what is sent.
            self.assertEqual(hub.read_file("robot.store", "grown"), b"x" * 600000)


class Interruption(Patience):
    """A hub that is killed in the middle of an upload."""

    def test_an_upload_goes_on_where_the_hub_has_it(self):
        hub = self.keep_hub(Hub("--without", "host"))
        if not offers_blobs(hub):
            self.skipTest("this hub has no blob channels")
        data, outcomes = os.urandom(4000000), []
        sat = self.keep(FlowSat(hub.unix, interval=0.01))
        upload = sat.store("store").upload("big", data, outcomes.append)
        self.until(lambda: upload.sent > 500000, sat)
        self.assertEqual(outcomes, [])
        hub.kill()
        self.until(lambda: not sat.ready, sat)
        hub.start()
        self.until(lambda: outcomes, sat)
        self.assertEqual(outcomes, [None])
        with connect(hub.unix) as reader:
            self.assertTrue(reader.read_file("robot.store", "big") == data)


if __name__ == "__main__":
    unittest.main()
