#!/usr/bin/env python
"""A service: it adds up the numbers that it is sent. Ask it with `python asker.py 1 2 3`."""
from pysketch import Sketch

sketch = Sketch()

@sketch.serve("sum", doc="adds up a list of numbers")
def add(request):
    return sum(request.value)

sketch.run()
