"""Time: a clock that never goes back, the wait of each mode, and what is measured of it."""

import math
import os
import select
import sys
import time

if hasattr(time, "monotonic"):
    monotonic = time.monotonic
else:
    def _uptime():
        with open("/proc/uptime") as file:
            return float(file.read().split()[0])

    class _SteadiedClock(object):
        """For a Python 2.7 without ctypes: the wall clock, held to the kernel's uptime (which steps by 10 ms), so
        that a wall clock that is set makes no more than one short step here."""

        def __init__(self):
            self._base, self._last, self._look_at = time.time() - _uptime(), 0.0, 0.0

        def __call__(self):
            now = time.time() - self._base
            if not 0 <= now - self._last < 1.0 or now >= self._look_at:
                uptime = _uptime()
                if abs(now - uptime) > 0.05:
                    self._base += now - uptime
                    now = uptime
                self._look_at = now + 1.0
            self._last = max(self._last, now)
            return self._last

    def _python2_clock():
        try:
            import ctypes

            class Timespec(ctypes.Structure):
                _fields_ = [("seconds", ctypes.c_long), ("nanos", ctypes.c_long)]

            call = ctypes.CDLL(None, use_errno=True).clock_gettime
            call.argtypes = [ctypes.c_int, ctypes.POINTER(Timespec)]
            now = Timespec()

            def clock():
                call(1, ctypes.byref(now))
                return now.seconds + now.nanos * 1e-9

            clock()
            return clock
        except Exception:  # a Python without ctypes, or a C library without the call
            return _SteadiedClock() if os.path.exists("/proc/uptime") else time.time
    monotonic = _python2_clock()

COARSE, REALTIME, SOCKET, SYNCED = "coarse", "realtime", "select-io", "synced"
MODES = (COARSE, REALTIME, SOCKET, SYNCED)

_PER_OCTAVE = 4
_BUCKETS = 40 * _PER_OCTAVE


class Histogram(object):
    """Durations in buckets of a quarter octave from 1 ns on: 19 % apart, 160 counters in all."""

    def __init__(self):
        self.counts, self.total, self.longest = [0] * _BUCKETS, 0, 0

    def add(self, nanos):
        """Counts one duration, in nanoseconds."""
        at = int(math.log(nanos, 2) * _PER_OCTAVE) if nanos >= 1 else 0
        self.counts[min(at, _BUCKETS - 1)] += 1
        self.total += 1
        if nanos > self.longest:
            self.longest = nanos

    def quantile(self, share):
        """The duration, in nanoseconds, that this share of all did not exceed; 0 if there are none."""
        wanted, seen = share * self.total, 0
        for at, count in enumerate(self.counts):
            seen += count
            if count and seen >= wanted:
                return int(min(self.longest, 2 ** ((at + 1.0) / _PER_OCTAVE)))
        return 0


class Statistics(object):
    """What is known of the pulses of a sketch, as of any loop of the hub's: durations in nanoseconds."""

    def __init__(self):
        self.ticks = self.missed = self.overruns = self.sync_lost = 0
        self.wake_error, self.job_time = Histogram(), Histogram()

    def snapshot(self):
        """All of it as plain values."""
        found = {"ticks": self.ticks, "missed": self.missed, "overruns": self.overruns, "sync_lost": self.sync_lost}
        for name, histogram in (("wake_error", self.wake_error), ("job_time", self.job_time)):
            found[name] = {
                "p50_ns": histogram.quantile(0.5), "p99_ns": histogram.quantile(0.99),
                "max_ns": int(histogram.longest),
            }
        return found


class Pulse(object):
    """Waits for the next tick while it serves a link.

    `coarse` sleeps one interval after each round and loses time by design. `realtime` keeps to a schedule: it
    sleeps short of the deadline and spins the rest, so nothing drifts. `select-io` wakes for the socket, and at
    the latest after one interval; each wait ends in a tick. `synced` ticks when a tick of the hub came.
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
        self._begun = monotonic()
        self._next = self._begun + self.interval
        self._margin = min(0.0002, self.interval / 2)
        self._synced = False

    def sync(self):
        """A tick of the hub came: the next round is a tick."""
        self._synced = True

    def wait(self, link, wants_write):
        """Waits as the mode says. Answers (whether this round is a tick, readable, writable)."""
        if self.mode == REALTIME:
            return self._wait_until(link, wants_write)
        if self.mode == SOCKET:
            readable, writable = _look(link, wants_write, self.interval)
            return self._tick(0.0), readable, writable
        if self.mode == SYNCED:
            return self._wait_for_sync(link, wants_write)
        deadline = monotonic() + self.interval
        readable, writable = False, False
        if wants_write:
            readable, writable = _look(link, True, 0)
        while True:
            left = deadline - monotonic()
            if left <= 0:
                break
            time.sleep(left)
        if not readable:
            readable, writable = _look(link, wants_write, 0)
        return self._tick(monotonic() - deadline), readable, writable

    def _tick(self, error):
        self.statistics.ticks += 1
        if self.mode != SOCKET:
            self.statistics.wake_error.add(abs(error) * 1e9)
        return True

    def _wait_until(self, link, wants_write):
        now = monotonic()
        if now > self._next:
            behind = int((now - self._next) / self.interval)
            self.statistics.missed += behind
            self.statistics.overruns += 1
            self._next += behind * self.interval
        readable, writable = False, False
        while True:
            left = self._next - monotonic() - self._margin
            if left <= 0:
                break
            if readable or link is None:
                # What has come is read after the tick; until then only time matters.
                time.sleep(left)
            else:
                readable, writable = _look(link, wants_write, left)
                if writable:
                    return False, readable, writable
        woke = monotonic()
        while woke < self._next:
            woke = monotonic()
        error = woke - self._next
        self._adapt(error)
        self._next += self.interval
        if not readable:
            readable, writable = _look(link, wants_write, 0)
        return self._tick(error), readable, writable

    def _adapt(self, error):
        """A late wake-up widens what is spun, half an interval at most; good ones narrow it slowly."""
        if error > 20e-6:
            self._margin = min(self._margin + error, self.interval / 2)
        else:
            self._margin = max(self._margin * 0.999, 50e-6)

    def _wait_for_sync(self, link, wants_write):
        if self._synced:
            self._synced = False
            return self._tick(0.0), True, wants_write
        readable, writable = _look(link, wants_write, 4 * self.interval)
        if not readable and not writable:
            self.statistics.sync_lost += 1
        return False, readable, writable


def _look(link, wants_write, timeout):
    """Waits for a link; answers (readable, writable)."""
    if link is None:
        if timeout > 0:
            time.sleep(timeout)
        return False, False
    end = monotonic() + timeout
    while True:
        try:
            readable, writable, _ = select.select([link], [link] if wants_write else [], [], max(0, timeout))
            return bool(readable), bool(writable)
        except (select.error, OSError) as error:
            if error.args[0] != 4:
                raise
            timeout = end - monotonic()


if sys.platform.startswith("linux"):
    def tighten():
        """Asks the kernel to wake this thread when it said, not up to 50 us later (timer slack of 1 ns)."""
        try:
            import ctypes
            ctypes.CDLL(None).prctl(29, 1, 0, 0, 0)
            return True
        except Exception:
            return False
else:
    def tighten():
        """Linux only."""
        return False
