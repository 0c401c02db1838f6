#!/usr/bin/env python
"""Publishes a number ten times a second; `subscriber.py` hears it, and so does `sk echo celsius`."""
from pysketch import Sketch

sketch = Sketch(interval=0.1)  # seconds

@sketch.loop
def loop():
    sketch.publish("celsius", 21.5 + sketch.pulse.statistics.ticks % 10 / 10.0)

sketch.run()
