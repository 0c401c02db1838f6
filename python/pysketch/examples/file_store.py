#!/usr/bin/env python
"""A remote file store: what stands in a folder here is kept by the hub, and read from there by anybody who may.

    python file_store.py FOLDER            put the files of a folder into the store, and stay
    python file_store.py --read NAME       print a file of the store
"""
import os
import re
import sys

from pysketch import FlowSat, connect


class Uploader(FlowSat):
    """Uploads the files of a folder, one after the other."""

    def setup(self):
        self.files = self.store("files", doc="the files of " + os.path.basename(self.folder))
        self.names = sorted(name for name in os.listdir(self.folder) if re.match(r"^[A-Za-z0-9_.-]+$", name))
        self.next(None)

    def next(self, error):
        """The one before is on the hub's disk, or was refused."""
        if error is not None:
            print("refused: %s" % error)
        if not self.names:
            print("all is stored")
            sys.stdout.flush()
            return
        name = self.names.pop(0)
        print("storing %s" % name)
        self.files.upload_file(name, os.path.join(self.folder, name), self.next)


if sys.argv[1] == "--read":
    with connect() as hub:
        text = hub.read_file("robot.files", sys.argv[2])
        getattr(sys.stdout, "buffer", sys.stdout).write(text)
else:
    uploader = Uploader()
    uploader.folder = sys.argv[1]
    uploader.run()
