"""Time: a clock that never goes back, in seconds."""

import os
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
