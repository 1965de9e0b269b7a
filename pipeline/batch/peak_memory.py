"""How much memory this process takes, and took at most since a moment; giving back what a case no longer needs."""

from __future__ import annotations

import ctypes
import gc
import sys
import threading
from contextlib import suppress
from pathlib import Path


def restart() -> None:
    """Begin the high-water mark anew where the system allows it (Linux): a worker serves many cases."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def give_back() -> None:
    """Free what only refers to itself, such as a plate and its factorisations, and return the heap's free pages to the system.

    Python looks for such garbage by the number of objects, not by their size. Only the main thread does: rslab's factors are
    freed where they were made.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    gc.collect()
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # another C library has no such call
            ctypes.CDLL(None).malloc_trim(0)


def reported_peak_bytes() -> int | None:
    """Largest resident size since the last restart, by the kernel; None where it does not tell."""
    with suppress(OSError, StopIteration, ValueError):
        lines = Path("/proc/self/status").read_text().splitlines()
        return 1024 * int(next(line for line in lines if line.startswith("VmHWM")).split()[1])
    return None


def peak_bytes() -> int:
    """The same, or else the process's largest size ever (getrusage, which may begin with the parent's)."""
    text = reported_peak_bytes()
    if text is not None:
        return text
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def resident_bytes() -> int:
    """Resident size now."""
    import psutil

    return int(psutil.Process().memory_info().rss)
