"""What a factorisation will take, told from its symbolic analysis before it starts."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

import psutil

from solvers.errors import TooLarge

MEMORY_SHARE = 0.8  # of what is available: the rest is vectors and the matrices themselves
GROUP_LIMIT = Path("/sys/fs/cgroup/memory.max")
GROUP_USED = Path("/sys/fs/cgroup/memory.current")


def room_bytes() -> float:
    """Bytes a factorisation may take: a share of what the machine, or the process's control group, has left."""
    left = float(psutil.virtual_memory().available)
    with suppress(OSError, ValueError):  # no such file, or "max": no limit
        left = min(left, float(GROUP_LIMIT.read_text()) - float(GROUP_USED.read_text()))
    return MEMORY_SHARE * max(left, 0.0)


def foresee(needed_bytes: float, unknowns: int) -> int:
    """The estimate itself, B; TooLarge, with the estimate and what to do, for what would not fit into memory."""
    room = room_bytes()
    if needed_bytes > room:
        raise TooLarge(
            f"factorising {unknowns} unknowns needs about {needed_bytes / 2**30:.1f} GiB, "
            f"{room / 2**30:.1f} GiB are free: "
            "ask for a coarser mesh, a lower order, or model = superelement"
        )
    return int(needed_bytes)


def threads() -> int:
    """Threads a factorisation may use: ANTINODE_THREADS, or every core."""
    return int(os.environ.get("ANTINODE_THREADS", "0")) or (os.cpu_count() or 1)
