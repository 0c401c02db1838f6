"""What a satellite tells of its own pulse, in its own database, where the hub's tools find it."""

from .clock import monotonic
from .flow import Part

TELL_EVERY_S = 1.0
# As the hub's own loops are called.
_MODE_NAMES = {"coarse": "Coarse", "realtime": "Realtime", "select-io": "SelectIo", "synced": "Synced"}


class Teller(Part):
    """Keeps `pulse.interval_ms`, `pulse.mode` and `pulse.statistics` in the satellite's own database."""

    def __init__(self, clerk, pulse):
        self._clerk, self._pulse, self._told_at, self._told_pace = clerk, pulse, 0.0, None

    def restore(self):
        self._told_pace = None
        self._tell_pace()

    def check(self, now):
        self._tell_pace()
        if now >= self._told_at + TELL_EVERY_S:
            self._told_at = monotonic()
            self._clerk.introduce("pulse.statistics", self._pulse.statistics.snapshot())

    def _tell_pace(self):
        pace = (self._pulse.interval, self._pulse.mode)
        if pace != self._told_pace:
            self._told_pace = pace
            self._clerk.introduce("pulse.interval_ms", pace[0] * 1e3)
            self._clerk.introduce("pulse.mode", _MODE_NAMES[pace[1]])
