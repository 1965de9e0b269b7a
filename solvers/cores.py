"""How many threads this process may use in all; read without numpy, for plans that compute nothing."""

from __future__ import annotations

import os

LIMIT = "ANTINODE_THREADS"


def workers() -> int:
    """ANTINODE_THREADS, or every core."""
    return int(os.environ.get(LIMIT, "0")) or (os.cpu_count() or 1)
