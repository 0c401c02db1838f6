#!/usr/bin/env python
"""Asks `service.py`, on a temporary connection that is no satellite."""
import sys
from pysketch import connect

with connect() as hub:
    print(hub.call("robot.sum", [float(word) for word in sys.argv[1:]]))
