"""`python -m pysketch new|run|check|bench|relay|bundle`: write a sketch, run one, look at the hub, measure, lend a hub a
serial line, make one file of it all."""

from __future__ import print_function

import argparse
import os
import re
import runpy
import sys

from . import Refused, Sketch, __version__, connect
from .address import Address
from .bench import bench
from .bundle import bundle
from .links import LinkError
from .login import LoginError
from .relay import Relay

TEMPLATE = '''#!/usr/bin/env python
"""A sketch: setup() once, loop() at each pulse."""

from pysketch import Sketch

sketch = Sketch(interval=0.1)   # seconds


@sketch.setup
def setup():
    sketch.stream("{name}", unit="1", doc="a ramp from 0 to 1")


@sketch.loop
def loop():
    sketch.publish("{name}", (sketch.pulse.statistics.ticks % 10) / 10.0)


@sketch.subscribe("robot.{name}")     # its own, to see something
def on_{name}(message):
    print("%s %s" % (message.name, message.value))


if __name__ == "__main__":
    sketch.run()
'''


def new(options):
    """Writes a sketch that runs."""
    name = os.path.splitext(os.path.basename(options.file))[0].lower().replace("-", "_")
    if name == "pysketch":
        raise SystemExit("pysketch: call it otherwise, or it stands in the place of this package")
    if not re.match(r"[a-z_][a-z0-9_]*\Z", name):
        raise SystemExit("pysketch: %r makes no name for a channel: use letters, digits and _" % name)
    if os.path.exists(options.file):
        raise SystemExit("pysketch: %s exists already" % options.file)
    write(options.file, TEMPLATE.format(name=name))
    print("%s is written. With a hub running (skrobot), try\n\n    python -m pysketch run %s" % (options.file, options.file))


def write(path, text):
    """Writes a file, or says in a line why it cannot be."""
    try:
        with open(path, "w") as file:
            file.write(text)
    except (IOError, OSError) as error:
        raise SystemExit("pysketch: %s cannot be written: %s" % (path, error.strerror))


def run(options):
    """Runs a sketch: its own `run()`, or that of a Sketch it only defines."""
    if not os.path.isfile(options.file):
        raise SystemExit("pysketch: there is no file %s" % options.file)
    sys.argv = [options.file] + options.arguments
    sys.path.insert(0, os.path.dirname(os.path.abspath(options.file)))
    found = runpy.run_path(options.file, run_name="__main__")
    sketches = [value for value in found.values() if isinstance(value, Sketch)]
    for sketch in sketches:
        if not sketch.was_set_up:
            sketch.run()


def check(options):
    """Says whether there is a hub and what it offers."""
    with connect(options.hub) as hub:
        channels = hub.channels()
        print("The hub lets you in as %s. It has %d channels:" % (hub.user, len(channels)))
        for channel in sorted(channels, key=lambda channel: channel.name):
            print("  %-8s %s" % (channel.kind, channel.name))


def relay(options):
    """Lends a hub that listens on sockets only a serial line."""
    line = Address(options.line)
    relaying = Relay(line.listen(), Address(options.hub))
    print("What comes on %s goes to the hub. Ctrl-C ends this." % line)
    try:
        relaying.run()
    finally:
        relaying.close()


def write_bundle(options):
    """Makes one file of the package."""
    write(options.file, bundle(__version__))
    print("%s is written: copy it to the robot, beside your sketch." % options.file)


def main(arguments=None):
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m pysketch", description=__doc__)
    parser.add_argument("--version", action="version", version="pysketch " + __version__)
    tasks = parser.add_subparsers(dest="task", metavar="TASK")
    task = tasks.add_parser("new", help="write a new sketch")
    task.add_argument("file", help="where, such as ramp.py")
    task = tasks.add_parser("run", help="run a sketch")
    task.add_argument("file")
    task.add_argument("arguments", nargs=argparse.REMAINDER, help="for the sketch")
    for name, says in (("check", "see whether a hub answers, and what it offers"),
                       ("bench", "measure what this Python takes from the hub"),
                       ("relay", "be the hub's end of a serial line")):
        task = tasks.add_parser(name, help=says)
        task.add_argument("--hub", help="unix:PATH, tcp:HOST:PORT or tty:DEVICE [default: this user's hub]")
        if name == "relay":
            task.add_argument("line", help="tty:DEVICE?baud=NUMBER")
        if name == "bench":
            task.add_argument("--seconds", type=float, default=2.0, help="for each measurement [default: 2]")
            task.add_argument("--json", action="store_true", help="one object a line")
    task = tasks.add_parser("bundle", help="make one file of this package, for a robot without pip")
    task.add_argument("file", nargs="?", default="pysketch.py")
    options = parser.parse_args(arguments)
    if options.task is None:
        parser.print_help()
        return 2
    try:
        _TASKS[options.task](options)
    except (LinkError, LoginError, Refused) as error:
        print("pysketch: %s" % error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


_TASKS = {"new": new, "run": run, "check": check, "bench": bench, "relay": relay, "bundle": write_bundle}

if __name__ == "__main__":
    sys.exit(main())
