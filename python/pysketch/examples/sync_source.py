#!/usr/bin/env python
"""Gives the beat, fifty times a second, and tells how `sync_target.py` keeps up."""
from pysketch import Sketch

sketch = Sketch(interval=0.02, mode="realtime")
sketch.sync_source("beat")

@sketch.tick_report
def on_report(report):
    print("lag %.3f ms, %d done, %d missed" % (1000 * report.lag, report.done, report.missed))

sketch.run()
