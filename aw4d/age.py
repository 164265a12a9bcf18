"""How long this process has been running, its start-up included."""

from __future__ import annotations

import os
import time
from pathlib import Path

_IMPORTED = time.perf_counter()
_STARTED = 19  # place of a process' start, in ticks since the machine's, behind its name in /proc/self/stat: proc(5)


def process_age() -> float:
    """Seconds since this process was started, to 1/100 s; since this import where the system has no /proc."""
    try:
        line = Path("/proc/self/stat").read_text(encoding="utf-8")
    except OSError:
        return time.perf_counter() - _IMPORTED
    started = int(line.rpartition(")")[2].split()[_STARTED]) / os.sysconf("SC_CLK_TCK")
    return time.clock_gettime(time.CLOCK_BOOTTIME) - started
