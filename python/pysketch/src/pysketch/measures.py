"""What is measured of a sketch's pulses."""

import math

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
    """What is known of the pulses of a sketch: as of a loop of the hub, with the same names and units. `interval` is the
    one that was asked for and `mean_interval` the one that came of it, both in seconds since it was last changed."""

    def __init__(self):
        self.ticks = self.missed = self.overruns = self.sync_lost = 0
        self.wake_error, self.job_time = Histogram(), Histogram()
        self.begin(0.0)

    def begin(self, interval):
        """Another interval holds from now on."""
        self.interval, self._first, self._last, self._spans = interval, None, None, 0

    def tick(self, now):
        """A pulse, at this time."""
        self.ticks += 1
        if self._first is None:
            self._first = now
        else:
            self._spans += 1
        self._last = now

    @property
    def mean_interval(self):
        """See there; 0.0 before the second pulse."""
        return (self._last - self._first) / self._spans if self._spans else 0.0

    def snapshot(self):
        """All of it as plain values; durations are in seconds, and None where nothing was measured."""
        return {
            "interval": self.interval, "mean_interval": self.mean_interval, "ticks": self.ticks, "missed": self.missed,
            "overruns": self.overruns, "sync_lost": self.sync_lost, "wake_error": _figures(self.wake_error),
            "job_time": _figures(self.job_time),
        }


def _figures(histogram):
    if not histogram.total:
        return None
    return {"p50": histogram.quantile(0.5) * 1e-9, "p99": histogram.quantile(0.99) * 1e-9, "max": histogram.longest * 1e-9}
