"""The pulse of a sketch: the wait of each mode."""

import select
import time

from .clock import monotonic, tighten
from .measures import Statistics

COARSE, REALTIME, SOCKET, SYNCED = "coarse", "realtime", "select-io", "synced"
MODES = (COARSE, REALTIME, SOCKET, SYNCED)

# What is spun before a deadline in the mode `realtime`, in seconds: at first, and at least.
_MARGIN_FIRST_S, _MARGIN_MIN_S = 200e-6, 50e-6
_LATE_S = 20e-6


class Pulse(object):
    """Waits for the next tick while it serves a link.

    `coarse` waits one interval after each tick, in which it reads what comes, and loses time by design. `realtime`
    keeps to a schedule: it sleeps short of the deadline and spins the rest, so nothing drifts; what comes is read after
    the tick. `select-io` ticks whenever the hub sends something, and at the latest after one interval. `synced` ticks
    when a tick of the hub came. `due` is when the next tick of the first two comes, in seconds of `monotonic`; None before
    the first wait.
    """

    def __init__(self, mode, interval):
        self.statistics = Statistics()
        self.change(mode, interval)

    def change(self, mode, interval):
        """Another mode or interval, in seconds, from the next wait on."""
        if mode not in MODES:
            raise ValueError("no mode is called %r; there are %s" % (mode, ", ".join(MODES)))
        if not interval > 0:
            raise ValueError("an interval is longer than 0 s, not %r" % (interval,))
        self.mode, self.interval = mode, float(interval)
        self.due = None
        self._margin = min(_MARGIN_FIRST_S, self.interval / 2)
        self._synced = False
        self.statistics.begin(self.interval)
        if mode == REALTIME:
            tighten()

    def sync(self):
        """A tick of the hub came: the next round is a tick."""
        self._synced = True

    def wait(self, link, wants_write):
        """Waits as the mode says. Answers (whether this round is a tick, readable, writable)."""
        if self.mode == COARSE:
            return self._wait_coarsely(link, wants_write)
        if self.mode == REALTIME:
            return self._wait_until(link, wants_write)
        if self.mode == SYNCED:
            return self._wait_for_sync(link, wants_write)
        readable, writable = look(link, wants_write, self.interval)
        return self._tick(None), readable, writable

    def _tick(self, error):
        self.statistics.tick(monotonic())
        if error is not None:
            self.statistics.wake_error.add(abs(error) * 1e9)
        return True

    def _wait_coarsely(self, link, wants_write):
        if self.due is None:
            self.due = monotonic() + self.interval
        readable, writable = look(link, wants_write, max(0, self.due - monotonic()))
        error = monotonic() - self.due
        if error < 0:
            return False, readable, writable
        self.due = None
        return self._tick(error), readable, writable

    def _wait_until(self, link, wants_write):
        now = monotonic()
        if self.due is None:
            self.due = now + self.interval
        if now > self.due:
            behind = int((now - self.due) / self.interval)
            self.statistics.missed += behind
            self.statistics.overruns += 1
            self.due += behind * self.interval
        readable, writable = False, False
        while True:
            left = self.due - monotonic() - self._margin
            if left <= 0:
                break
            if readable or link is None:
                # What has come is read after the tick; until then only time matters.
                time.sleep(left)
            else:
                readable, writable = look(link, wants_write, left)
                if writable:
                    return False, readable, writable
        woke = monotonic()
        while woke < self.due:
            woke = monotonic()
        error = woke - self.due
        self._adapt(error)
        self.due += self.interval
        if not readable:
            readable, writable = look(link, wants_write, 0)
        return self._tick(error), readable, writable

    def _adapt(self, error):
        """A late wake-up widens what is spun, half an interval at most; good ones narrow it slowly."""
        if error > _LATE_S:
            self._margin = min(self._margin + error, self.interval / 2)
        else:
            self._margin = max(self._margin * 0.999, min(_MARGIN_MIN_S, self.interval / 2))

    def _wait_for_sync(self, link, wants_write):
        if self._synced:
            # Nothing is read before it: a further tick that has come makes a further round.
            self._synced = False
            return self._tick(None), False, wants_write
        readable, writable = look(link, wants_write, 4 * self.interval)
        if not readable and not writable:
            self.statistics.sync_lost += 1
        return False, readable, writable


def look(link, wants_write, timeout):
    """Waits for a link, `timeout` seconds at most; answers (readable, writable)."""
    end = monotonic() + timeout
    if link is None:
        if timeout > 0:
            time.sleep(timeout)
        return False, False
    due, wants_write = link.due(), link.watches(wants_write)
    if due is not None:
        timeout = min(timeout, due)
    while True:
        try:
            readable, writable, _ = select.select([link], [link] if wants_write else [], [], max(0, timeout))
            return bool(readable) or due is not None and link.due() == 0, bool(writable)
        except (select.error, OSError) as error:
            if error.args[0] != 4:
                raise
            timeout = min(timeout, end - monotonic())
