#!/usr/bin/env python
"""Stands in for a camera: publishes the JPEG files of a folder, five a second, again and again.

    python camera.py FOLDER                publish
    python camera.py --watch               print what comes
"""
import os
import sys

from pysketch import FlowSat


class Camera(FlowSat):
    """One message is one JPEG file, as it is."""

    def setup(self):
        self.out = self.stream("camera", format="bytes", mime="image/jpeg", rate=5, latch=True)
        self.at = 0

    def loop(self):
        names = sorted(name for name in os.listdir(self.folder) if name.endswith((".jpg", ".jpeg")))
        if names:
            with open(os.path.join(self.folder, names[self.at % len(names)]), "rb") as file:
                self.out.publish_bytes(file.read())
            self.at += 1


def seen(message):
    """A picture came: the size stands behind the marker SOF0 of its file."""
    data = bytearray(message.payload)
    at = data.find(b"\xff\xc0")
    print("%d bytes, %d x %d" % (len(data), data[at + 7] << 8 | data[at + 8], data[at + 5] << 8 | data[at + 6]))
    sys.stdout.flush()


camera = Camera(interval=0.2)
if sys.argv[1] == "--watch":
    camera = FlowSat()
    camera.subscribe("robot.camera", seen)
else:
    camera.folder = sys.argv[1]
camera.run()
