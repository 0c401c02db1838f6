#!/usr/bin/env python
"""The half inside of a robot, beside its software kit: runs on the robot's own Python, 2.7 for instance.

It publishes the joints and obeys packages of commands. `Body` stands where the kit's own object is.

    SKROBOT_HUB=tcp:workstation:4141 python2 inside.py
"""
from pysketch import Sketch


class Body(object):
    """Two joints that go where they are told, a tenth of the way at each step."""

    def __init__(self):
        self.angles, self.goals = {"head": 0.0, "arm": 0.0}, {"head": 0.0, "arm": 0.0}

    def step(self):
        for joint, goal in self.goals.items():
            self.angles[joint] += 0.1 * (goal - self.angles[joint])


body, sketch = Body(), Sketch(interval=0.02)

@sketch.loop
def loop():
    body.step()
    sketch.publish("joints", body.angles)

@sketch.serve("move", format="json", doc="{joint: angle in radians}")
def move(request):
    unknown = sorted(set(request.value) - set(body.goals))
    if unknown:
        return request.decline("there is no joint " + ", ".join(unknown))
    body.goals.update(request.value)
    return {"goals": body.goals}

sketch.run()
