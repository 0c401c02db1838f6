#!/usr/bin/env python
"""Follows the beat of `sync_source.py`: `loop` runs when that one's did."""
from pysketch import Sketch

sketch = Sketch(interval=0.02)
sketch.sync_to("robot.beat", divisor=1)

@sketch.loop
def loop():
    if sketch.tick and sketch.tick % 50 == 0:
        print("tick %d" % sketch.tick)

sketch.run()
