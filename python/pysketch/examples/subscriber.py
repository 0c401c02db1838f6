#!/usr/bin/env python
"""Prints what `publisher.py` says."""
from pysketch import Sketch

sketch = Sketch()

@sketch.subscribe("robot.celsius")
def on_celsius(message):
    print("%s is %s" % (message.name, message.value))

sketch.run()
