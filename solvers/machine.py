"""Threads, memory and factorisations of this machine, and the memory of this process; read without numpy, for plans."""

from __future__ import annotations

import ctypes
import gc
import importlib.util
import math
import os
import sys
import threading
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

LIMIT = "ANTINODE_THREADS"
MEMORY_SHARE = 0.8  # of the available memory: the rest is for vectors and the matrices themselves
GROUPS = Path("/sys/fs/cgroup")

GROUP_FILES = (  # limit and use in a control group's folder, versions 2 and 1
    ("memory.max", "memory.current"),
    ("memory.limit_in_bytes", "memory.usage_in_bytes"),
)

STATED = "ANTINODE_MEMORY_GIB"  # memory available, set by the user instead of measured
FACTOR = "ANTINODE_FACTOR"  # name of the factorisation taken


def workers() -> int:
    """Return the number of threads: ANTINODE_THREADS, or every core.

    Returns
    -------
    int
        At least 1.
    """
    return int(os.environ.get(LIMIT, "0")) or (os.cpu_count() or 1)


def available_bytes() -> float:
    """Measure the memory that this process may still allocate within the machine, its control groups and its own limits.

    The variable ANTINODE_MEMORY_GIB states it instead.

    Returns
    -------
    float
        In bytes.
    """
    if stated := os.environ.get(STATED):
        return float(stated) * 2**30
    import psutil  # slow to import

    return max(0.0, min([float(psutil.virtual_memory().available), *_group_rooms(), *_process_rooms()]))


def room_bytes() -> float:
    """Return the memory that a factorisation may take: a share of the available one.

    Returns
    -------
    float
        In bytes.
    """
    return MEMORY_SHARE * available_bytes()


def memory_text(fault: MemoryError, doing: str = "") -> str:
    """Write one line on a MemoryError: the step, the size of the array if numpy reports it, and the remedy.

    Parameters
    ----------
    fault : MemoryError
        The exception.
    doing : str, optional
        Step in which it occurred.

    Returns
    -------
    str
        The message.
    """
    shape, kind = getattr(fault, "shape", None), getattr(fault, "dtype", None)
    request = ""
    if shape is not None and kind is not None:
        request = f", {math.prod(shape) * kind.itemsize / 2**30:.3g} GiB were requested at once"
    while_doing = f" in the step '{doing}'" if doing else ""
    return (
        f"memory ran out{while_doing}{request}, {available_bytes() / 2**30:.3g} GiB are available: raise solve.accuracy, "
        "request a narrower band or fewer modes, or set solve.model = 'superelement'"
    )


def foresee(needed_bytes: float, dofs: int) -> int:
    """Check that a factorisation fits into the memory.

    Parameters
    ----------
    needed_bytes : float
        Estimate.
    dofs : int
        Degrees of freedom, for the message.

    Returns
    -------
    int
        The estimate in bytes.

    Raises
    ------
    TooLarge
        With the estimate and a remedy, if it exceeds the memory.
    """
    instead = "use a coarser mesh, a lower order, or model = superelement"
    check_room(needed_bytes, f"factorising {dofs} degrees of freedom needs", instead)
    return int(needed_bytes)


def check_room(needed_bytes: float, what: str, instead: str) -> None:
    """Check that an amount of memory is available.

    Parameters
    ----------
    needed_bytes : float
        Estimate.
    what, instead : str
        Beginning of the message, and the remedy.

    Raises
    ------
    TooLarge
        With the estimate and the remedy, if it exceeds the memory.
    """
    from solvers.errors import TooLarge

    room = room_bytes()
    if needed_bytes > room:
        raise TooLarge(f"{what} about {needed_bytes / 2**30:.1f} GiB, {room / 2**30:.1f} GiB are free: {instead}")


@lru_cache(maxsize=1)
def factorisations() -> tuple[str, ...]:
    """Factorisations of this machine, the preferred one first."""
    return (*(["rslab"] if importlib.util.find_spec("rslab") else []), "superlu")


def restart_peak() -> None:
    """Reset the high-water mark if the system allows it (Linux), since a worker computes many cases."""
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
    """Read the largest resident size since the last restart from the kernel.

    Returns
    -------
    int or None
        In bytes; None if the kernel does not report it.
    """
    with suppress(OSError, StopIteration, ValueError):
        lines = Path("/proc/self/status").read_text().splitlines()
        return 1024 * int(next(line for line in lines if line.startswith("VmHWM")).split()[1])
    return None


def peak_bytes() -> int:
    """Return the largest resident size: the kernel's, else getrusage's, which may begin with the parent's.

    Returns
    -------
    int
        In bytes.
    """
    text = reported_peak_bytes()
    if text is not None:
        return text
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def resident_bytes() -> int:
    """Return the resident size of this process.

    Returns
    -------
    int
        In bytes.
    """
    import psutil

    return int(psutil.Process().memory_info().rss)


def _group_rooms() -> list[float]:
    """Bytes left by each control group of this process that has a limit."""
    rooms = []
    for folder in _groups():
        for limit, used in GROUP_FILES:
            with suppress(OSError, ValueError):  # no such file, or "max": no limit
                rooms.append(float((folder / limit).read_text()) - float((folder / used).read_text()))
    return rooms


def _groups() -> list[Path]:
    """Folders of this process's control groups and of those above them."""
    groups = [GROUPS, GROUPS / "memory"]
    with suppress(OSError):
        for line in Path("/proc/self/cgroup").read_text().splitlines():
            _, names, path = line.split(":", 2)
            if names in ("", "memory"):
                folder = (GROUPS / names) / path.strip("/")
                groups += [folder, *(each for each in folder.parents if GROUPS in each.parents)]
    return list(dict.fromkeys(groups))


def _process_rooms() -> list[float]:
    """Address space left by `ulimit -v` and `ulimit -d`; nothing without a limit, or on a system without them."""
    import psutil

    with suppress(ImportError, OSError):
        import resource

        limits = [resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)]
        used = psutil.Process().memory_info().vms
        return [float(limit - used) for limit in limits if limit != resource.RLIM_INFINITY]
    return []
