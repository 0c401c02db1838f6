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
