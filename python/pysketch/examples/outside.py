#!/usr/bin/env python
"""The half outside of the robot: thinks on a larger machine, on any Python. It raises the arm and watches it go."""
from pysketch import Sketch

sketch = Sketch()

@sketch.setup
def setup():
    sketch.call("robot.move", {"arm": 1.0}, answered, within=60)

def answered(reply):
    print("goals: %s" % (reply.value["goals"] if reply.ok else reply.error))

@sketch.subscribe("robot.joints")
def on_joints(message):
    if message.value["arm"] > 0.99:
        print("the arm is up")
        sketch.stop()

sketch.run()
